"""What of the stages' diagnosis stands beside what its joint predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import pi

from cjt_gym.gap.check.torque import KNOWN_TORQUE
from cjt_gym.gap.diagnosis import (
    ENOUGH,
    EVEN_CHANCE,
    MUCH_LEFT,
    NOTHING_LEFT,
    Diagnosis,
    Interval,
    NamedEffect,
    Unexplained,
    told_symbols,
)
from cjt_gym.gap.horizons.findings.as_diagnosis import horizons_of
from cjt_gym.gap.horizons.findings.corrected_values import LATE, corrected, gave_way, left_tolerance
from cjt_gym.gap.horizons.findings.found_joint import found_at
from cjt_gym.gap.horizons.findings.held_output import held_alike
from cjt_gym.gap.horizons.findings.late_drive import with_late_drive
from cjt_gym.gap.horizons.findings.misfit import Wider, widened
from cjt_gym.gap.horizons.findings.verdict import DRIFTLESS, main_row, unexplained_of
from cjt_gym.gap.horizons.prediction.case import as_joint
from cjt_gym.gap.horizons.prediction.model import MEASURES
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, TRIVIAL, relative
from cjt_gym.gap.horizons.selection.judgement import CLOSE, LOUD, NEAR, Judgement, Row
from cjt_gym.gap.horizons.torque.inverse import drag_law
from cjt_gym.gap.recorded.tolerances import OUTSIDE, common_deviation, is_left_open
from cjt_gym.joint import EFFECTS, JointFile
from cjt_gym.joint.files.quantity import Quantity, freeze

BETTER = 0.95
"""Relative error, as a fraction of the datasheet's, that at least one horizon must fall below for
an effect to be confirmed."""
AS_GOOD = 1.1
"""Ratio of errors up to which a delay predicts as well as a lag, or the reverse."""
GAVE_WAY = "a value of the datasheet had to leave its tolerance beside it"
HALF, FLOORS = 0.5, 5.0
"""Limits on the ratio of an error to the datasheet's, and on that to the noise floor. A held output
counts as unexplained if it exceeds the second, and the first or `DRIFTLESS`."""
GONE = 0.2
"""Ratio to the datasheet's error below which the stages' effects stay confirmed nevertheless."""
MOSTLY = 0.5
"""Predictable share of the squared error above which the stages' effects explain too little."""
DRAGS = ("damping", "viscous_asym")
"""Effects whose drag grows in proportion to the speed."""
OF_VALUES = {
    "k_t": "torque_constant", "k_b": "stiffness", "k_g": "gear_stiffness", "I_l": "load_inertia"
}  # fmt: skip
"""Effects that are no more than a value of the datasheet."""
ABOVE_THE_NOISE = "what is left is above the noise that the joint file states"
"""Doubt of a value whose stage does not come down to its noise."""


def standing(first: Diagnosis, found: Judgement) -> Diagnosis:
    """Return the stages' diagnosis as far as the predictions of its joint, the answer, bear out."""
    known: dict[str, object] = {**first.joint.found, **found_at(found)}
    commanded = found.case.logs[0].wanted is not None and LATE & first.joint.effects.keys()
    if commanded and isinstance(table := known.get("input"), Mapping):
        known["input"] = {**table, "share": 0.0}  # its drive takes commands, which are held
    first = replace(first, joint=replace(first.joint, found=freeze(known)))
    told = _held(_doubted(_cleared(first, found), found), found)
    file = found.case.joint.file
    common = common_deviation(file, cut=found.cut_by_torque, but=told_symbols(told.effects))
    told = widened(told, Wider(found.misfit, common), _aside(told, found))
    told = with_drag(with_late_drive(told, found), found)
    told = _with_stated_value(told, found)
    strained = gave_way(found, told.effects)
    if strained:
        effects = (e if e.name in MEASURES else e.doubted(GAVE_WAY) for e in told.effects)
        advice = replace(told.suggestion, text=_instead(told.suggestion.text))
        told = replace(told, effects=tuple(effects), suggestion=advice)
    text = " ".join(filter(None, (corrected(found), strained, told.unexplained.text)))
    told = replace(told, unexplained=replace(told.unexplained, text=text))
    return replace(told, horizons=horizons_of(found))


def with_drag(told: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis that confirms no damping where the drag has another law."""
    law = drag_law(found.case.joint, found.case.logs)
    if not law or any(e.name == "stribeck" and e.status == "confirmed" for e in told.effects):
        return told
    why = f"the drag grows {law} than in proportion to the speed"
    effects = (e.doubted(why) if e.name in DRAGS else e for e in told.effects)
    return replace(told, effects=tuple(effects))


def without_open(first: Diagnosis, file: JointFile) -> Diagnosis:
    """Return a diagnosis in which datasheet values that are left open are no causes."""
    effects = tuple(
        e
        for e in first.effects
        if not is_left_open(file, e.name, {s: one.value for s, one in e.parameters.items()})
    )
    if effects == first.effects:
        return first
    if effects or first.unexplained.share:
        verdict = first.verdict if effects else "unexplained"
        return replace(first, verdict=verdict, effects=effects)
    return first.without_gap()


def _cleared(first: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis without a gap if no part of the remaining error is predictable.

    Without a measured torque, a motor's one-step predictor does not know the torque of its spring.
    """
    open_ = (
        found.cut_by_torque or found.unexplained or any(row.left is None for row in found.rows[-1:])
    )
    if first.verdict != "unexplained" or first.effects or open_:
        return first
    return replace(first.without_gap(), unexplained=Unexplained(0.0, None, NOTHING_LEFT, 0.0))


def _doubted(first: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis that confirms and explains nothing unless predictions improve.

    Effects of sensors, and of a drive whose current was measured, do not change what is predicted.
    Effects with memory, such as temperature, show in the replay of a whole record rather than in
    its pieces.
    """
    gap = first.gap
    better = gap.after < BETTER * gap.before or any(
        row.found < BETTER * row.datasheet for row in found.rows
    )
    worse = gap.after > gap.before > TRIVIAL
    held = found.case.joint.structure_row.output_fixed
    far_off = held and gap.after > max(
        min(DRIFTLESS, HALF * gap.before), FLOORS * gap.floor, TRIVIAL
    )
    adrift = not held and any(
        row.found > 1.0
        for row in found.rows
        if row.channel != "tau" and row.seconds > min(HORIZONS)
    )
    main = main_row(found)
    left = gap.after if far_off else min(main.found, gap.after)
    predictable = [row for row in found.rows if _is_predictable(row) and not found.cut_by_torque]
    sound = better and not (worse or far_off or adrift) and left < LOUD
    aside = _aside(first, found)
    unmoved = all(e.name in aside for e in first.effects) and main.found < NEAR
    unsure = all(e.name in aside or e.status == "tentative" for e in first.effects)
    mostly = gap.after > max(HALF * gap.before, FLOORS * gap.floor)
    mostly = mostly and unsure and not unmoved and main.found > HALF * main.datasheet
    if not first.effects or ((sound or unmoved) and not (predictable or mostly)):
        return first
    kept = sound and main.found < GONE * main.datasheet
    effects = tuple(e if kept or e.name in aside else e.doubted(MUCH_LEFT) for e in first.effects)
    said = f"With the named effects {min(left, 1.0):.0%} of what was measured is left."
    if first.verdict != "explained":
        said = f"{said[:-1]} in a replay of the held-out record. " if far_off else ""
        open_ = replace(first.unexplained, text=said + first.unexplained.text)
        return replace(first, effects=effects, unexplained=open_)
    if not better or worse:
        said = f"{said[:-1]}: they do not make predictions better."
    elif predictable:
        said = unexplained_of(found, "partly_explained", predictable).text
    elif mostly:
        said = f"Most of the gap is left: {gap.after / gap.before:.0%} of it in a replay."
    elif adrift:
        said = "Further ahead the joint given predicts no better than going on at the same speed."
    text = first.unexplained.text.replace(NOTHING_LEFT, "").strip()
    told = replace(first.unexplained, share=min(left, 1.0), text=f"{said} {text}".strip())
    return replace(first, verdict="partly_explained", effects=effects, unexplained=told)


def _aside(first: Diagnosis, found: Judgement) -> set[str]:
    """Return the effects that do not change what is predicted.

    These are effects of sensors, and those of a drive whose current was measured.
    """
    measured = found.case.logs[0].drive == "i"
    return {
        e.name for e in first.effects if e.name in MEASURES or (measured and e.stage == "drive")
    }


def _held(first: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis that does not confirm what the record does not tell from others."""
    effects = []
    for effect in first.effects:
        alike = held_alike(effect.name, found.joint, found.case.logs[0])
        if effect.name in LATE and _may_be_another(found, effect.name):
            alike = (*alike, *(LATE - {effect.name}))
        if alike:
            said = f"{' or '.join(alike)} may take its place"
            effect = effect.doubted(said).or_else(alike)
        effects.append(effect)
    return replace(first, effects=tuple(effects))


def _may_be_another(found: Judgement, name: str) -> bool:
    """Return whether a delay predicts as well as the lag that the stages found, or the reverse.

    Without the measured current only steps of the command tell them apart, and the held-out record
    may have such while the fitted one has none.
    """
    case, file, (other,) = found.case, found.joint.file, LATE - {name}
    if case.logs[0].drive == "i" or name not in file.effects or other in file.effects:
        return False
    (own,) = (x for x in file.effects[name].values() if isinstance(x, Quantity))
    (number,) = EFFECTS[other].parameters  # a lag is as late as its time constant, 1 / (2 pi f)
    rows = {number.symbol: Quantity(1.0 / (2.0 * pi * own.number), number.unit, "as late")}
    kept = {key: row for key, row in file.effects.items() if key != name}
    joint = as_joint(replace(file, effects={**kept, other: rows}), case)
    one, two = (relative(case.test, case.test.errors(j)) for j in (found.joint, joint))
    return all(two[key] < AS_GOOD * one[key] for key in one)


def _is_predictable(row: Row) -> bool:
    """Return whether most of an error seems predictable.

    It must not be small, and over the shortest horizon, which depends on the measured start, large.
    """
    least = NEAR if row.seconds > min(HORIZONS) else LOUD
    return row.found > least and row.left is not None and row.left.share > MOSTLY


def _with_stated_value(told: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis that names the one stated value that left its tolerance.

    The stages refine a value before they look for effects. If what they leave is then more than the
    noise that is stated, they explain nothing, though nothing could predict better.
    """
    left, main = left_tolerance(found, told.effects), main_row(found)
    other = [e for e in told.effects if e.name not in MEASURES and e.stage != "drive"]
    ahead = [row for row in found.rows if row.seconds > min(HORIZONS)]
    best = all(row.found < max(CLOSE * (row.floor or 0.0), TRIVIAL) for row in ahead)
    if len(left) != 1 or other or not best or main.found > GONE * main.datasheet:
        return told
    (one,) = left
    name = OF_VALUES.get(one.symbols[0])
    if name is None or told.verdict not in ("partly_explained", "unexplained"):
        return told
    half = OUTSIDE * one.spread * one.value
    numbers = {one.symbols[0]: Interval(one.value, one.value - half, one.value + half, one.unit)}
    effect = NamedEffect(
        name, EFFECTS[name].stage, None, None, numbers, "tentative", EVEN_CHANCE,
        1.0 - (main.found / main.datasheet) ** 2, (), doubt=ABOVE_THE_NOISE,
    )  # fmt: skip
    text = "Nothing could predict better, but the stages leave more than the noise that is stated."
    open_ = Unexplained(0.0, None, text, 0.0, told.unexplained.missing)
    return replace(told, verdict="explained", effects=(effect, *told.effects), unexplained=open_)


def _instead(advice: str) -> str:
    """Return advice that begins with what would tell which value of the datasheet is off."""
    return KNOWN_TORQUE if advice == ENOUGH else f"{KNOWN_TORQUE} {advice}"
