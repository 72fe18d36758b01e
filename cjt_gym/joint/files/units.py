"""Units of joint files: any unit of the right dimension is converted to the standard one.

Angle is treated as a dimension, so that N m is not a stiffness and Hz not an angular velocity.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cjt_gym.errors import ParameterError
from cjt_gym.joint.files.quantity import Quantity

if TYPE_CHECKING:
    import pint

LONGEST = 64
"""Characters of a unit."""
_POWER = re.compile(r"\*\*|\^|[⁰¹²³⁴⁵⁶⁷⁸⁹]")
_POWER_OF_A_NAME = re.compile(r"(?<=[^\W\d_])(?:\s*(?:\*\*|\^)\s*\(?-?\d\)?|⁻?[⁰¹²³⁴⁵⁶⁷⁸⁹])")
_BARE_POWER = re.compile(r"(?<=m)2\b")
_INERTIA = re.compile(r"\b(k?g)(c?m)(?=\^|\*\*|²)")
_DEFINITIONS = (
    "radian = [angle] = rad",
    "newton_meter = newton * meter = Nm",
    "newton_meter_second = newton * meter * second = Nms",
    "newton_centimeter = newton * centimeter = Ncm",
    "@alias turn = rev = Umdrehung = Umdrehungen",
    "@alias degree = Grad",
    "@alias ohm = Ohm",
)


def in_usual_unit(quantity: Quantity, units: tuple[str, ...], owner: str) -> Quantity:
    """Return a quantity in one of `units`, the first of its kind; in its own if it is among them.

    Args:
        quantity: What was written.
        units: Units that are usual here, such as ("N m/rad",); "-" for a pure number.
        owner: What the quantity is and where it stands.

    Example:
        >>> in_usual_unit(Quantity(3.0, "mN m/A"), ("N m/A", "N m/V"), "k_t").value
        0.003
    """
    if quantity.unit in units:
        return quantity
    given = _parsed(quantity.unit)
    for unit in units:
        if given is not None and unit != "-" and given.is_compatible_with(_parsed(unit)):
            return _converted(quantity, unit)
    known = "" if given is not None else ", which does not exist"
    raise ParameterError(
        f"{owner} must be in {' or '.join(units)}, or in another unit of that kind, got the unit "
        f"'{quantity.unit}'{known}. Convert the value and write  unit = \"{units[0]}\"."
    )


def _converted(quantity: Quantity, unit: str) -> Quantity:
    def convert(value: float) -> float:
        return float(_registry().Quantity(value, _parsed(quantity.unit)).m_as(_parsed(unit)))

    return quantity.converted(convert, unit)


@cache
def _registry() -> pint.UnitRegistry[float]:
    """Return pint's units, loaded only when a file has a non-standard unit."""
    import pint

    # Begun empty: a registry that begins full has settled that an angle has no dimension.
    registry: pint.UnitRegistry[float] = pint.UnitRegistry(None, on_redefinition="ignore")
    registry.load_definitions(Path(pint.__file__).with_name("default_en.txt"))
    for definition in _DEFINITIONS:
        registry.define(definition)
    return registry


@cache
def _parsed(unit: str) -> Any:
    """Return pint's unit of that name, such as "gcm2" of a datasheet, or None."""
    unit = _INERTIA.sub(r"\1 \2", _BARE_POWER.sub("^2", unit))
    if len(unit) > LONGEST or _POWER.search(_POWER_OF_A_NAME.sub("", unit)):
        return None  # pint calculates powers of numbers, which may take for ever
    try:
        return _registry().parse_units(unit.replace("·", "*").replace("⋅", "*"))
    except Exception:  # whatever pint, its tokenizer and its arithmetic raise
        return None
