"""Rows that set a datasheet value free."""

from __future__ import annotations

from cjt_gym.gap.candidates.candidate import Candidate, Values
from cjt_gym.gap.candidates.nuisances import stages_of
from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting

FURTHEST = 5.0
"""Largest factor between the true and the stated value."""


def released(setting: Setting, name: str, effect: str, stage: str, field_name: str) -> Candidate:
    """Return the row of an effect that is a wrong datasheet value."""
    unit = setting.joint.parameters.unit(field_name)
    nominal = setting.nominal[field_name]
    low, high = nominal / FURTHEST, nominal * FURTHEST
    factor = Number(name, unit, nominal, 0.5, log=True, low=low, high=high)
    body = {"m": "motor", "g": "gear", "l": "load"}.get(field_name[-1])
    if stage not in ("motor", "load") or field_name == "k_t":
        body = None

    def release(f: Fields, v: Values) -> None:
        f[field_name] *= v[name] / setting.nominal[field_name]

    return Candidate(
        effect,
        stage,
        (factor,),
        release,
        stages_of(setting, field_name),
        body=body,
        starts=((setting.nominal[field_name],),),
        family="nominal",
        releases=field_name,
    )
