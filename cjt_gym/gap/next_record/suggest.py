"""What to record next, in words and as an excitation file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cjt_gym.gap.candidates.separated import NOTHING, SEPARATED_BY, advice, difference
from cjt_gym.gap.diagnosis import ENOUGH, NamedEffect, Suggestion
from cjt_gym.gap.judged.confusable import rival_fits
from cjt_gym.gap.next_record.design import TELLS, Cross, Prospect, prospects
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.explain import Explanation
from cjt_gym.gap.stages.fit import Fit, Problem
from cjt_gym.gap.stages.leftover import Leftover
from cjt_gym.gap.stages.merit import evidence
from cjt_gym.records import Record, default_units

MOST_RIVALS = 2
WEAK = "What was found stands on little: "
SHORT = 5.0
"""Duration of a record below which a longer one is suggested [s]."""
MEANS = frozenset(
    {"torque_bias", "torque_gain", "spring_hysteresis", "load_friction", "measurement_delay"}
)
"""Effects that a weight, a load or another sensor tells from others where no current does."""
ELSEWHERE = (
    "Look at the regimes in which it lies, and record the joint again with one input at a time: "
    "slow ramps, steps, a chirp."
)


def suggest(
    found: Explanation, named: Sequence[NamedEffect], left: Sequence[Leftover]
) -> Suggestion:
    """Return the experiment that best settles what an explanation leaves open.

    Args:
        found: The explanation.
        named: The effects that it names.
        left: The stages that it leaves.
    """
    problem, question = found.problem, _open_question(found, named)
    preface = ""
    if not question and left:
        question = _nearest(found, left[0].stage)
        preface = f"The {left[0].stage} stage has a gap that no effect of the table explains. "
    if len(question) < 2:
        return Suggestion(preface + ELSEWHERE if left else _other_means(named))
    ranked = prospects(problem, question)
    if ranked and ranked[0].tells:
        return Suggestion(
            preface + _text(ranked[0], problem.stages.setting.command_unit),
            excitation=record_of(problem, ranked[0]),
        )
    return Suggestion(preface + _needs_more(tuple(question), ranked))


def cautious(suggestion: Suggestion, stages: Stages, held_out: bool) -> Suggestion:
    """Return a suggestion that asks for a better record if this one reveals little.

    Args:
        suggestion: The original suggestion.
        stages: Those of the records.
        held_out: Whether data were withheld from the fit.
    """
    asked = []
    logged = [one.setting.series for one in (stages, *stages.others)]
    if logged[0].slow:
        asked.append("record at 1 kHz")
    if sum(len(series) * series.dt for series in logged) < SHORT:
        asked.append("record 10 s")
    if not held_out:
        asked.append("record a second run with other excitation and give it as validation")
    if suggestion.text != ENOUGH or not asked:
        return suggestion
    return Suggestion(f"{WEAK}{', '.join(asked)}.")


def _nearest(found: Explanation, stage: str) -> Mapping[str, Fit]:
    """Return the two best explanations of a stage's gap, by name."""
    best: dict[str, Fit] = {}
    blamed = [fit for fit in found.seen if fit.model.effects]
    for fit in sorted(blamed, key=lambda f: -evidence(found.problem, f)):
        last = fit.model.effects[-1]
        if stage in last.touches and len(best) < 2:
            best.setdefault(last.outside or last.name, fit)
    return best


def _open_question(found: Explanation, named: Sequence[NamedEffect]) -> Mapping[str, Fit]:
    """Return the explanations to tell apart, by name, for the least certain of the effects."""
    doubtful = [e for e in named if e.confusable_with or e.status == "tentative"]
    for effect in sorted(doubtful, key=lambda e: e.confidence):
        for index, row in enumerate(found.fit.model.effects):
            if (row.name, row.body, row.channel) != (effect.name, effect.body, effect.channel):
                continue
            others = list(rival_fits(found, index).items())[:MOST_RIVALS]
            if not others and effect.status == "tentative" and not _told_otherwise(effect):
                others = [(NOTHING, found.needs[index].without)]
            if others:
                return {effect.name: found.fit, **dict(others)}
    return {}


def _told_otherwise(effect: NamedEffect) -> bool:
    """Return whether means other than motion tell an effect from its rivals."""
    return any(frozenset((effect.name, other)) in SEPARATED_BY for other in effect.confusable_with)


def _text(best: Prospect, unit: str) -> str:
    names = list(dict.fromkeys(cross.true for cross in best.crosses))
    telling = [cross for cross in best.crosses if cross.margin >= 0.5 * best.margin]
    shown = ". ".join(_sentence(cross) for cross in sorted(telling, key=lambda c: -c.margin)[:2])
    return (
        f"To tell {difference(*names)}, record {best.input.text}: "
        f"{len(best.current) * best.dt:.3g} s, up to {np.abs(best.current).max():.3g} {unit}, from "
        f"rest. {shown}."
    )


def _sentence(cross: Cross) -> str:
    what = "a model without it" if cross.rival == NOTHING else cross.rival
    truth = "there is none" if cross.true == NOTHING else f"it is {cross.true}"
    return (
        f"If {truth}, {what} would then leave {_times(cross.residual)} times the noise in the "
        f"{cross.stage} stage (evidence {cross.margin:.0f}; {TELLS:.0f} decides)"
    )


def _times(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.2g}"


def _other_means(named: Sequence[NamedEffect]) -> str:
    """Return what separates effects that look the same in these channels under any motion."""
    pairs = ((e.name, rival) for e in named for rival in e.confusable_with)
    return next((advice(*pair) for pair in pairs if frozenset(pair) in SEPARATED_BY), ENOUGH)


def _needs_more(names: Sequence[str], ranked: Sequence[Prospect]) -> str:
    best = f" (the best would be {ranked[0].input.text})" if ranked else ""
    told = f"No current within the limits of the joint tells {difference(*names)}"
    by_motion = MEANS.isdisjoint(names[:2])
    return f"{told} with these sensors{best}." + ("" if by_motion else f" {advice(*names[:2])}")


def record_of(problem: Problem, prospect: Prospect) -> Record:
    """Return an input as an excitation: a record of commands without measurements."""
    setting = problem.stages.setting
    p = setting.joint.parameters
    current = prospect.current
    columns = {
        "t": np.arange(len(current)) * prospect.dt,
        "i_cmd": current,
        "tau_cmd": current * setting.nominal["k_t"] * setting.nominal["n"],
    }
    units = default_units(tuple(columns), prismatic=p.axis == "prismatic")
    units["i_cmd"] = setting.command_unit
    return Record(
        columns,
        units,
        dt=prospect.dt,
        joint=p.name,
        structure=setting.structure.name,
        provenance={
            "mode": "open loop",
            "excitation": prospect.input.name,
            "purpose": _text(prospect, setting.command_unit),
            "predicted_margin": round(prospect.margin, 1),
        },
    )
