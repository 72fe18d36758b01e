"""The validated parameters of one joint.

Units and ranges come from `PARAMETERS`; a joint file is read by `cjt_gym.joint.files.joint_file`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace

from cjt_gym.errors import ParameterError, check_name, did_you_mean, unknown_key
from cjt_gym.joint.files.mistakes import Mistakes
from cjt_gym.joint.files.parameter_table import AXES, PARAMETERS, PER_METRE
from cjt_gym.joint.files.quantity import FrozenMapping, Quantity, Setting
from cjt_gym.joint.files.units import in_usual_unit

__all__ = ["PARAMETERS", "JointParameters", "Quantity", "content_of", "sha256_of"]

SET_IN_PYTHON = "set in Python"
"""Source of a value that names none."""
ASYMMETRY_FACTOR = 3.0
"""Between both directions of a friction; more is a slip of a digit unless it is declared."""


@dataclass(frozen=True, eq=False)
class JointParameters:
    """The validated parameters of one joint; ``p.k_b`` is the value of k_b.

    Two sets are equal if their kind of axis, values and units are; names and sources do not matter.

    Attributes:
        name: Name of the joint.
        source: Where the joint comes from.
        quantities: Value, unit and source by symbol; see `PARAMETERS` for the symbols.
        axis: "rotary" or "prismatic".
        origin: File or other place that the values come from, for messages.

    Raises:
        ParameterError: A symbol is unknown, or a value has a wrong unit, is out of range, or
            differs silently from its partner for the other direction.

    Example:
        >>> p = JointParameters.from_values("mine", {"k_b": 6000.0})
        >>> p.k_b, "k_g" in p, p.get("d_l", 0.0)
        (6000.0, False, 0.0)
    """

    name: str
    source: str
    quantities: Mapping[str, Quantity]
    axis: str = "rotary"
    origin: str = "values given in Python"

    def __post_init__(self) -> None:
        if self.axis not in AXES:
            raise ParameterError(
                f'axis of {self.origin} must be "rotary" or "prismatic", got {self.axis!r}.'
            )
        quantities = check_quantities(self.quantities, self.axis, self.origin)
        object.__setattr__(self, "quantities", FrozenMapping(quantities))
        _check_amplifier(self)

    def __repr__(self) -> str:
        values = (f"{s} = {q.value:.6g} {q.unit}" for s, q in self.quantities.items())
        return f"<JointParameters {self.name}: {', '.join(values)}>"

    @classmethod
    def from_values(
        cls,
        name: str,
        values: Mapping[str, float],
        axis: str = "rotary",
        source: str = SET_IN_PYTHON,
    ) -> JointParameters:
        """Return parameters from bare numbers, each in the usual unit of its symbol."""
        quantities = {
            symbol: _in_usual_unit(symbol, value, axis, source) for symbol, value in values.items()
        }
        return cls(name=name, source=source, quantities=quantities, axis=axis)

    def __getattr__(self, symbol: str) -> float:
        """Return the value of a parameter [its unit].

        Raises:
            ParameterError: The joint does not have the parameter.
            AttributeError: There is no such parameter at all.
        """
        if symbol not in PARAMETERS:
            raise AttributeError(
                f"JointParameters has no '{symbol}'.{did_you_mean(symbol, PARAMETERS)}"
            )
        if symbol not in self.quantities:
            unit = PARAMETERS[symbol].units[self.axis][0]
            raise ParameterError(
                f"{symbol} of {self.origin} is needed and absent; "
                f'add  {symbol} = {{ value = ..., unit = "{unit}" }}  under [parameters] '
                f"({PARAMETERS[symbol].description})."
            )
        return self.quantities[symbol].number

    def __contains__(self, symbol: object) -> bool:
        return symbol in self.quantities

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, JointParameters):
            return NotImplemented
        return self.content() == other.content()

    def __hash__(self) -> int:
        return hash(self.hash_hex())

    def get(self, symbol: str, default: float) -> float:
        """Return the value of a parameter [its unit], or `default` where the joint has none.

        Raises:
            UnknownNameError: There is no such parameter at all.
        """
        check_name("parameter", symbol, PARAMETERS)
        return self.quantities[symbol].number if symbol in self.quantities else default

    def unit(self, symbol: str) -> str:
        """Return the unit of a parameter; the usual one where the joint does not have it.

        Raises:
            UnknownNameError: There is no such parameter at all.
        """
        check_name("parameter", symbol, PARAMETERS)
        quantity = self.quantities.get(symbol)
        return PARAMETERS[symbol].units[self.axis][0] if quantity is None else quantity.unit

    @property
    def takes_volts(self) -> bool:
        """Whether the joint has no current: its gain k_t is torque per volt of an amplifier."""
        return self.unit("k_t").endswith("/V")

    def replace(self, /, **values: float | Quantity) -> JointParameters:
        """Return a copy with other values; a bare number keeps the unit that the parameter has.

        A negative-direction value (..._n) that is not given changes by the factor by which its
        partner does.

        Raises:
            ParameterError: As for the constructor.
        """
        quantities = dict(self.quantities)
        for symbol, value in values.items():
            quantities[symbol] = (
                value if isinstance(value, Quantity) else self._revalued(symbol, value)
            )
        for symbol in values:
            if f"{symbol}_n" in self.quantities and f"{symbol}_n" not in values:
                quantities[f"{symbol}_n"] = self._following(symbol, quantities[symbol])
        return JointParameters(self.name, self.source, quantities, self.axis, self.origin)

    def _revalued(self, symbol: str, value: float) -> Quantity:
        new = _in_usual_unit(symbol, value, self.axis, SET_IN_PYTHON)
        old = self.quantities.get(symbol)
        if old is None:
            return new
        return replace(old, value=new.value, source=new.source, low=None, high=None)

    def _following(self, symbol: str, partner: Quantity) -> Quantity:
        """Return the negative-direction value that goes with another positive-direction one."""
        negative, before = self.quantities[f"{symbol}_n"], self.quantities[symbol].number
        partner = in_usual_unit(partner, (negative.unit,), f"{symbol} of {self.origin}")
        ratio = negative.number / before if before > 0.0 else 1.0
        return replace(partner, value=partner.number * ratio, asymmetric=negative.asymmetric)

    def content(self) -> dict[str, object]:
        """Return what identifies a set: the axis, and value and unit of every parameter."""
        return {
            "axis": self.axis,
            "parameters": {s: content_of(q) for s, q in self.quantities.items()},
        }

    def hash_hex(self) -> str:
        """Return the SHA-256 of `content`, in hexadecimal."""
        return sha256_of(self.content())


def _in_usual_unit(symbol: str, value: float, axis: str, source: str) -> Quantity:
    if symbol not in PARAMETERS:
        raise ParameterError(
            f"There is no parameter '{symbol}'.{did_you_mean(symbol, PARAMETERS)} "
            f"Known: {', '.join(PARAMETERS)}."
        )
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ParameterError(f"{symbol} must be a number, got {value!r}.") from None
    return Quantity(number + 0.0, PARAMETERS[symbol].units[axis][0], source)


def check_quantities(
    quantities: Mapping[str, Quantity], axis: str, origin: str, is_whole: bool = True
) -> dict[str, Quantity]:
    """Return the parameters of a joint in their usual units.

    Args:
        quantities: Value, unit and source by symbol.
        axis: "rotary" or "prismatic".
        origin: Where they come from, for messages.
        is_whole: Whether none is missing because of a mistake, so that they are held against each
            other, too.
    """
    mistakes, checked = Mistakes(origin), {}
    for symbol, quantity in quantities.items():
        with mistakes.collected():
            checked[symbol] = _checked_quantity(symbol, quantity, axis, origin)
    for symbol in checked if is_whole and not mistakes.found else ():
        if symbol.endswith("_n"):
            with mistakes.collected():
                _check_partner(symbol, checked, origin)
    if axis == "prismatic" and {"n", "k_t"} <= checked.keys():
        with mistakes.collected():
            _check_motor(checked, origin)
    mistakes.check()
    return checked


def _checked_quantity(symbol: str, quantity: Quantity, axis: str, origin: str) -> Quantity:
    if symbol not in PARAMETERS:
        raise ParameterError(unknown_key(origin, symbol, PARAMETERS, "parameter"))
    spec, owner = PARAMETERS[symbol], f"{symbol} of {origin}"
    quantity = in_usual_unit(quantity, spec.units[axis], owner)
    if isinstance(quantity.value, tuple):
        raise ParameterError(f"{owner} must be one number, got the list {list(quantity.value)}.")
    if not spec.allows(quantity.value):
        raise ParameterError(f"{owner} must be {spec.range_text(axis)}, got {quantity.value:.10g}.")
    if quantity.asymmetric and not symbol.endswith("_n"):
        raise ParameterError(
            f"{owner} carries asymmetric = true, which belongs to a "
            "negative-direction value (..._n) only. Remove it."
        )
    return quantity


def _check_partner(symbol: str, quantities: Mapping[str, Quantity], origin: str) -> None:
    """Reject an undeclared difference of more than a factor 3 between the two directions."""
    negative = quantities[symbol]
    if negative.asymmetric:
        return
    partner = symbol.removesuffix("_n")
    remedy = f"Correct one of them, or add  asymmetric = true  to {symbol} if it is meant."
    if partner not in quantities:
        raise ParameterError(
            f"{symbol} of {origin} is given but its partner {partner} is absent. {remedy}"
        )
    low, high = sorted((negative.number, quantities[partner].number))
    if high > ASYMMETRY_FACTOR * low:
        raise ParameterError(
            f"{symbol} of {origin} must lie within a factor {ASYMMETRY_FACTOR:g} of {partner} "
            f"= {quantities[partner].number:.10g} {negative.unit}, "
            f"got {negative.number:.10g}. {remedy}"
        )


def _check_motor(quantities: Mapping[str, Quantity], origin: str) -> None:
    """Reject a torque constant of a rotary motor behind a ratio without unit, and vice versa."""
    n, k_t = (quantities[symbol].unit for symbol in ("n", "k_t"))
    if (n == PER_METRE) != k_t.startswith("N m/"):
        raise ParameterError(
            f"n and k_t of {origin} must be those of one motor: n in {PER_METRE} with k_t in N m/A "
            f"(or N m/V) of a rotary one, or n in - with N/A (or N/V), got '{n}' with '{k_t}'. "
            "For a screw or a pinion n is 2 pi rad over the travel per turn."
        )


def _check_amplifier(p: JointParameters) -> None:
    """Reject a limit in volts for a gain per ampere, and vice versa."""
    if "k_t" in p and "i_p" in p and p.takes_volts != (p.unit("i_p") == "V"):
        unit = "V" if p.takes_volts else "A"
        raise ParameterError(
            f"i_p of {p.origin} must be in {unit}, as k_t is in {p.unit('k_t')}, got the unit "
            f"'{p.unit('i_p')}'. State both per ampere or both per volt."
        )


def content_of(value: Setting) -> object:
    """Return the parts of a setting that affect a simulation; for a quantity, value and unit."""
    return [value.value, value.unit] if isinstance(value, Quantity) else value


def sha256_of(content: Mapping[str, object]) -> str:
    """Return the SHA-256 of nested plain data, in hexadecimal, whatever the order of keys."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
