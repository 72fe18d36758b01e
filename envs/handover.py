"""All arrays of a batch handed over to compiled code as one address, once instead of in each step.

Numba takes named tuples of arrays apart on every call. For three of the six parts of a step that
takes 4.9 us, for a whole step of one joint by the address of a table 0.75 us (one core). So
`table_of` notes once where each array lies, in a table of numbers, and `opened` makes the parts of
it again in compiled code, where that is a few loads. The price: nothing else keeps the arrays alive
or sees that they were replaced, and types are checked when the table is made, not later.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numba import from_dtype
from numba.np import arrayobj
from numpy.typing import NDArray

from cjt_gym.envs.observe import Control, Task
from cjt_gym.joint.configure import PARAMETER_DTYPE
from cjt_gym.joint.kernel.arrays import Batch, Setup
from cjt_gym.joint.lanes import Blocks, Kind
from cjt_gym.joint.lanes.vectors import cgutils, intrinsic, ir, types

populate_array: Any = arrayobj.populate_array

# What the fields of the table are: a letter for the type, and the number of dimensions. A field
# takes SLOTS numbers: the address of an array and its shape, or a value.
SLOTS = 4
LETTERS: dict[str, Any] = {
    "p": PARAMETER_DTYPE,
    "d": np.dtype(np.float64),
    "f": np.dtype(np.float32),
    "i": np.dtype(np.int64),
    "u": np.dtype(np.uint64),
    "b": np.dtype(np.bool_),
}
PARTS: tuple[tuple[Any, str], ...] = (
    (Batch, "p1 d3 d3 d3 d2 d2 d2 d1 d2 d3 d3 d2 i1 u1"),
    (Setup, "i3tuple i0 i0 i0 b0 d0 i0 d0"),
    (Kind, "i0 i0 i0 i0 i0 i0 i0 i0 i0 i0 i0 i0"),
    (Blocks, "d3 d3 b1 b1 d3"),
    (
        Task,
        "d2 d2 d2 d2 i2 i2 d2 d2 i2 u2 d2 d1 d1 d1 f2 d1 d2 b1 b1 d1 d1" + 5 * " d0" + 3 * " i0",
    ),
    (Control, "d1 d1 d1 d1 d2 d2 d1"),
)


def _numbers(form: str, value: Any) -> list[int]:
    """Return what the table holds of a field."""
    dtype, ndim = LETTERS[form[0]], int(form[1])
    if form.endswith("tuple"):
        found = list(value)
    elif ndim == 0:
        found = (
            np.array([value], np.float64 if form[0] == "d" else np.int64).view(np.int64).tolist()
        )
    else:
        if not (value.dtype == dtype and value.ndim == ndim and value.flags.c_contiguous):
            raise TypeError(
                f"The table wants {form}, got {value.dtype} of {value.ndim} dimensions."
            )
        found = [value.ctypes.data, *value.shape]
    return (found + [0] * SLOTS)[:SLOTS]


def table_of(*parts: Any) -> NDArray[np.int64]:
    """Return where all arrays lie; it holds while these live and are not replaced."""
    numbers = []
    for part, (kind, forms) in zip(parts, PARTS, strict=True):
        assert type(part) is kind
        for value, form in zip(part, forms.split(), strict=True):
            numbers += _numbers(form, value)
    return np.array(numbers)


def _type(form: str) -> Any:
    dtype, ndim = from_dtype(LETTERS[form[0]]), int(form[1])
    if form.endswith("tuple"):
        return types.UniTuple(dtype, ndim)
    return types.Array(dtype, ndim, "C") if ndim > 0 else dtype


def _types() -> Iterator[Any]:
    for kind, forms in PARTS:
        yield types.BaseTuple.from_types([_type(form) for form in forms.split()], kind)


@intrinsic
def opened(typing_context: Any, address: Any) -> Any:
    """Return the six parts whose table lies at an address."""
    word = ir.IntType(64)
    whole = types.Tuple(list(_types()))

    def array(context: Any, builder: Any, kind: Any, words: Any) -> Any:
        made = context.make_array(kind)(context, builder)
        item = word(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
        strides: list[Any] = []
        shape, step = words[1 : 1 + kind.ndim], item
        for length in reversed(shape):
            strides.insert(0, step)
            step = builder.mul(step, length)
        data = builder.inttoptr(words[0], made.data.type)
        populate_array(made, data, shape, strides, item, meminfo=None)
        return made._getvalue()

    def field(context: Any, builder: Any, kind: Any, words: Any) -> Any:
        if isinstance(kind, types.Array):
            return array(context, builder, kind, words)
        if isinstance(kind, types.UniTuple):
            return context.make_tuple(builder, kind, words[: kind.count])
        if kind == types.float64:
            return builder.bitcast(words[0], ir.DoubleType())
        return context.cast(builder, words[0], types.int64, kind)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        table, at, made = builder.inttoptr(arguments[0], word.as_pointer()), 0, []
        for part in whole:
            values = []
            for kind in part:
                words = [
                    builder.load(cgutils.gep_inbounds(builder, table, at + k)) for k in range(4)
                ]
                values.append(field(context, builder, kind, words))
                at += SLOTS
            made.append(context.make_tuple(builder, part, values))
        return context.make_tuple(builder, whole, made)

    return whole(types.int64), generate
