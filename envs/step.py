"""A whole step of an environment in one compiled call: command, joints, reward, observation.

Handing the arrays of joints and episodes over to compiled code costs more than a step of one
joint. So they are handed over once: `table_of` notes where each lies, in a table of numbers, and
the compiled step takes nothing but the address of that table.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype
from numba.np import arrayobj
from numpy.typing import NDArray

from cjt_gym.envs.observe import SAFETY, TERMS, Task, conclude_one, rotor_angle
from cjt_gym.joint.arrays import TAU, Batch, Floats, Setup
from cjt_gym.joint.blocks import Blocks, advance
from cjt_gym.joint.compiled import inlined, threaded
from cjt_gym.joint.configure import PARAMETER_DTYPE
from cjt_gym.joint.lanes import COSINE, SINE, Kind
from cjt_gym.joint.vector_math import sine_cosine
from cjt_gym.joint.vectors import WIDTH, cgutils, get, intrinsic, ir, put, types

populate_array: Any = arrayobj.populate_array

BAD_ACTION = -1
REPORT = (
    *("tau", "tau_measured", "tau_reference", "tau_command", "base_action", "residual"),
    *(f"reward/{name}" for name in TERMS),
)


class Control(NamedTuple):
    """What a step is told and what it reports.

    Attributes:
        action: In [-1, 1], shape (n,); values outside are clipped.
        base: Motor torque of the base controller, shape (n,) [N m].
        residual: Motor torque of the action, shape (n,) [N m].
        wanted: Both, within the limits, shape (n,) [N m].
        commands: The same as currents [A], shape (n, 2).
        report: Columns of `REPORT`, shape (1, 11) for a single episode, else (0, 11).
        factors: [action scale, torque limit, torque per ampere].
    """

    action: Floats
    base: Floats
    residual: Floats
    wanted: Floats
    commands: Floats
    report: Floats
    factors: Floats


def make_control(num: int, action_scale: float, limit: float, torque_per_ampere: float) -> Control:
    """Allocate for `num` episodes."""
    return Control(
        action=np.zeros(num),
        base=np.zeros(num),
        residual=np.zeros(num),
        wanted=np.zeros(num),
        commands=np.zeros((num, 2)),
        report=np.zeros((1 if num == 1 else 0, len(REPORT))),
        factors=np.array([action_scale, limit, torque_per_ampere]),
    )


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
    (Kind, "i0 i0 i0 i0 i0 i0 i0 i0"),
    (Blocks, "d3 d3 b1 b1 d3"),
    (Task, "d2 d2 d2 d2 i2 i2 d2 d2 i2 u2 d2 d1 d1 d1 f2 f2 d1 d2 b1 b1 d1 d1 i0 i0"),
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
    """Return where all arrays lie; it holds while these live and are not replaced.

    Args:
        parts: Batch, Setup, Kind, Blocks, Task, Control.

    Raises:
        TypeError: An array is not what the compiled step takes it for.
    """
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


@inlined
def command(control: Control, i: int) -> bool:
    """Turn action and base of episode i into a current; return whether the action is finite."""
    action, scale, limit = control.action[i], control.factors[0], control.factors[1]
    if not math.isfinite(action):
        return False
    control.residual[i] = min(max(action, -1.0), 1.0) * scale
    control.wanted[i] = min(max(control.base[i] + control.residual[i], -limit), limit)
    control.commands[i, 0] = control.wanted[i] / control.factors[2]
    return True


@inlined
def tell(batch: Batch, task: Task, control: Control, i: int, sine: float, cosine: float) -> None:
    """Conclude the step of episode i, with sine and cosine of its rotor; report a single one."""
    conclude_one(batch, task, i, control.wanted[i], sine, cosine)
    if control.report.shape[0] == 0:
        return
    report = control.report[i]
    report[0], report[1] = batch.tau[i], batch.measured[i, TAU]
    report[2], report[3] = task.reference[i], task.command[i]
    report[4], report[5] = control.base[i], control.residual[i]
    for j in range(SAFETY + 1):
        report[6 + j] = task.terms[i, j]


@threaded
def command_all(control: Control) -> bool:
    """Turn all actions and bases into currents; return whether the actions are finite."""
    good = True
    for i in range(control.action.shape[0]):
        good = command(control, i) and good
    return good


@threaded
def step_blocks(address: int, begin: int, end: int, thread: int) -> int:
    """Step the episodes of blocks begin to end.

    A call for all blocks turns actions into commands first; one for some finds them there.

    Args:
        address: Where the table of `table_of` lies.
        begin: First block.
        end: Behind the last block.
        thread: Whose scratch to use.

    Returns:
        How many joints it left to the general kernel, whose episodes it then has not concluded,
        or `BAD_ACTION` before anything has moved.
    """
    batch, setup, kind, blocks, task, control = opened(address)
    s, left, num = blocks.scratch[thread], 0, task.load.shape[0]
    if end - begin == blocks.rows.shape[0] and not command_all(control):
        return BAD_ACTION
    for block in range(begin, end):
        left += advance(
            batch, setup, kind, blocks, control.commands, task.load, block, block + 1, thread
        )
        first = block * WIDTH
        count = min(WIDTH, num - first)
        for lane in range(count):
            s[SINE, lane] = rotor_angle(batch, task, first + lane)
        sine, cosine = sine_cosine(get(s, SINE))
        put(s, SINE, sine)
        put(s, COSINE, cosine)
        for lane in range(count):
            if not blocks.left[first + lane]:
                tell(batch, task, control, first + lane, s[SINE, lane], s[COSINE, lane])
    return left


@threaded
def tell_some(batch: Batch, task: Task, control: Control, mask: NDArray[np.bool_]) -> None:
    """Conclude the steps of the episodes in a mask."""
    for i in range(mask.shape[0]):
        if mask[i]:
            angle = rotor_angle(batch, task, i)
            tell(batch, task, control, i, math.sin(angle), math.cos(angle))
