"""Which of several joints is the answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cjt_gym.gap.horizons.fitting.base_terms import stated_friction
from cjt_gym.gap.horizons.fitting.fit import Problem
from cjt_gym.gap.horizons.prediction.case import Case
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, TRIVIAL, relative, worse
from cjt_gym.gap.horizons.selection.judgement import LOUD
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.joint import Joint
from cjt_gym.joint.effects import PACKAGED
from cjt_gym.joint.kernel.arrays import Floats

Key = tuple[str, float]
WORSE = 1.02
"""Ratio to the relative error of datasheet or least squares up to which a joint is no worse."""
WORSE_AT_ONCE = 1.2
"""The same at the shortest horizon, which depends more on the measured start than on the joint."""
WORSE_AT_FIRST, HALF = 1.5, 0.5
"""The same at the shortest horizon where errors at all further ones are less than a half: what is
left there is of the measured start."""
WORSE_BY_CHANCE = 1.1
"""The same on the few pieces held out of a record that is clearly better predicted as a whole."""
ORDER = ("stages", "found", "base")
"""Order in which joints are preferred that predict as well."""
SAME = 1.0
"""Cost difference up to which the first of several joints is the answer."""
MISS = 1.25
"""Ratio to the datasheet's relative error above which the stages of a cut joint are rejected: they
fit the offsets and delays of each record, which its joint does not contain."""
HEARD = 0.25
"""Share of the torque of its commands below which a joint hardly listens to them. Its motion at the
measured speed may be as good a prediction as any where a controller tracks a trajectory; no drive
is so weak."""
CLEARLY = 0.4
"""Logarithm of the mean square by which a search must beat the stages of a cut joint."""


def best_of(case: Case, test: Problem, joints: dict[str, Joint], enough: float) -> str:
    """Return the name of the joint that is the answer."""
    errors = {name: case.test.errors(joint) for name, joint in joints.items()}
    costs = {name: cost_of(case, test, joint) for name, joint in joints.items()}
    sound = [n for n in joints if is_no_worse(case, joints, n)]
    if (
        "stages" in joints
        and case.cut is not Cut.BY_TORQUE
        and (_deaf(case, errors["stages"]) or _hardly_listens(case, joints["stages"]))
    ):
        joints = {n: joint for n, joint in joints.items() if n != "stages"}
        sound = [n for n in sound if n != "stages"]
    vague = has_vague_friction(case.joint)
    staged = "stages" in joints and case.cut is Cut.BY_TORQUE and are_sound(case, joints)
    for name in (n for n in (("found", "base", "stages") if vague else ORDER) if n in joints):
        others = [costs[n] for n in sound if n != name]
        cut = name == "stages" and staged
        if cut and "found" in sound and _loses(case, enough, errors["stages"], errors["found"]):
            continue
        sharper = cut and not _is_own(joints.get("found"), case.joint)
        sharper = sharper or (vague and name != "stages")
        allowance = CLEARLY * test.strength if sharper else SAME
        if (name in sound or cut) and costs[name] <= min(others, default=np.inf) + allowance:
            return name
    if not sound and "base" in joints:  # as one that hardly moves, which is no answer itself
        without = {n: joint for n, joint in joints.items() if n != "base"}
        sound = [n for n in without if is_no_worse(case, without, n)]
    plain = {n: j for n, j in joints.items() if n in ("datasheet", "least squares")}
    sound = sound or [n for n in plain if is_no_worse(case, plain, n)]
    if not sound:  # of datasheet and least squares each is worse than the other somewhere
        best = min(plain, key=lambda n: costs[n])
        lost = {n: _lost(case, joints, n) for n in joints}
        sound = [n for n in joints if lost[n] <= lost[best]]
    return min(sound, key=lambda n: costs[n])


def _lost(case: Case, joints: dict[str, Joint], name: str) -> float:
    """Return the largest ratio of a joint's error to that of datasheet or least squares."""
    ratios = [1.0]
    for windows in {id(w): w for w in (case.all, case.test)}.values():
        own = relative(windows, windows.errors(joints[name]))
        for other in {"datasheet", "least squares"} & joints.keys() - {name}:
            known = relative(windows, windows.errors(joints[other]))
            ratios += [own[k] / max(known[k], TRIVIAL) for k in own if k[1] > min(HORIZONS)]
    return max(ratios)


def cost_of(case: Case, problem: Problem, joint: Joint) -> float:
    """Return the cost of a joint's errors in the windows of a problem."""
    return problem.cost(Model(case.joint), np.zeros(0), problem.windows.errors(joint))


def is_no_worse(case: Case, joints: dict[str, Joint], name: str) -> bool:
    """Return whether a joint predicts no worse than datasheet and least squares at any horizon.

    Where it predicts worse than motion at constant speed, it must not be worse than the fit without
    effects, either. Nor may bristles help only where it is known how they were bent before. On
    data that were fitted, too, it may be slightly worse before the longest horizon if it is clearly
    better there: a few starts on which a step of the input falls decide that.
    """
    parts = [case.all, case.test]
    if "presliding" in joints[name].effects:
        parts.append(case.test.alone())
    everywhere: dict[str, tuple[dict[Key, float], dict[Key, float]]] = {}
    for windows in {id(w): w for w in parts}.values():
        errors = windows.errors(joints[name])
        own = relative(windows, errors)
        for other in {"datasheet", "least squares", "base"} & joints.keys() - {name}:
            others = windows.errors(joints[other])
            known = relative(windows, others)
            more = [_of_the_start(own, known)]
            if windows is case.all:
                everywhere[other] = own, known
            elif windows is case.test:
                more.append(_by_chance(*everywhere[other]))
            if windows is not case.test:
                more.append(_forgiven(own, known))
            slack = {k: max(_slack(k), *(one.get(k, 1.0) for one in more)) for k in windows.keys}
            lost = worse(windows, errors, others, slack)
            if lost and (
                other != "base" or any(own[k] > 1.0 for k in lost if k[1] > min(HORIZONS))
            ):
                return False
    return True


def _by_chance(own: dict[Key, float], other: dict[Key, float]) -> dict[Key, float]:
    """Return the slack, on held-out pieces, of what is clearly better predicted on all data."""
    return {k: WORSE_BY_CHANCE for k in own if WORSE_AT_ONCE * own[k] < other[k]}


def _of_the_start(own: dict[Key, float], other: dict[Key, float]) -> dict[Key, float]:
    """Return the slack of the shortest horizon of channels that are far better beyond it."""
    first = min(HORIZONS)
    further = {c: [k for k in own if k[0] == c and k[1] > first] for c, _ in own}
    far = {c for c, keys in further.items() if keys and all(own[k] < HALF * other[k] for k in keys)}
    return {key: WORSE_AT_FIRST for key in own if key[0] in far and key[1] == first}


def _forgiven(own: dict[Key, float], other: dict[Key, float]) -> dict[Key, float]:
    """Return the slack of shorter horizons of channels that are better predicted at the longest."""
    last = max(HORIZONS)
    better = {c for c, h in own if h == last and WORSE_AT_ONCE * own[c, h] < other[c, h]}
    return {(c, h): WORSE_AT_ONCE for c, h in own if c in better and WHOLE < h < last}


def are_sound(case: Case, joints: dict[str, Joint]) -> bool:
    """Return whether neither datasheet nor least squares predict a cut joint clearly better."""
    names = {"datasheet", "least squares", "stages"} & joints.keys()
    errors = {name: relative(case.test, case.test.errors(joints[name])) for name in names}
    kinds = [k for k in errors["stages"] if k[0] in ("tau", "q_m") and k[1] > min(HORIZONS)]
    kinds += [("tau", WHOLE)] if ("tau", WHOLE) in errors["stages"] else []
    known = {name: [max(one[k], TRIVIAL) for k in kinds] for name, one in errors.items()}
    own = known.pop("stages")
    return not any(x > MISS * y for one in known.values() for x, y in zip(own, one, strict=True))


def fails(case: Case, enough: float, errors: dict[Key, float]) -> bool:
    """Return whether the stages leave much of a held output's torque unexplained."""
    held = case.joint.structure_row.output_fixed and case.joint.structure_row.size == 1
    return held and errors.get(("tau", WHOLE), 0.0) > enough


def has_vague_friction(joint: Joint) -> bool:
    """Return whether the stages take friction as given that a joint file gives with a tolerance.

    What the friction lacks within it, they find in the torque constant and all that scales with it.
    """
    return bool(stated_friction(joint)) and not joint.structure_row.has_spring


def _slack(key: Key) -> float:
    """Return the ratio to another joint's relative error up to which a joint is no worse."""
    return WORSE_AT_ONCE if key[1] == min(HORIZONS) else WORSE


def _loses(case: Case, enough: float, stages: Sequence[Floats], found: Sequence[Floats]) -> bool:
    """Return whether a search predicts whole pieces of a held output clearly better."""
    own, other = (relative(case.test, errors) for errors in (stages, found))
    whole = [key for key in own if key[1] == WHOLE and own[key] > enough]
    return any(2.0 * np.log(own[key] / max(other[key], TRIVIAL)) > CLEARLY for key in whole)


def _is_own(found: Joint | None, nominal: Joint) -> bool:
    """Return whether a search has found an effect unknown to the stages."""
    return found is not None and not PACKAGED.issuperset(found.effects.keys() - nominal.effects)


def _deaf(case: Case, errors: Sequence[Floats]) -> bool:
    """Return whether a joint hardly predicts its angle over the longest horizon."""
    return relative(case.test, errors).get(("q_m", max(HORIZONS)), 0.0) > LOUD


def _hardly_listens(case: Case, joint: Joint) -> bool:
    """Return whether a limit of the current, or its torque constant, leaves little of a torque."""
    log = case.logs[0]
    if log.drive != "i_cmd" or "current_saturation" not in joint.effects:
        return False
    command = np.concatenate([one.command[one.whole] for one in case.logs])
    limit = float(joint.effects["current_saturation"]["i_p"])  # type: ignore[arg-type]
    left = float(np.std(np.clip(command, -limit, limit))) / max(float(np.std(command)), 1e-300)
    return left * joint.parameters.k_t < HEARD * case.joint.parameters.k_t
