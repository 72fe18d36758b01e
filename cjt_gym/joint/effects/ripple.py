"""Torques that are periodic in the angle of the motor."""

from __future__ import annotations

from cjt_gym.joint.effects.row import Effect, EffectParameter
from cjt_gym.joint.effects.sources import CURRENT_ERRORS, MACHINES, TOOLBOX

_RIPPLE = f"{TOOLBOX}, section Torque Ripple"


def _ripple(unit: str, scale: str, base: str, typical: float) -> tuple[EffectParameter, ...]:
    of, high = ("torque", 5.0) if unit == "N m" else ("", 0.1)
    text = f"Periods per revolution of q_m ({base})"
    return (
        EffectParameter(
            "f", "1/rev", 0.0, 0.5, 1e4, text, series=True, typical=(1.0, 6.0), typical_of="n"
        ),
        EffectParameter(
            "a",
            unit,
            0.0,
            -high,
            high,
            "Amplitudes of cos(f q_m)",
            series=True,
            typical=(typical, 0.3 * typical),
            typical_of=of,
        ),
        EffectParameter(
            "b",
            unit,
            0.0,
            -high,
            high,
            "Amplitudes of sin(f q_m)",
            series=True,
            typical=(-0.5 * typical, 0.2 * typical),
            typical_of=of,
        ),
        EffectParameter(
            "scale",
            "-",
            0.0,
            0.0,
            2.0,
            "Factor on all amplitudes",
            (scale,),
            default=1.0,
            typical=1.0,
        ),
    )


RIPPLE_EFFECTS = (
    Effect(
        "cogging",
        "motor",
        "Torque periodic in the rotor angle: sum_j a_j cos(f_j q_m) + b_j sin(f_j q_m).",
        f"{_RIPPLE} (type 1)",
        _ripple("N m", "cogging_scale", "the k-th harmonic of the rotor is n k", 0.01),
        size=("a", "b"),
    ),
    Effect(
        "gear_ripple",
        "motor",
        "The same series times the transmitted torque: the meshing of teeth.",
        f"{_RIPPLE} (type 2)",
        _ripple("-", "gear_ripple_scale", "the k-th harmonic of the rotor is n k", 0.02),
        size=("a", "b"),
    ),
    Effect(
        "commutation_ripple",
        "motor",
        "The same series times the torque of the current: harmonics of the back-EMF.",
        MACHINES,
        _ripple("-", "commutation_scale", "multiples of 6 p n for three phases", 0.02),
        size=("a", "b"),
    ),
    Effect(
        "current_offset",
        "motor",
        "Offsets of the phase current sensors: torque at the electrical frequency p n.",
        CURRENT_ERRORS,
        (
            EffectParameter(
                "a",
                "A",
                0.0,
                -5.0,
                5.0,
                "Amplitude of cos(p n q_m)",
                ("offset_a",),
                default=0.0,
                typical=0.005,
                typical_of="current",
            ),
            EffectParameter(
                "b",
                "A",
                0.0,
                -5.0,
                5.0,
                "Amplitude of sin(p n q_m)",
                ("offset_b",),
                default=0.0,
                typical=0.003,
                typical_of="current",
            ),
            EffectParameter(
                "p", "-", 0.0, 1.0, 50.0, "Number of pole pairs", ("offset_p",), "p", typical=6.0
            ),
        ),
        size=("a", "b"),
    ),
)
