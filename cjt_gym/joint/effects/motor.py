"""Effects on the motor's torque and on the motion of the motor's side."""

from __future__ import annotations

from functools import partial

from cjt_gym.joint.effects.friction import DQ_0, FRICTION_EFFECTS
from cjt_gym.joint.effects.ripple import RIPPLE_EFFECTS
from cjt_gym.joint.effects.row import EffectParameter, effect, number, own_value
from cjt_gym.joint.effects.sources import CATALOGUE, EMPS, MACHINES, TOOLBOX

__all__ = ["DQ_0", "MOTOR_EFFECTS"]


def _thermal(
    symbol: str, unit: str, low: float, high: float, text: str, source: str, typical: float
) -> EffectParameter:
    return number(
        symbol, unit, high, text, f"heat_{symbol}", low=low, joint_parameter=source, typical=typical
    )


row = partial(effect, "motor")

MOTOR_EFFECTS = (
    row(
        "torque_constant",
        "Torque per ampere differs from nominal by a constant factor.",
        CATALOGUE,
        own_value("k_t", "N m/A", 1e-3, 20.0, "Torque constant that the motor really has", 0.9),
    ),
    row(
        "thermal_derating",
        "Torque per ampere falls, and resistance rises, as the windings warm (two stages).",
        f"{TOOLBOX}, parameters r_th1, r_th2, T_thw, T_thm, a_CU; {MACHINES}",
        number(
            "derating",
            "1/K",
            0.02,
            "Share of k_t that is lost per kelvin of the winding above ambient",
            "derating",
            typical=0.002,
        ),
        number(
            "a_CU",
            "1/K",
            0.01,
            "Rise of the winding resistance per kelvin",
            "heat_a_CU",
            joint_parameter="a_CU",
            default=0.0039,
        ),
        _thermal("r", "Ohm", 1e-3, 100.0, "Winding resistance when cold", "r", 0.3),
        _thermal("r_th1", "K/W", 0.01, 100.0, "Resistance winding to housing", "r_th1", 3.0),
        _thermal("r_th2", "K/W", 0.01, 100.0, "Resistance housing to ambient", "r_th2", 30.0),
        _thermal("T_thw", "s", 0.1, 1e4, "Time constant of the winding", "T_thw", 10.0),
        _thermal("T_thm", "s", 1.0, 1e5, "Time constant of the housing", "T_thm", 1000.0),
        number(
            "rise",
            "K",
            150.0,
            "Rise of the winding above ambient at the start",
            "heat_rise",
            default=0.0,
            typical=40.0,
        ),
        size=("derating",),
    ),
    row(
        "torque_offset",
        "A constant torque: offset of the amplifier or of the current sensor.",
        EMPS,
        number(
            "torque",
            "N m",
            5.0,
            "Constant torque on the motor",
            "torque_offset",
            low=-5.0,
            typical=0.005,
            typical_of="torque",
        ),
    ),
    row(
        "inertia",
        "Motor-side inertia differs from nominal.",
        CATALOGUE,
        own_value(
            "I_m", "kg m^2", 1e-4, 100.0, "Inertia that the rotor really has, link side", 1.2
        ),
        own_value("I_g", "kg m^2", 0.0, 100.0, "Inertia that the gear really has, link side"),
    ),
    *FRICTION_EFFECTS,
    *RIPPLE_EFFECTS,
)
