"""Characteristics of a joint: what torque, speed, power, heat and bandwidth its parameters allow.

`CHARACTERISTICS` is the table of single figures, `characteristics(p)` computes them. Curves and
maps are plain functions of parameters and a torque, velocity or frequency: `highest_speed`,
`efficiency`, `steady_temperature`, `time_to_critical`, `holding_time`, `torque_limits`,
`impedance_range`.

They follow from the parameters alone; `acting` gives those of a joint file with its effects, such
as the friction that a diagnosis found.
"""

from cjt_gym.characteristics.acting import acting, changing, with_effects
from cjt_gym.characteristics.bandwidth import (
    TorqueLimits,
    back_emf_limit,
    response,
    torque_bandwidth,
    torque_limits,
)
from cjt_gym.characteristics.holding import holding_map, holding_time
from cjt_gym.characteristics.impedance import ImpedanceRange, impedance_range
from cjt_gym.characteristics.motor import (
    best_efficiency,
    best_point,
    coulomb,
    efficiency,
    friction,
    highest_speed,
    speed_at_torque,
    viscous,
)
from cjt_gym.characteristics.reflection import to_link, to_motor
from cjt_gym.characteristics.table import (
    CHARACTERISTICS,
    Characteristic,
    characteristic,
    characteristics,
)
from cjt_gym.characteristics.thermal import (
    rms,
    steady_temperature,
    temperatures,
    time_to_critical,
)
from cjt_gym.joint.linear import resonance

__all__ = [
    "CHARACTERISTICS",
    "Characteristic",
    "ImpedanceRange",
    "TorqueLimits",
    "acting",
    "back_emf_limit",
    "best_efficiency",
    "best_point",
    "changing",
    "characteristic",
    "characteristics",
    "coulomb",
    "efficiency",
    "friction",
    "highest_speed",
    "holding_map",
    "holding_time",
    "impedance_range",
    "resonance",
    "response",
    "rms",
    "speed_at_torque",
    "steady_temperature",
    "temperatures",
    "time_to_critical",
    "to_link",
    "to_motor",
    "torque_bandwidth",
    "torque_limits",
    "viscous",
    "with_effects",
]
