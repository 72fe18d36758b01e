"""Friction that acts on the motor, the gear or the load."""

from __future__ import annotations

from functools import partial
from itertools import chain
from typing import Any

from cjt_gym.joint.effects.row import EffectParameter, effect, number, per_body
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
COULOMB = "Coulomb level of the {body}"
BOTH_WAYS = ("d_c*", "d_c*_n")
DRY = frozenset({"coulomb", "coulomb_asym", "stribeck", "presliding", "load_coulomb"})
"""Effects with a Coulomb level."""


def _level(
    symbol: str, text: str, typical: float = 0.02, **more: Any
) -> tuple[EffectParameter, ...]:
    return per_body(symbol, "N m", 20.0, text, typical, "torque", **more)


row = partial(effect, "motor")

FRICTION_EFFECTS = (
    row(
        "damping",
        "Viscous damping differs from nominal.",
        f"{TOOLBOX}, section Modeling (mechanical subsystem)",
        *per_body(
            "d_*",
            "N m s/rad",
            50.0,
            "Viscous damping of the {body}",
            0.02,
            "torque",
            relative_to="d_*",
        ),
    ),
    row(
        "coulomb",
        "Coulomb friction, -d_c tanh(dq / dq_0), equal in both directions.",
        _NONLINEAR,
        *_level("d_c*", COULOMB, fields=BOTH_WAYS, joint_parameter="d_c*"),
        DQ_0,
        size=("d_cm", "d_cg", "d_cl"),
        excludes=("coulomb_asym",),
    ),
    row(
        "coulomb_asym",
        "Coulomb friction whose level differs between the two directions.",
        _NONLINEAR,
        *chain.from_iterable(
            zip(
                _level("d_c*", f"{COULOMB}, positive direction", joint_parameter="d_c*"),
                _level("d_c*_n", f"{COULOMB}, negative direction", 0.03, joint_parameter="d_c*_n"),
                strict=True,
            )
        ),
        DQ_0,
        size=("d_cm", "d_cg", "d_cl", "d_cm_n", "d_cg_n", "d_cl_n"),
        excludes=("coulomb",),
    ),
    row(
        "viscous_asym",
        "Viscous friction with another coefficient at negative velocity.",
        _NONLINEAR,
        *per_body(
            "d_*_n",
            "N m s/rad",
            50.0,
            "Viscous damping of the {body} at negative velocity; neutral is d_*",
            0.03,
            "torque",
            fields=("d_*_extra_n",),
            joint_parameter="d_*_n",
            relative_to="d_*",
        ),
    ),
    row(
        "stribeck",
        "Breakaway above the Coulomb level, falling with speed: d_c + d_s exp(-(dq / v_s)^2).",
        ARMSTRONG,
        *_level("d_c*", f"{COULOMB}, on top of other rows", fields=BOTH_WAYS),
        *_level("d_s*", "Breakaway of the {body} above its Coulomb level", 0.015),
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
        *_level("d_c*", f"{COULOMB}, on top of other rows", fields=BOTH_WAYS),
        *per_body(
            "sigma_*", "N m/rad", 1e6, "Stiffness of the bristles of the {body}", 10.0, "torque"
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
        *per_body("mu_*", "-", 0.5, "Friction of the {body} per transmitted torque", 0.05),
        DQ_0,
        size=("mu_m", "mu_g", "mu_l"),
    ),
)
