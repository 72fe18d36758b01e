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

UNITS: Final[dict[str, Unit]] = {
    "s": Unit("s", 1.0),
    "ms": Unit("s", 1e-3),
    "us": Unit("s", 1e-6),
    "ns": Unit("s", 1e-9),
    "min": Unit("s", 60.0),
    "rad": Unit("rad", 1.0),
    "mrad": Unit("rad", 1e-3),
    "deg": Unit("rad", pi / 180.0),
    "rev": Unit("rad", 2.0 * pi),
    "counts": Unit("rad", 2.0 * pi),
    "rad/s": Unit("rad/s", 1.0),
    "deg/s": Unit("rad/s", pi / 180.0),
    "rev/s": Unit("rad/s", 2.0 * pi),
    "rpm": Unit("rad/s", 2.0 * pi / 60.0),
    "counts/s": Unit("rad/s", 2.0 * pi),
    "m": Unit("m", 1.0),
    "mm": Unit("m", 1e-3),
    "um": Unit("m", 1e-6),
    "m/s": Unit("m/s", 1.0),
    "mm/s": Unit("m/s", 1e-3),
    "A": Unit("A", 1.0),
    "mA": Unit("A", 1e-3),
    "V": Unit("V", 1.0),
    "mV": Unit("V", 1e-3),
    "N m": Unit("N m", 1.0),
    "Nm": Unit("N m", 1.0),
    "mN m": Unit("N m", 1e-3),
    "mNm": Unit("N m", 1e-3),
    "N cm": Unit("N m", 1e-2),
    "Ncm": Unit("N m", 1e-2),
    "N": Unit("N", 1.0),
    "mN": Unit("N", 1e-3),
    "kN": Unit("N", 1e3),
    "degC": Unit("degC", 1.0),
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


def unit_of(column: str, name: str, what: str) -> Unit:
    """Return a unit of a column by its name."""
    allowed = units_of(column)
    if name not in allowed:
        raise RecordError(
            f"{what} must be {' or '.join(map(repr, allowed))}, got {name!r}."
            f"{did_you_mean(name, allowed)}"
        )
    return UNITS[name]
