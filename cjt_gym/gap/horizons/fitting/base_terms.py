"""Terms that are free in every fit: inertia, damping, torque constant and springs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.horizons.fitting.datasheet import datasheet_number, inertias_at
from cjt_gym.gap.horizons.fitting.terms import BODIES, sets
from cjt_gym.gap.horizons.prediction.model import Draft, Free, Put, Scales, Term
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.gap.recorded.spring_damping import SYMBOL, USUAL, critical
from cjt_gym.gap.recorded.tolerances import GUESSED, VAGUE, stated, tolerance_of
from cjt_gym.joint import Joint, JointFile

K_T, INERTIA, STIFFNESS = 0.05, 0.1, 0.1
"""Relative deviation of datasheet values that state no tolerance."""
MISSTATED = 3.0
"""Largest factor between a torque constant and its datasheet. Beyond it a fit no longer corrects
the constant, but hardly listens to its input."""
BRAKED = 1.5
"""Largest damping torque at a rarely exceeded speed, as a multiple of the rarely exceeded torque:
little more than one, as a joint at its top speed does not accelerate; gravity may add to it."""
BACKDRIVEN = 0.02
"""Share of the torque due to the motor above which its torque constant is fitted."""
AS_GIVEN = 1e-3
"""Relative deviation of the inertia of a joint that coasts: the record shows only ratios to it."""
LOOSE = 0.1
"""Relative step of a datasheet value that is off by more than its stated tolerance."""


def base_terms(
    joint: Joint, scales: Scales, *, inertia_alone_off: bool = False
) -> tuple[Term, ...]:
    """Return the terms that are free in every fit: inertia, damping, torque constant, springs.

    Args:
        joint: The datasheet's joint.
        scales: Usual torques and speeds of the records.
        inertia_alone_off: Whether the inertia is not held near its datasheet, so that the torque
            constant does not share its deviation.
    """
    file, groups = joint.file, joint.structure_row
    inertia = _inertia(joint)
    if inertia_alone_off:
        inertia = replace(inertia, prior=False, scale=LOOSE)
    if scales.coasts:
        inertia = replace(inertia, scale=AS_GIVEN)
    found = [
        Term("inertia", (inertia,), _put_inertia(joint), "motor", nominal=(1.0,)),
        _damping(joint, scales),
    ]
    if scales.driven > BACKDRIVEN:
        found.append(_stated(file, "torque_constant", "k_t", K_T, MISSTATED))
    if groups.has_spring and file.parameters.get("k_b", 0.0) > 0.0:
        found.append(_stated(file, "stiffness", "k_b", STIFFNESS))
        if not groups.output_fixed or file.parameters.get("d_gl", 0.0) > 0.0:
            found.append(_spring_damping(joint))
    if groups.has_gear and file.parameters.get("k_g", 0.0) > 0.0:
        found.append(_stated(file, "gear_stiffness", "k_g", STIFFNESS))
    if groups.groups[2] >= 0 and groups.groups[2] != groups.groups[0]:
        found.append(_stated(file, "load_inertia", "I_l", INERTIA))
    found += stated_friction(joint)
    others = [b for b in "gl" if b not in body_group(groups, "m") and is_damping_stated(joint, b)]
    return (*found, *(_stated_damping(joint, scales, body) for body in others))


def _stated(file: JointFile, effect: str, symbol: str, usual: float, reach: float = 100.0) -> Term:
    """Return the term of a datasheet value."""
    number = datasheet_number(file, symbol, usual, reach)
    return Term(effect, (number,), sets(effect, symbol), nominal=(number.start,))


def is_damping_stated(joint: Joint, body: str) -> bool:
    """Return whether the datasheet states the damping of a body that moves, and how well."""
    stated = math.isfinite(tolerance_of(joint.file, f"d_{body}", math.inf))
    moves = joint.structure_row.groups["mgl".index(body)] >= 0
    return moves and stated and joint.parameters.get(f"d_{body}", 0.0) > 0.0


def _stated_damping(joint: Joint, scales: Scales, body: str) -> Term:
    """Return the damping of a body that moves apart from the motor."""
    symbol = f"d_{body}"
    start = joint.parameters.get(symbol, 0.0)
    most = max(BRAKED * scales.peak / scales.fast, 2.0 * start)
    tolerance = tolerance_of(joint.file, symbol, math.inf)
    number = Number(symbol, "N m s/rad", start, tolerance, True, start / 100.0, most)
    return Term("damping", (number,), sets("damping", symbol), BODIES[body], nominal=(start,))


def stated_friction(joint: Joint) -> list[Term]:
    """Return the motor's Coulomb friction, if the datasheet states how well its level is known."""
    level = float(joint.effects.get("coulomb", {}).get("d_cm", 0.0))  # type: ignore[arg-type]
    known = stated(joint.file, "coulomb", "d_cm")
    if level <= 0.0 or known is None or not (known.guess or known.tolerance):
        return []
    scale = GUESSED if known.guess else min(float(known.tolerance or 0.0), GUESSED)
    number = Number("d_cm", "N m", level, scale, True, level / 100.0, level * 100.0, True)
    put = sets("coulomb", "d_cm")
    return [Term("coulomb", (number,), put, "motor", nominal=(level,), family="dry")]


def _inertia(joint: Joint) -> Number:
    """Return the factor on the inertia of all bodies that move with the motor."""
    p, file = joint.parameters, joint.file
    own = [f"I_{b}" for b in body_group(joint.structure_row, "m")]
    parts = [(p.get(s, 0.0), tolerance_of(file, s, INERTIA)) for s in own if p.get(s, 0.0) > 0.0]
    total = sum(value for value, _ in parts)
    spread = math.sqrt(sum((min(t, GUESSED) * value) ** 2 for value, t in parts)) / total
    spread = GUESSED if spread >= VAGUE else spread
    return Number("I_m", "-", 1.0, spread, True, 1e-3, 1e3, True)


def _put_inertia(joint: Joint) -> Put:
    def put(draft: Draft, values: Sequence[float]) -> None:
        new = inertias_at(joint, values[0])
        draft.row("inertia").update((s, x) for s, x in new.items() if s != "I_l")
        if new.get("I_l", 0.0) > 0.0:
            draft.row("load_inertia")["I_l"] = new["I_l"]

    return put


def _damping(joint: Joint, scales: Scales) -> Term:
    """Return the damping of all bodies that move with the motor, written as the motor's."""
    own = body_group(joint.structure_row, "m")
    start = sum(joint.parameters.get(f"d_{b}", 0.0) for b in own)
    step = max(0.05 * scales.torque / scales.speed, 0.1 * start)
    stated = min((tolerance_of(joint.file, f"d_{b}", math.inf) for b in own), default=math.inf)
    known = start > 0.0 and math.isfinite(stated)
    most = max(BRAKED * scales.peak / scales.fast, 2.0 * start)
    number = (
        Number("d_m", "N m s/rad", start, stated, True, start / 100.0, most, True)
        if known
        else Free("d_m", "N m s/rad", start, step, low=0.0, high=most)
    )

    def put(draft: Draft, values: Sequence[float]) -> None:
        row = draft.row("damping")
        row["d_m"] = values[0]
        for body in own[1:]:
            row[f"d_{body}"] = 0.0

    return Term("damping", (number,), put, "motor", nominal=(start,))


def _spring_damping(joint: Joint) -> Term:
    """Return the internal damping of the torsion bar, which is fitted and not told.

    Few datasheets state it; without it the damping of motor and load would make up for it.
    """
    file, known = joint.file, joint.parameters.get(SYMBOL, 0.0)
    most = critical(file, joint.structure_row)
    start = known or USUAL * most
    stated = tolerance_of(file, SYMBOL, math.inf)
    scale = stated if known > 0.0 and math.isfinite(stated) else GUESSED
    number = Number(SYMBOL, "N m s/rad", start, scale, True, 1e-3 * start, max(most, start))

    def put(draft: Draft, values: Sequence[float]) -> None:
        draft.parameters[SYMBOL] = values[0]

    return Term("stiffness", (number,), put, channel=SYMBOL, nominal=(start,), told=False)


def freed(terms: Sequence[Term]) -> list[Term]:
    """Return terms that release datasheet values from their narrow tolerances."""
    return [
        replace(
            term,
            numbers=(replace(number, prior=False, scale=LOOSE),),
            starts=tuple((number.start * k,) for k in (0.7, 1.4)),
            tight=term,
        )
        for term in terms
        for number in term.numbers[:1]
        if term.told and number.prior and AS_GIVEN < number.scale < VAGUE
    ]
