"""Candidates of the transmission stage."""

from __future__ import annotations

from functools import partial

from cjt_gym.gap.candidates.candidate import Candidate, Scales, Values
from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.candidates.released import released
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting

HYSTERESES = {"Bouc-Wen": 2.0, "Dahl": 1.0, "Maxwell slip": 0.0}


def _hysteresis(exponent: float, f: Fields, v: Values) -> None:
    f["hyst"], f["hyst_z"], f["hyst_n"] = v["h"], v["z_h"], exponent


def transmission_rows(setting: Setting, size: Scales) -> list[Candidate]:
    """Return the candidates of the transmission."""
    touches = setting.stages_of("transmission")
    rows = [released(setting, "k_b", "stiffness", "transmission")]
    if setting.has_gear:
        rows.append(released(setting, "k_g", "gear_stiffness", "transmission"))
    x = size.deflection
    play = Number("b", "rad", 0.0, x, low=0.0)
    centre = Number("centre", "rad", 0.0, x, shape=True)
    hard = Number("c", "1/rad^2", 0.0, 0.3 / x**2)
    torque = Number("h", "N m", 0.0, setting.nominal["k_b"] * x)
    width = Number("z_h", "rad", 0.3 * x, 1.5, True, low=1e-3 * x, high=100 * x, shape=True)

    if setting.has_gear and setting.cut is Cut.BY_TORQUE:
        rows += [_gear_play(play, centre, x, pulls) for pulls in (False, True)]
    row = partial(Candidate, stage="transmission", touches=touches, family="spring")
    return [
        *rows,
        row(
            "backlash",
            unknowns=(play, centre),
            apply=lambda f, v: f.update(play=v["b"], q_0=f["q_0"] + v["centre"]),
            starts=tuple((w * x, c * w * x) for w in (0.03, 0.2) for c in (-0.4, 0.0, 0.4)),
            variant="bar",
        ),
        row(
            "hardening",
            unknowns=(hard,),
            apply=lambda f, v: f.update(hard=v["c"]),
            starts=((0.0,),),
        ),
        *(
            row(
                "spring_hysteresis",
                unknowns=(torque, width),
                apply=partial(_hysteresis, exponent),
                starts=tuple((0.02 * torque.scale, w * x) for w in (0.05, 0.3, 1.0)),
                variant=variant,
            )
            for variant, exponent in HYSTERESES.items()
        ),
    ]


def _gear_play(play: Number, centre: Number, x: float, pulls: bool) -> Candidate:
    """Return backlash in the gear, whose damper may or may not resist parting teeth."""

    def apply(f: Fields, v: Values) -> None:
        f["play_g"], f["pull_g"] = v["b"], float(pulls)
        f["centre_g"] = min(max(v["centre"], -0.5 * v["b"]), 0.5 * v["b"])
        f["q_0"] -= f["centre_g"]

    return Candidate(
        "backlash",
        "transmission",
        (play, centre),
        apply,
        ("motor", "transmission"),
        starts=tuple((w * x, c * w * x) for w in (0.05, 0.25) for c in (-0.4, 0.0, 0.4)),
        family="spring",
        variant="gear, damper pulls" if pulls else "gear",
    )
