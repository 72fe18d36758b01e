"""Rows that set a datasheet value free."""

from __future__ import annotations

from cjt_gym.gap.candidates.candidate import BODIES, Candidate, Values
from cjt_gym.gap.candidates.nuisances import stages_of
from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting

FURTHEST = 5.0
"""Largest factor between the true and the stated value."""


def released(setting: Setting, field: str, effect: str, stage: str) -> Candidate:
    """Return the row of an effect that is a wrong datasheet value."""
    unit = setting.joint.parameters.unit(field)
    nominal = setting.nominal[field]
    low, high = nominal / FURTHEST, nominal * FURTHEST
    factor = Number(field, unit, nominal, 0.5, log=True, low=low, high=high)

    def release(f: Fields, v: Values) -> None:
        f[field] *= v[field] / nominal

    return Candidate(
        effect,
        stage,
        (factor,),
        release,
        stages_of(setting, field),
        body=BODIES.get(field[-1]) if stage in ("motor", "load") else None,
        starts=((nominal,),),
        family="nominal",
        releases=field,
    )
