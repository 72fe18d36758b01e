"""The table of joint parameters: the only place where their units and ranges are written.

Symbols are those of the Compliant Joint Toolbox (its armature inductance `x` is `l_a` here).
Inertias, stiffnesses, dampings and friction levels are referred to the link side of the gear.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from cjt_gym.records.columns import COLUMNS

AXES = ("rotary", "prismatic")
SENSOR_KEYS = ("resolution", "noise")

# What a unit of a rotary joint becomes on a prismatic one.
_PRISMATIC: Mapping[str, str] = {
    "kg m^2": "kg",
    "N m/rad": "N/m",
    "N m s/rad": "N s/m",
    "N m": "N",
    "N m/A": "N/A",
    "N m/V": "N/V",
    "rad": "m",
    "rad/s": "m/s",
    "s/rad": "s/m",
    "rad/s^0.5": "m/s^0.5",
    "N m/rad^3": "N/m^3",
    "N m/rad^e": "N/m^e",
}
PER_METRE = "rad/m"
"""Unit of `n` where a rotary motor, whose torque constant is in N m/A, drives a prismatic axis."""
# Stands for a current where it is unknown, because the amplifier takes volts.
_VOLTS: Mapping[str, str] = {"N m/A": "N m/V", "A": "V"}


@dataclass(frozen=True)
class ParameterSpec:
    """A row of the table: unit, range and meaning of a parameter."""

    symbol: str  # its name in files and in code
    # units that are allowed, per kind of axis; the first one is the usual one
    units: Mapping[str, tuple[str, ...]]
    minimum: float  # smallest value [unit]
    exclusive: bool  # whether the minimum itself is forbidden
    description: str  # what it is, in words

    def allows(self, value: float) -> bool:
        """Return whether `value` [unit] is finite and within the range."""
        return math.isfinite(value) and (
            value > self.minimum if self.exclusive else value >= self.minimum
        )

    def range_text(self, axis: str) -> str:
        """Return the range in words with its unit, such as ``"> 0 N m/rad"``."""
        unit = " or ".join(self.units[axis])
        suffix = "" if unit == "-" else f" {unit}"
        return f"{'>' if self.exclusive else '>='} {self.minimum:g}{suffix}"


def _axis_units(unit: str) -> Mapping[str, tuple[str, ...]]:
    rotary = (unit, _VOLTS[unit]) if unit in _VOLTS else (unit,)
    prismatic = tuple(_PRISMATIC.get(each, each) for each in rotary)
    prismatic += rotary if unit == "N m/A" else ()
    return MappingProxyType({"rotary": rotary, "prismatic": prismatic})


def _rows(unit: str, lower: str, **descriptions: str) -> dict[str, ParameterSpec]:
    """Return rows that share a unit and a range; `lower` reads ">0", ">=0", ..."""
    exclusive = not lower.startswith(">=")
    minimum = float(lower.lstrip(">="))
    return {
        symbol: ParameterSpec(symbol, _axis_units(unit), minimum, exclusive, text)
        for symbol, text in descriptions.items()
    }


_TRANSMISSION = ParameterSpec(
    "n",
    MappingProxyType({"rotary": ("-",), "prismatic": ("-", PER_METRE)}),
    0.0,
    True,
    "transmission ratio, motor turns per link turn; rad/m of a rotary motor on a prismatic axis",
)

PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
    _rows(
        "kg m^2",
        ">=0",
        I_m="inertia of the rotor, reflected to the link side (rotor inertia times n squared)",
        I_g="inertia of the gear, reflected to the link side",
        I_l="inertia of the load; of the torsion bar alone where nothing is attached",
    )
    | _rows(
        "N m/rad",
        ">0",
        k_g="stiffness of the gearbox",
        k_b="stiffness of the torsion bar, whose deflection is the sensed torque",
    )
    | _rows(
        "N m s/rad",
        ">=0",
        d_m="viscous friction of the motor to ground; at positive velocity where d_m_n is used",
        d_g="viscous friction of the gear to ground; at positive velocity where d_g_n is used",
        d_l="viscous friction of the load to ground; at positive velocity where d_l_n is used",
        d_m_n="viscous friction of the motor at negative velocity",
        d_g_n="viscous friction of the gear at negative velocity",
        d_l_n="viscous friction of the load at negative velocity",
        d_mg="internal damping of the gearbox, acts on dq_m - dq_g",
        d_gl="internal damping of the torsion bar, acts on dq_g - dq_l",
    )
    | _rows(
        "N m",
        ">=0",
        d_cm="Coulomb friction of the motor; at positive velocity where d_cm_n is used",
        d_cg="Coulomb friction of the gear; at positive velocity where d_cg_n is used",
        d_cl="Coulomb friction of the load; at positive velocity where d_cl_n is used",
        d_cm_n="Coulomb friction of the motor at negative velocity",
        d_cg_n="Coulomb friction of the gear at negative velocity",
        d_cl_n="Coulomb friction of the load at negative velocity",
        d_s="breakaway torque",
    )
    | _rows("rad/s", ">=0", v_s="Stribeck velocity")
    | {"n": _TRANSMISSION}
    | _rows("-", ">=1", p="number of pole pairs")
    | _rows("N m/A", ">0", k_t="torque constant at the rotor; torque at the link is k_t n i")
    | _rows("Ohm", ">0", r="winding resistance at the nominal ambient temperature")
    | _rows("H", ">=0", l_a="winding inductance")
    | _rows("V", ">0", v_0="supply voltage, limit of the drive's output")
    | _rows("A", ">0", i_p="peak current")
    | _rows("rad/s", ">0", dq_p="peak velocity of the link")
    | _rows(
        "K/W",
        ">0",
        r_th1="thermal resistance, winding to housing",
        r_th2="thermal resistance, housing to ambient",
    )
    | _rows(
        "s",
        ">0",
        T_thw="thermal time constant of the winding",
        T_thm="thermal time constant of the housing",
    )
    | _rows(
        "degC",
        ">=-273.15",
        Tmp_WMax="highest winding temperature",
        Tmp_ANom="nominal ambient temperature",
    )
    | _rows("1/K", ">=0", a_CU="temperature coefficient of the winding resistance")
    | _rows("J/(kg K)", ">0", c_CU="specific heat of copper", c_FE="specific heat of iron")
    | _rows("mm", ">0", diam="outer diameter of the actuator", len="length of the actuator")
    | _rows("kg", ">0", m="mass of the actuator")
)

SAMPLING_KEYS = ("dt", "dt_electrical", "jitter")  # all in s

_SENSED = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau", "tau_l", "i", "v")


def axis_units(unit: str, axis: str) -> tuple[str, ...]:
    """Return the units that replace a unit of a rotary joint on this kind of axis."""
    return _axis_units(unit)[axis]


def sensor_units(axis: str) -> dict[str, tuple[str, ...]]:
    """Return the channels that a sensor may measure, with the units allowed on this axis."""
    return {channel: axis_units(COLUMNS[channel].units[0], axis) for channel in _SENSED}
