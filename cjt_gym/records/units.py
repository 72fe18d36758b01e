"""The units that logs come in, and the SI units they turn into."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final

from cjt_gym.errors import RecordError, did_you_mean
from cjt_gym.records.columns import column_of


@dataclass(frozen=True)
class Unit:
    """A unit of a log: the SI unit of a record that it turns into, and what one of it is there.

    The factor of counts is that of one revolution, still to be divided by the counts of one.
    """

    si: str
    factor: float


COUNTS: Final = ("counts", "counts/s")
"""Units that need the counts per revolution."""

FACTORS: Final = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": pi / 180.0, "rev": 2.0 * pi, "counts": 2.0 * pi},
    "rad/s": {
        "rad/s": 1.0,
        "deg/s": pi / 180.0,
        "rev/s": 2.0 * pi,
        "rpm": 2.0 * pi / 60.0,
        "counts/s": 2.0 * pi,
    },
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3},
    "A": {"A": 1.0, "mA": 1e-3},
    "V": {"V": 1.0, "mV": 1e-3},
    "N m": {"N m": 1.0, "Nm": 1.0, "mN m": 1e-3, "mNm": 1e-3, "N cm": 1e-2, "Ncm": 1e-2},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "degC": {"degC": 1.0},
}
"""What one of each unit is in the SI unit."""
WORDS: Final = {
    "deg": ("Grad", "degree", "degrees", "°", "º"),
    "deg/s": ("Grad/s", "degrees/s", "°/s", "º/s"),
    "rad": ("radian", "radians"),
    "rev": ("Umdrehung", "Umdrehungen", "turn", "turns", "revolutions"),
    "rev/s": ("U/s",),
    "rpm": ("U/min", "Umdrehungen/min", "rev/min", "r/min", "1/min", "RPM"),
    "us": ("µs", "μs"),
    "um": ("µm", "μm"),
    "degC": ("°C", "ºC"),
}
"""Other words for these units, which logs use as well."""
USUAL: Final = {word: name for name, words in WORDS.items() for word in words}
GON: Final = "'grad' may be degrees or gon. Degrees are 'deg'."
UNITS: Final = {
    name: Unit(si, factor) for si, names in FACTORS.items() for name, factor in names.items()
}


def units_of(column: str) -> tuple[str, ...]:
    """Return the units in which a log may hold a column.

    Example:
        >>> units_of("t")
        ('s', 'ms', 'us', 'ns', 'min')

    Raises:
        RecordError: A record holds no such column.
    """
    allowed = column_of(column).units
    return tuple(name for name, unit in UNITS.items() if unit.si in allowed)


def usual_name(word: str) -> str:
    """Return the name in `UNITS` of what a log calls a unit; the word itself if there is none.

    Example:
        >>> usual_name("U/min"), usual_name("rpm")
        ('rpm', 'rpm')
    """
    return USUAL.get(word, word)


def unit_of(column: str, name: str, what: str) -> Unit:
    """Return a unit of a column by its name."""
    allowed = units_of(column)
    if name not in allowed:
        raise RecordError(
            f"{what} must be {' or '.join(map(repr, allowed))}, got {name!r}.{_hint(name, allowed)}"
        )
    return UNITS[name]


def _hint(name: str, allowed: tuple[str, ...]) -> str:
    """Return what was meant, after a sentence; nothing for a unit of another kind."""
    if name.lower().partition("/")[0] == "grad":
        return f" {GON}"
    return "" if name in UNITS else did_you_mean(name, allowed)
