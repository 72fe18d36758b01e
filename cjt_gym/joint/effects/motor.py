"""Effects on the motor's torque and on the motion of the motor's side."""

from __future__ import annotations

from cjt_gym.joint.effects.row import BODIES, Effect, EffectParameter, per_body
from cjt_gym.joint.effects.sources import (
    ARMSTRONG,
    CATALOGUE,
    CURRENT_ERRORS,
    EMPS,
    LUGRE,
    MACHINES,
    PASSIVE_LUGRE,
    SERVO_FRICTION,
    TOOLBOX,
)

_NONLINEAR = f"{TOOLBOX}, section Nonlinear Dynamics"
_RIPPLE = f"{TOOLBOX}, section Torque Ripple"

DQ_0 = EffectParameter(
    "dq_0",
    "rad/s",
    0.002,
    0.0,
    0.05,
    "Velocity over which the sign is smoothed; 0 is the sharp, set-valued law",
    ("dq_0",),
    default=0.002,
    shared=True,
    typical=0.002,
)


def _coulomb(asymmetric: bool) -> tuple[EffectParameter, ...]:
    rows = []
    for key, body in BODIES.items():
        for way in ("", "_n") if asymmetric else ("",):
            symbol = f"d_c{key}{way}"
            direction = {"": ", positive direction", "_n": ", negative direction"}[way]
            level = (0.02 if way == "" else 0.03) if key == "m" else 0.0
            rows.append(
                EffectParameter(
                    symbol,
                    "N m",
                    0.0,
                    0.0,
                    20.0,
                    f"Coulomb level of the {body}{direction if asymmetric else ''}",
                    (symbol,) if asymmetric else (symbol, f"{symbol}_n"),
                    symbol,
                    default=0.0,
                    typical=level,
                    typical_of="torque",
                )
            )
    return (*rows, DQ_0)


def _own_level(text: str) -> tuple[EffectParameter, ...]:
    return per_body("d_c", "N m", 20.0, text, 0.02, "torque", fields=("d_c*", "d_c*_n"))


def _viscous() -> tuple[EffectParameter, ...]:
    return tuple(
        EffectParameter(
            f"d_{key}_n",
            "N m s/rad",
            None,
            0.0,
            50.0,
            f"Viscous damping of the {body} at negative velocity; neutral is d_{key}",
            (f"d_{key}_extra_n",),
            f"d_{key}_n",
            relative_to=f"d_{key}",
            typical=0.03 if key == "m" else 0.0,
            typical_of="torque" if key == "m" else "",
        )
        for key, body in BODIES.items()
    )


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


def _thermal(
    symbol: str, unit: str, low: float, high: float, text: str, source: str, typical: float
) -> EffectParameter:
    return EffectParameter(
        symbol, unit, 0.0, low, high, text, (f"heat_{symbol}",), source, typical=typical
    )


MOTOR_EFFECTS = (
    Effect(
        "torque_constant",
        "motor",
        "Torque per ampere differs from nominal by a constant factor.",
        CATALOGUE,
        (
            EffectParameter(
                "k_t",
                "N m/A",
                None,
                1e-3,
                20.0,
                "Torque constant that the motor really has",
                ("k_t",),
                relative_to="k_t",
                typical=0.9,
                typical_of="k_t",
            ),
        ),
        size=("k_t",),
    ),
    Effect(
        "thermal_derating",
        "motor",
        "Torque per ampere falls, and resistance rises, as the windings warm (two stages).",
        f"{TOOLBOX}, parameters r_th1, r_th2, T_thw, T_thm, a_CU; {MACHINES}",
        (
            EffectParameter(
                "derating",
                "1/K",
                0.0,
                0.0,
                0.02,
                "Share of k_t that is lost per kelvin of the winding above ambient",
                ("derating",),
                typical=0.002,
            ),
            EffectParameter(
                "a_CU",
                "1/K",
                0.0,
                0.0,
                0.01,
                "Rise of the winding resistance per kelvin",
                ("heat_a_CU",),
                "a_CU",
                default=0.0039,
                typical=0.0039,
            ),
            _thermal("r", "Ohm", 1e-3, 100.0, "Winding resistance when cold", "r", 0.3),
            _thermal("r_th1", "K/W", 0.01, 100.0, "Resistance winding to housing", "r_th1", 3.0),
            _thermal("r_th2", "K/W", 0.01, 100.0, "Resistance housing to ambient", "r_th2", 30.0),
            _thermal("T_thw", "s", 0.1, 1e4, "Time constant of the winding", "T_thw", 10.0),
            _thermal("T_thm", "s", 1.0, 1e5, "Time constant of the housing", "T_thm", 1000.0),
            EffectParameter(
                "rise",
                "K",
                0.0,
                0.0,
                150.0,
                "Rise of the winding above ambient at the start",
                ("heat_rise",),
                default=0.0,
                typical=40.0,
            ),
        ),
        size=("derating",),
    ),
    Effect(
        "torque_offset",
        "motor",
        "A constant torque: offset of the amplifier or of the current sensor.",
        EMPS,
        (
            EffectParameter(
                "torque",
                "N m",
                0.0,
                -5.0,
                5.0,
                "Constant torque on the motor",
                ("torque_offset",),
                typical=0.005,
                typical_of="torque",
            ),
        ),
        size=("torque",),
    ),
    Effect(
        "inertia",
        "motor",
        "Motor-side inertia differs from nominal.",
        CATALOGUE,
        (
            EffectParameter(
                "I_m",
                "kg m^2",
                None,
                1e-4,
                100.0,
                "Inertia that the rotor really has, link side",
                ("I_m",),
                relative_to="I_m",
                typical=1.2,
                typical_of="I_m",
            ),
            EffectParameter(
                "I_g",
                "kg m^2",
                None,
                0.0,
                100.0,
                "Inertia that the gear really has, link side",
                ("I_g",),
                relative_to="I_g",
            ),
        ),
        size=("I_m", "I_g"),
    ),
    Effect(
        "damping",
        "motor",
        "Viscous damping differs from nominal.",
        f"{TOOLBOX}, section Modeling (mechanical subsystem)",
        per_body(
            "d_", "N m s/rad", 50.0, "Viscous damping of the {body}", 0.02, "torque", replaces=True
        ),
        size=("d_m", "d_g", "d_l"),
    ),
    Effect(
        "coulomb",
        "motor",
        "Coulomb friction, -d_c tanh(dq / dq_0), equal in both directions.",
        _NONLINEAR,
        _coulomb(asymmetric=False),
        size=("d_cm", "d_cg", "d_cl"),
        excludes=("coulomb_asym",),
    ),
    Effect(
        "coulomb_asym",
        "motor",
        "Coulomb friction whose level differs between the two directions.",
        _NONLINEAR,
        _coulomb(asymmetric=True),
        size=("d_cm", "d_cg", "d_cl", "d_cm_n", "d_cg_n", "d_cl_n"),
        excludes=("coulomb",),
    ),
    Effect(
        "viscous_asym",
        "motor",
        "Viscous friction with another coefficient at negative velocity.",
        _NONLINEAR,
        _viscous(),
        size=("d_m_n", "d_g_n", "d_l_n"),
    ),
    Effect(
        "stribeck",
        "motor",
        "Breakaway above the Coulomb level, falling with speed: d_c + d_s exp(-(dq / v_s)^2).",
        ARMSTRONG,
        (
            *_own_level("Coulomb level of the {body}, on top of other rows"),
            *per_body(
                "d_s",
                "N m",
                20.0,
                "Breakaway of the {body} above its Coulomb level",
                0.015,
                "torque",
            ),
            EffectParameter(
                "v_s",
                "rad/s",
                0.0,
                0.005,
                2.0,
                "Stribeck velocity, at which the excess has fallen to 37 %",
                ("v_s",),
                "v_s",
                typical=0.05,
            ),
            DQ_0,
        ),
        size=("d_sm", "d_sg", "d_sl", "d_cm", "d_cg", "d_cl"),
    ),
    Effect(
        "presliding",
        "motor",
        "Friction through elastic bristles (LuGre); it takes all dry friction of its body.",
        f"{LUGRE}; damping limited as in {PASSIVE_LUGRE}",
        (
            *_own_level("Coulomb level of the {body}, on top of other rows"),
            *per_body(
                "sigma_",
                "N m/rad",
                1e6,
                "Stiffness of the bristles of the {body}",
                10.0,
                "torque",
            ),
            EffectParameter(
                "sigma_1",
                "N m s/rad",
                0.0,
                0.0,
                100.0,
                "Damping of the bristles, limited to 4 d_c / |dq| to stay passive",
                ("sigma_1",),
                default=0.0,
                typical=0.0,
            ),
        ),
        size=("sigma_m", "sigma_g", "sigma_l", "d_cm", "d_cg", "d_cl"),
    ),
    Effect(
        "load_friction",
        "motor",
        "Dry friction that grows with the transmitted torque: mu |tau|.",
        SERVO_FRICTION,
        (
            *per_body("mu_", "-", 0.5, "Friction of the {body} per transmitted torque", 0.05),
            DQ_0,
        ),
        size=("mu_m", "mu_g", "mu_l"),
    ),
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
