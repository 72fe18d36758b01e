"""Friction that acts on the motor, the gear or the load."""

from __future__ import annotations

from functools import partial

from cjt_gym.joint.effects.row import BODIES, EffectParameter, effect, number, per_body
from cjt_gym.joint.effects.sources import ARMSTRONG, LUGRE, PASSIVE_LUGRE, SERVO_FRICTION, TOOLBOX

_NONLINEAR = f"{TOOLBOX}, section Nonlinear Dynamics"
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


row = partial(effect, "motor")

FRICTION_EFFECTS = (
    row(
        "damping",
        "Viscous damping differs from nominal.",
        f"{TOOLBOX}, section Modeling (mechanical subsystem)",
        *per_body(
            "d_", "N m s/rad", 50.0, "Viscous damping of the {body}", 0.02, "torque", replaces=True
        ),
    ),
    row(
        "coulomb",
        "Coulomb friction, -d_c tanh(dq / dq_0), equal in both directions.",
        _NONLINEAR,
        *_coulomb(asymmetric=False),
        size=("d_cm", "d_cg", "d_cl"),
        excludes=("coulomb_asym",),
    ),
    row(
        "coulomb_asym",
        "Coulomb friction whose level differs between the two directions.",
        _NONLINEAR,
        *_coulomb(asymmetric=True),
        size=("d_cm", "d_cg", "d_cl", "d_cm_n", "d_cg_n", "d_cl_n"),
        excludes=("coulomb",),
    ),
    row(
        "viscous_asym",
        "Viscous friction with another coefficient at negative velocity.",
        _NONLINEAR,
        *_viscous(),
    ),
    row(
        "stribeck",
        "Breakaway above the Coulomb level, falling with speed: d_c + d_s exp(-(dq / v_s)^2).",
        ARMSTRONG,
        *_own_level("Coulomb level of the {body}, on top of other rows"),
        *per_body(
            "d_s", "N m", 20.0, "Breakaway of the {body} above its Coulomb level", 0.015, "torque"
        ),
        number(
            "v_s",
            "rad/s",
            2.0,
            "Stribeck velocity, at which the excess has fallen to 37 %",
            "v_s",
            low=0.005,
            joint_parameter="v_s",
            typical=0.05,
        ),
        DQ_0,
        size=("d_sm", "d_sg", "d_sl", "d_cm", "d_cg", "d_cl"),
    ),
    row(
        "presliding",
        "Friction through elastic bristles (LuGre); it takes all dry friction of its body.",
        f"{LUGRE}; damping limited as in {PASSIVE_LUGRE}",
        *_own_level("Coulomb level of the {body}, on top of other rows"),
        *per_body(
            "sigma_", "N m/rad", 1e6, "Stiffness of the bristles of the {body}", 10.0, "torque"
        ),
        number(
            "sigma_1",
            "N m s/rad",
            100.0,
            "Damping of the bristles, limited to 4 d_c / |dq| to stay passive",
            "sigma_1",
            default=0.0,
        ),
        size=("sigma_m", "sigma_g", "sigma_l", "d_cm", "d_cg", "d_cl"),
    ),
    row(
        "load_friction",
        "Dry friction that grows with the transmitted torque: mu |tau|.",
        SERVO_FRICTION,
        *per_body("mu_", "-", 0.5, "Friction of the {body} per transmitted torque", 0.05),
        DQ_0,
        size=("mu_m", "mu_g", "mu_l"),
    ),
)
