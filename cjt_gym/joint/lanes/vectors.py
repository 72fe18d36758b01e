"""Vectors of numbers, one per joint, that compiled code uses as if they were floats.

`Lanes` is a vector of WIDTH doubles and `Mask` one of WIDTH conditions. Arithmetic and comparisons
act lane by lane, also between a vector and a float, and so do `&`, `|` and `~` of conditions;
`choose` takes the place of a branch. LLVM
splits a vector over as many registers as the processor needs. In Python such a value does not
exist: it is read from a row of an array by `get`, and `put` writes it back.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import llvmlite.ir
import numba.core.cgutils
import numba.core.types
import numba.core.typing.templates
import numba.extending

ir: Any = llvmlite.ir  # these libraries have no types
cgutils: Any = numba.core.cgutils
types: Any = numba.core.types
templates: Any = numba.core.typing.templates
extending: Any = numba.extending
models: Any = numba.extending.models

WIDTH = 16  # doubles: two registers of the widest processors
DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
INTEGERS = ir.VectorType(ir.IntType(64), WIDTH)
BITS = ir.VectorType(ir.IntType(1), WIDTH)


def intrinsic(function: Callable[..., Any]) -> Any:
    """Let compiled code call what writes instructions of LLVM itself."""
    return extending.intrinsic(function)


class LanesType(types.Type):  # type: ignore[misc]
    """The type of a vector of numbers."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes{WIDTH}")


class MaskType(types.Type):  # type: ignore[misc]
    """The type of a vector of conditions."""

    def __init__(self) -> None:
        super().__init__(name=f"Mask{WIDTH}")


LANES, MASK, FLOAT = LanesType(), MaskType(), types.float64


@extending.register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, which: Any) -> None:
        super().__init__(manager, which, DOUBLES)


@extending.register_model(MaskType)
class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, which: Any) -> None:
        super().__init__(manager, which, BITS)


def _spread(builder: Any, value: Any) -> Any:
    """Put a number into all lanes; a vector stays what it is."""
    if value.type in (DOUBLES, BITS):
        return value
    if isinstance(value, ir.Constant):
        return ir.Constant(DOUBLES, [value.constant] * WIDTH)
    first = builder.insert_element(ir.Constant(DOUBLES, ir.Undefined), value, ir.IntType(32)(0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, ir.Constant(DOUBLES, ir.Undefined), order)


NUMBERS = ((LANES, LANES), (LANES, FLOAT), (FLOAT, LANES))


def _define(
    function: Any,
    result: Any,
    write: Callable[..., Any],
    kinds: tuple[tuple[Any, ...], ...] = NUMBERS,
) -> None:
    """Teach Numba an operator of vectors, or of a vector and a float."""

    class Template(templates.ConcreteTemplate):  # type: ignore[misc]
        cases = [templates.signature(result, *kind) for kind in kinds]  # noqa: RUF012

    def lower(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        return write(builder, *(_spread(builder, x) for x in arguments))

    templates.infer_global(function)(Template)
    for kind in kinds:
        extending.lower_builtin(function, *kind)(lower)


def _call(builder: Any, name: str, *arguments: Any) -> Any:
    """Call a function of LLVM on vectors."""
    kind = ir.FunctionType(DOUBLES, [DOUBLES] * len(arguments))
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")
    return builder.call(function, arguments)


_define(operator.add, LANES, lambda builder, a, b: builder.fadd(a, b))
_define(operator.sub, LANES, lambda builder, a, b: builder.fsub(a, b))
_define(operator.mul, LANES, lambda builder, a, b: builder.fmul(a, b))
_define(operator.truediv, LANES, lambda builder, a, b: builder.fdiv(a, b))
_define(operator.lt, MASK, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_define(operator.le, MASK, lambda builder, a, b: builder.fcmp_ordered("<=", a, b))
_define(operator.gt, MASK, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_define(operator.ge, MASK, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))
_define(operator.eq, MASK, lambda builder, a, b: builder.fcmp_ordered("==", a, b))
_define(operator.ne, MASK, lambda builder, a, b: builder.fcmp_unordered("!=", a, b))
_define(operator.and_, MASK, lambda builder, a, b: builder.and_(a, b), ((MASK, MASK),))
_define(operator.or_, MASK, lambda builder, a, b: builder.or_(a, b), ((MASK, MASK),))
_define(operator.invert, MASK, lambda builder, a: builder.not_(a), ((MASK,),))
_define(abs, LANES, lambda builder, a: _call(builder, "fabs", a), ((LANES,),))


def _row(context: Any, builder: Any, array_type: Any, array: Any, row: Any) -> Any:
    """Return where a row of an array of WIDTH columns lies."""
    data = context.make_array(array_type)(context, builder, array).data
    start = builder.gep(data, [builder.mul(row, ir.IntType(64)(WIDTH))])
    return builder.bitcast(start, DOUBLES.as_pointer())


def _is_block(array: Any) -> bool:
    return bool(array.dtype == FLOAT and array.ndim == 2 and array.layout == "C")


@intrinsic
def get(typing_context: Any, block: Any, row: Any) -> Any:
    """Return a row of an array of shape (rows, WIDTH)."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        place = _row(context, builder, block, *arguments)
        return builder.load(place, align=8)

    return (LANES(block, types.int64), generate) if _is_block(block) else None


@intrinsic
def put(typing_context: Any, block: Any, row: Any, value: Any) -> Any:
    """Write a vector, or a float into all lanes of a row."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        place = _row(context, builder, block, *arguments[:2])
        builder.store(_spread(builder, arguments[2]), place, align=8)
        return context.get_dummy_value()

    return (types.void(block, types.int64, value), generate) if _is_block(block) else None


@intrinsic
def choose(typing_context: Any, mask: Any, first: Any, second: Any) -> Any:
    """Return the first value where a condition holds, else the second."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        here, *values = arguments
        return builder.select(here, *(_spread(builder, x) for x in values))

    return LANES(MASK, first, second), generate


@intrinsic
def somewhere(typing_context: Any, mask: Any) -> Any:
    """Return whether a condition holds in any lane."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        word = ir.IntType(WIDTH)
        return builder.icmp_unsigned("!=", builder.bitcast(arguments[0], word), word(0))

    return types.boolean(MASK), generate


@intrinsic
def madd(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a b + c, rounded once where the processor can."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        return _call(builder, "fmuladd", *(_spread(builder, x) for x in arguments))

    return LANES(a, b, c), generate


@intrinsic
def least(typing_context: Any, a: Any, b: Any) -> Any:
    """Return the smaller of a vector and a bound; the bound in place of NaN."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        left, right = (_spread(builder, x) for x in arguments)
        return builder.select(builder.fcmp_ordered("<", left, right), left, right)

    return LANES(LANES, b), generate


@intrinsic
def power_of_two(typing_context: Any, shifted: Any) -> Any:
    """Return 2^k for the whole number k in the low bits of a shifted number."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        bits = builder.bitcast(arguments[0], INTEGERS)
        bias, mantissa = (ir.Constant(INTEGERS, [x] * WIDTH) for x in (1023, 52))
        return builder.bitcast(builder.shl(builder.add(bits, bias), mantissa), DOUBLES)

    return LANES(LANES), generate


@intrinsic
def has_bit(typing_context: Any, shifted: Any, bit: Any) -> Any:
    """Return where the whole number in the low bits of a shifted number has a bit (1, 2, ...)."""
    value = getattr(bit, "literal_value", None)
    if value is None:
        return None

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        bits = builder.bitcast(arguments[0], INTEGERS)
        wanted, none = (ir.Constant(INTEGERS, [x] * WIDTH) for x in (value, 0))
        return builder.icmp_unsigned("!=", builder.and_(bits, wanted), none)

    return MASK(LANES, bit), generate
