"""Torques that are periodic in the angle of the motor."""

from __future__ import annotations

from functools import partial

from cjt_gym.joint.effects.row import EffectParameter, effect, number
from cjt_gym.joint.effects.sources import CURRENT_ERRORS, MACHINES, TOOLBOX

_RIPPLE = f"{TOOLBOX}, section Torque Ripple"


def _ripple(unit: str, scale: str, base: str, typical: float) -> tuple[EffectParameter, ...]:
    of, high = ("torque", 5.0) if unit == "N m" else ("", 0.1)
    text = f"Periods per revolution of q_m ({base})"
    return (
        number("f", "1/rev", 1e4, text, low=0.5, series=True, typical=(1.0, 6.0), typical_of="n"),
        *(
            number(
                symbol,
                unit,
                high,
                f"Amplitudes of {wave}(f q_m)",
                low=-high,
                series=True,
                typical=(first * typical, second * typical),
                typical_of=of,
            )
            for symbol, wave, first, second in (("a", "cos", 1.0, 0.3), ("b", "sin", -0.5, 0.2))
        ),
        number("scale", "-", 2.0, "Factor on all amplitudes", scale, default=1.0, typical=1.0),
    )


row = partial(effect, "motor")

RIPPLE_EFFECTS = (
    row(
        "cogging",
        "Torque periodic in the rotor angle: sum_j a_j cos(f_j q_m) + b_j sin(f_j q_m).",
        f"{_RIPPLE} (type 1)",
        *_ripple("N m", "cogging_scale", "the k-th harmonic of the rotor is n k", 0.01),
        size=("a", "b"),
    ),
    row(
        "gear_ripple",
        "The same series times the transmitted torque: the meshing of teeth.",
        f"{_RIPPLE} (type 2)",
        *_ripple("-", "gear_ripple_scale", "the k-th harmonic of the rotor is n k", 0.02),
        size=("a", "b"),
    ),
    row(
        "commutation_ripple",
        "The same series times the torque of the current: harmonics of the back-EMF.",
        MACHINES,
        *_ripple("-", "commutation_scale", "multiples of 6 p n for three phases", 0.02),
        size=("a", "b"),
    ),
    row(
        "current_offset",
        "Offsets of the phase current sensors: torque at the electrical frequency p n.",
        CURRENT_ERRORS,
        *(
            number(
                symbol,
                "A",
                5.0,
                f"Amplitude of {wave}(p n q_m)",
                f"offset_{symbol}",
                low=-5.0,
                default=0.0,
                typical=typical,
                typical_of="current",
            )
            for symbol, wave, typical in (("a", "cos", 0.005), ("b", "sin", 0.003))
        ),
        number(
            "p",
            "-",
            50.0,
            "Number of pole pairs",
            "offset_p",
            low=1.0,
            joint_parameter="p",
            typical=6.0,
        ),
        size=("a", "b"),
    ),
)
