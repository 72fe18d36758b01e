"""Effects found by a regression of the torque on the motion, beside the search over horizons.

A search over horizons needs effects that change the motion in many pieces of a record. A regression
of the torque shows where the torque goes whenever the joint moves, whatever moves it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from scipy.stats import t as student

from cjt_gym.gap.diagnosis import EVEN_CHANCE, Interval, NamedEffect
from cjt_gym.gap.horizons.fitting.terms import HEAVIEST, scales_of
from cjt_gym.gap.horizons.prediction.model import Draft, Term, drafted, motor_inertia
from cjt_gym.gap.horizons.prediction.windows import relative
from cjt_gym.gap.horizons.selection.choice import WORSE
from cjt_gym.gap.horizons.selection.judgement import Judgement
from cjt_gym.gap.horizons.torque.cross_validated import BLOCKS, Spent
from cjt_gym.gap.horizons.torque.inverse import BY_LOAD, DRAGS, inverse
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.effects import friction
from cjt_gym.joint.files.effect_entries import unit_on

HELD, RUNS_OUT = (
    f"{why} The named effects and their numbers come from a regression of the torque on the "
    "motion; "
    for why in (
        "The torque hardly determines the motion, as when a controller tracks a trajectory.",
        "Nothing drives the joint, and within half a second noise hides how it slows down.",
    )
)
"""Messages used when effects are identified from the torque alone, that of a joint that is driven
and that of one that runs out, followed by what the joint file has."""
KEPT, SET = (
    "the joint file has what predicts the motion best.",
    "the joint file has them, and beside them what predicts the motion best.",
)
"""What the joint file has: without and with these numbers."""
NOT_PREDICTED = "the torque shows it, predictions of the motion do not"
NOT_HELD = "torque and motion of the fitted record show it, the held-out record does not"
"""Doubts of effects that the torque shows."""
SYMBOLS = {
    "damping": ("d_m",),
    "coulomb": ("d_cm",),
    "presliding": ("d_cm", "sigma_m"),
    "torque_offset": ("torque",),
    "cogging": ("f", "a", "b"),
    "torque_constant": ("k_t",),
    "load_friction": ("mu_m",),
    "command_delay": ("delay",),
}
BODIES = {
    "damping": "motor", "coulomb": "motor", "presliding": "motor", "load_friction": "motor",
    "gravity": "load",
}  # fmt: skip
"""Symbols and bodies of the effects that a torque regression can show."""
EITHER: Mapping[str, tuple[str, ...]] = {
    "coulomb_asym": ("coulomb", "torque_offset"),
    "torque_offset": ("coulomb_asym",),
    "viscous_asym": ("coulomb_asym", "torque_offset"),
    "cogging": ("gear_ripple",),
    "torque_constant": ("load_friction",),
    "load_friction": ("torque_constant",),
    "command_delay": ("current_lag",),
}
"""Explanations that are (nearly) equivalent while a joint moves: none of them is confirmed."""
DRY = friction.DRY | {"load_friction"}
"""Laws of dry friction; a regression sees only the plain one."""
SAME: Mapping[str, frozenset[str]] = {
    "damping": frozenset({"viscous_asym"}),
    "coulomb": DRY,
    "presliding": DRY,
    "torque_offset": frozenset({"coulomb_asym", "viscous_asym", "gravity"}),
    "gravity": frozenset({"torque_offset"}),
    "cogging": frozenset(),
    "torque_constant": frozenset(),
    "load_friction": frozenset(),
    "command_delay": frozenset({"current_lag"}),
}
"""For each effect that the torque shows, effects that already account for it or its remainder."""
FRICTION = frozenset({"damping", "coulomb", "presliding", "load_friction"})
"""Laws that only oppose the motion. Where one of them is negative something else moves the joint,
as the other joints of an arm do, and the other is not friction either."""
AGREES = 0.5
"""Relative difference up to which a fit and a regression agree."""
LEAST = 1e-3
"""Lower limit of a regression's inertia, relative to the datasheet's."""


def either(name: str, joint: Joint) -> tuple[str, ...]:
    """Return the explanations that are nearly equivalent to one; a direct drive has no teeth."""
    geared = joint.structure_row.has_gear or joint.parameters.n != 1.0
    return tuple(n for n in EITHER.get(name, ()) if geared or n != "gear_ripple")


def agrees(one: Spent | None, values: Sequence[float]) -> bool:
    """Return whether a fit and a regression agree on the size of an effect."""
    if one is None or len(one.values) != len(values):
        return False
    return math.dist(one.values[-2:], values[-2:]) < AGREES * one.size  # of cogging no frequency


def is_guessed(name: str, joint: Joint) -> bool:
    """Return whether an effect is no more than a guess of the datasheet, which is corrected."""
    known = (joint.parameters.quantities.get(s) for s in SYMBOLS.get(name, ()))
    return any(q is not None and q.guess for q in known)


def _covered(name: str, seen: Mapping[str, Spent]) -> bool:
    """Return whether a regression of the torque shows an effect or an equivalent one."""
    return any(name in {one, *SAME[one]} for one in seen)


def told_by_torque(
    judged: Judgement,
    seen: Mapping[str, Spent],
    named: Sequence[NamedEffect],
    excluded: Collection[str] = (),
    *,
    alone: bool,
) -> tuple[NamedEffect, ...]:
    """Return effects that the torque shows and that are not named yet, all of them tentative.

    Args:
        judged: The judgement.
        seen: Effects found by the regression.
        named: Effects that are named already.
        excluded: Effects that the record cannot identify.
        alone: Whether the torque is the only evidence, as nothing predicts the motion.
    """
    names = {e.name for e in named}
    found: list[NamedEffect] = []
    joint = judged.case.joint
    refuted = judged.found.refuted if judged.found is not None and judged.case.held else {}
    driven = any(one.name in FRICTION and one.values[0] < 0.0 for one in seen.values())
    heaviest = HEAVIEST * scales_of(joint, judged.case.logs).peak
    for one in sorted(seen.values(), key=lambda s: -s.share):
        taken = names | {e.name for e in found}
        beside = {"load_friction"} if "load_friction" in seen else set()  # told apart from it
        if taken & {one.name, *(SAME[one.name] - beside)} or (driven and one.name in FRICTION):
            continue
        if one.name == "gravity" and math.hypot(*one.values) > heaviest:
            continue  # over a short travel it stands for something that gives way
        if not alone and is_guessed(one.name, joint):
            continue
        alike = tuple(
            n
            for n in either(one.name, joint)
            if n not in seen and (n not in BY_LOAD or n in excluded)
        )
        found.append(
            NamedEffect(
                one.name, EFFECTS[one.name].stage, BODIES.get(one.name), None,
                _numbers(one, joint), "tentative", EVEN_CHANCE,
                one.share if alone else 0.0, alike,
                doubt=NOT_PREDICTED if alone or one.name not in refuted else NOT_HELD,
            )
        )  # fmt: skip
    return tuple(found)


def beside_torque(
    judged: Judgement, seen: Mapping[str, Spent], named: Sequence[NamedEffect]
) -> tuple[NamedEffect, ...]:
    """Return the named effects of which the torque tells neither them nor an equivalent."""
    tells = {e.name: seen[e.name] for e in told_by_torque(judged, seen, (), alone=True)}
    return tuple(e for e in named if not _covered(e.name, tells))


def with_told(judged: Judgement, effects: Sequence[NamedEffect]) -> Judgement:
    """Return a judgement whose joint has the numbers of effects, if it predicts no worse so.

    Of a joint that runs out they are all of its friction beside what is listed: predictions tell
    none of it there.
    """
    given, nominal = judged.joint.effects, judged.case.joint
    if scales_of(nominal, judged.case.logs).coasts:
        listed = {name: nominal.effects[name] for name in DRAGS & nominal.effects.keys()}
        given = {name: x for name, x in given.items() if name not in DRAGS} | listed
    draft = Draft(judged.joint.file, given)
    for effect in effects:
        for other in EFFECTS[effect.name].excludes:
            draft.effects.pop(other, None)
        parameters = EFFECTS[effect.name].parameters
        series = {p.symbol for p in parameters if p.series}
        draft.row(effect.name).update(
            (s, (x.value,) if s in series else x.value) for s, x in effect.parameters.items()
        )
    joint = drafted(judged.joint, draft)
    windows = judged.case.test
    before, after = (relative(windows, windows.errors(j)) for j in (judged.joint, joint))
    if any(after[key] > WORSE * before[key] for key in before):
        return judged
    rows = tuple(replace(row, found=after[row.channel, row.seconds]) for row in judged.rows)
    return replace(judged, joint=joint, rows=rows)


def _numbers(one: Spent, joint: Joint) -> dict[str, Interval]:
    """Return an effect's parameters with their 95 % intervals."""
    times = float(student.ppf(0.975, BLOCKS - 1))
    if one.name == "gravity":
        a, b = one.values  # the load needs a cos q + b sin q
        size, half = max(math.hypot(a, b), 1e-12), times * max(one.deviations)
        numbers = {"torque": (size, half), "angle": (-math.atan2(a, b), half / size)}
    else:
        symbols = SYMBOLS[one.name]
        pairs = zip(one.values, one.deviations, strict=True)
        numbers = {s: (x, times * d) for s, (x, d) in zip(symbols, pairs, strict=True)}
    return {s: _interval(one.name, s, x, half, joint) for s, (x, half) in numbers.items()}


def _interval(effect: str, symbol: str, value: float, half: float, joint: Joint) -> Interval:
    parameter = EFFECTS[effect].parameter(symbol)
    assert parameter is not None
    least, _, most = EFFECTS[effect].domain(parameter)
    low, high = max(value - half, min(least, value)), min(value + half, max(most, value))
    return Interval(value, low, high, unit_on(parameter, joint.parameters))


def inertia_by_torque(judged: Judgement, term: Term) -> list[float]:
    """Return inertia factors from regressions of the torque; empty for any other term.

    Acceleration noise biases these estimates low and torque noise biases those of predictions
    high: where a controller keeps the motion smooth, the two may be far apart.
    """
    if term.name != "inertia":
        return []
    total = motor_inertia(judged.case.joint)
    found = [one.inertia / total for one in inverse(judged.case.joint, judged.case.logs)]
    return [max(factor, LEAST) for factor in found]
