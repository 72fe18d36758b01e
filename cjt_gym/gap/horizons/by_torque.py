"""What a regression of the torque on the motion says beside the search over horizons.

A search over horizons needs effects that change the motion in many pieces of a record. A regression
of the torque sees what the torque is spent on wherever the joint moves, however it came to move.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.stats import t as student

from cjt_gym.gap.diagnosis import Interval, NamedEffect
from cjt_gym.gap.horizons.inverse import BLOCKS, Spent, inverse, spent
from cjt_gym.gap.horizons.judge import Judgement
from cjt_gym.gap.horizons.model import Term, body_group, motor_inertia
from cjt_gym.gap.horizons.rows import SWING, VAGUE, tolerance_of
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.effect_entries import unit_on

HELD = (
    "The torque hardly determines the motion, as when a controller tracks a trajectory. The named "
    "effects come from a regression of the torque on the motion; the joint file does not have them."
)
"""What is said where effects are told by the torque alone."""
SPENT_ON: Mapping[str, tuple[str, str | None]] = {
    "damping": ("d_m", "motor"),
    "coulomb": ("d_cm", "motor"),
    "torque_offset": ("torque", None),
    "gravity": ("torque", "load"),
}
"""Effects on which a torque may be seen to be spent: symbol of their size, and body."""
EITHER: Mapping[str, tuple[str, ...]] = {
    "coulomb_asym": ("coulomb", "torque_offset"),
    "torque_offset": ("coulomb_asym",),
    "viscous_asym": ("coulomb_asym", "torque_offset"),
}
"""Explanations that are the same, or nearly so, where a joint moves: none of them is confirmed."""
DRY = frozenset(
    {"coulomb", "coulomb_asym", "stribeck", "presliding", "load_coulomb", "load_friction"}
)
SAME: Mapping[str, frozenset[str]] = {
    "damping": frozenset({"viscous_asym"}),
    "coulomb": DRY,
    "torque_offset": frozenset({"coulomb_asym", "viscous_asym", "gravity"}),
    "gravity": frozenset({"torque_offset"}),
}
"""Effects beside which one that the torque shows is the same once more, or its rest."""
OUTSIDE = 3.0
"""Tolerances, and deviations, beyond which a damping is more than the datasheet's."""
AGREES = 0.5
"""Relative difference up to which a fit and a regression find the same."""
LEAST = 1e-3
"""Least inertia of a regression, as a share of the datasheet's."""


def seen_in_torque(judged: Judgement, excluded: Collection[str]) -> dict[str, Spent]:
    """Return on which effects the torque is clearly spent, of those that the record can tell."""
    joint, logs = judged.case.joint, judged.case.logs
    wide = joint.parameters.axis == "rotary" and np.ptp(logs[0].states[:, 0]) > SWING
    names = [n for n in SPENT_ON if n not in excluded and n not in joint.effects]
    found = spent(joint, logs, [n for n in names if wide or n != "gravity"])
    return {one.name: one for one in found if one.name != "damping" or _new(joint, one)}


def _new(joint: Joint, damping: Spent) -> bool:
    """Return whether a damping is more than the datasheet's, which a regression finds as well."""
    own = [f"d_{b}" for b in body_group(joint.structure_row, "m")]
    known = {s: joint.parameters.get(s, 0.0) for s in own if joint.parameters.get(s, 0.0) > 0.0}
    allowed = OUTSIDE * sum(
        d * min(tolerance_of(joint.file, s, VAGUE), VAGUE) for s, d in known.items()
    )
    return damping.values[0] - sum(known.values()) > max(allowed, OUTSIDE * damping.deviations[0])


def agrees(one: Spent | None, values: Sequence[float]) -> bool:
    """Return whether a fit finds an effect as large as a regression does."""
    if one is None or len(one.values) != len(values):
        return False
    off = math.dist(one.values, values)
    return off < AGREES * math.hypot(*one.values)


def told_by_torque(
    judged: Judgement, seen: Mapping[str, Spent], named: Sequence[NamedEffect], *, alone: bool
) -> tuple[NamedEffect, ...]:
    """Return what the torque is spent on and has no name yet; all of it is tentative.

    Args:
        judged: The judgement.
        seen: What a regression sees.
        named: What has a name already.
        alone: Whether nothing predicts the motion, so that the torque is all that tells.
    """
    names = {e.name for e in named}
    found: list[NamedEffect] = []
    for one in sorted(seen.values(), key=lambda s: -s.share):
        value = math.hypot(*one.values) if one.name == "gravity" else one.values[0]
        taken = names | {e.name for e in found}
        if taken & {one.name, *SAME[one.name]} or _backwards(one):
            continue
        symbol, body = SPENT_ON[one.name]
        parameter = EFFECTS[one.name].parameter(symbol)
        assert parameter is not None
        half = float(student.ppf(0.975, BLOCKS - 1)) * max(one.deviations)
        unit = unit_on(parameter, judged.case.joint.parameters)
        interval = Interval(value, value - half, value + half, unit)
        found.append(
            NamedEffect(
                one.name, EFFECTS[one.name].stage, body, None, {symbol: interval}, "tentative",
                0.5, one.share if alone else 0.0, EITHER.get(one.name, ()), 0.0,
            )
        )  # fmt: skip
    return tuple(found)


def _backwards(one: Spent) -> bool:
    """Return whether a friction would push."""
    return one.name in ("damping", "coulomb") and one.values[0] < 0.0


def inertia_by_torque(judged: Judgement, term: Term) -> list[float]:
    """Return what regressions of the torque on the motion find for the inertia, if it is that.

    Noise of the acceleration makes theirs too small, noise of the torque that of predictions too
    large: where a controller keeps the motion smooth the two may be far apart.
    """
    if term.name != "inertia":
        return []
    total = motor_inertia(judged.case.joint)
    found = [one.inertia / total for one in inverse(judged.case.joint, judged.case.logs)]
    return [max(factor, LEAST) for factor in found]
