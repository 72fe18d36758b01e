"""Candidates of the load stage."""

from __future__ import annotations

from cjt_gym.gap.candidates.candidate import Candidate, Scales
from cjt_gym.gap.candidates.friction import damping_of, friction_of
from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.candidates.released import released
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.setting import Setting


def load_rows(setting: Setting, size: Scales) -> list[Candidate]:
    """Return the candidates of the load; a search over horizons seeks weights without a spring."""
    if not setting.has_spring:
        return []
    rows = [released(setting, "I_l", "load_inertia", "load")]
    if setting.cut is Cut.NOWHERE:
        return rows
    rows += friction_of(setting, size, "l")
    rows.append(damping_of(setting, size, "l"))
    torque = max(setting.sprung_torque, 1e-9)
    gravity = Candidate(
        "gravity",
        "load",
        (Number("a", "N m", 0.0, torque), Number("b", "N m", 0.0, torque)),
        lambda f, v: f.update(grav_a=v["a"], grav_b=v["b"]),
        ("load",),
        starts=((0.0, 0.0),),
        family="load",
    )
    return [*rows, gravity]
