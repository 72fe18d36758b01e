"""Quantities moved between the motor's side of the gear and the link's.

Everything in this package is on the link side. With the transmission ratio n, motor turns per link
turn, a torque at the motor counts n times at the link, an angle or velocity 1/n times, and an
inertia, stiffness or damping n^2 times, so that powers and energies are the same on both sides.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from cjt_gym.errors import ParameterError, check_range
from cjt_gym.joint import Quantity

EXPONENTS: Mapping[str, int] = MappingProxyType(
    {
        "kg m^2": 2,
        "N m/rad": 2,
        "N m s/rad": 2,
        "N m": 1,
        "N m/A": 1,
        "rad": -1,
        "rad/s": -1,
        "rad/s^2": -1,
        "rad/(s N m)": -2,
        **dict.fromkeys(("A", "V", "W", "J", "s", "Hz", "Ohm", "H", "K/W", "degC", "-"), 0),
    }
)
"""Power of n by which a quantity of that unit grows from the motor's side to the link's."""


def to_link(quantity: Quantity, n: float) -> Quantity:
    """Return a quantity of the motor's side as it is on the link's.

    Args:
        quantity: Value with its unit; intervals are moved along.
        n: Transmission ratio, > 0 [-].

    Raises:
        ParameterError: The unit does not say how the quantity reflects.
        ConfigurationError: n is not positive.

    Example:
        >>> rotor = Quantity(3.59375e-5, "kg m^2")
        >>> round(to_link(rotor, 80.0).number, 12)
        0.23
    """
    return _scaled(quantity, n, 1)


def to_motor(quantity: Quantity, n: float) -> Quantity:
    """Return a quantity of the link's side as it is on the motor's; see `to_link`."""
    return _scaled(quantity, n, -1)


def _scaled(quantity: Quantity, n: float, sign: int) -> Quantity:
    check_range("The transmission ratio n", n, above=0.0)
    if quantity.unit not in EXPONENTS:
        raise ParameterError(
            f"A quantity in {quantity.unit} cannot be moved across the gear. Known units: "
            f"{', '.join(EXPONENTS)}."
        )
    factor = n ** (sign * EXPONENTS[quantity.unit])
    return quantity.converted(lambda x: factor * x, quantity.unit)
