"""Gap, stages, verdict and unexplained part of a judgement."""

from __future__ import annotations

from collections.abc import Sequence

from cjt_gym.gap.diagnosis import (
    NOTHING_LEFT,
    Diagnosis,
    GapSize,
    NamedEffect,
    StageGap,
    Unexplained,
)
from cjt_gym.gap.horizons.findings.corrected_values import imposed, refined
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, TRIVIAL, bootstrapped, relative
from cjt_gym.gap.horizons.selection.judgement import LOUD, NEAR, Judgement, Row
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.files.effect_entries import unit_on

DRIFTLESS = 0.1
"""Relative error over a whole record of a held output, which does not drift, above which nothing
counts as explained: on simulated logs with noise that was stated wrong, no right explanation left
more."""
HALVED = 0.5
"""Ratio to the datasheet's error below which there is a gap even if no effect is named."""
SLOPED = (
    "No joint beats motion at the measured speed: predictions start from the slope of the angle."
)
"""What is said where even the best joint is worse than that."""
LEAST = "least squares"
REGRESSED = (
    ("inertia", "inertia", "I_m"),
    ("damping", "damping", "d_m"),
    ("Coulomb friction", "coulomb", "d_cm"),
    ("offset", "torque_offset", "torque"),
)
"""Name of the answer that is a regression, and its values: words, effect and symbol."""
PERHAPS = 0.5
"""Share of a squared error that seems predictable, though not surely, above which it is unknown."""
QUIET = 0.05
"""Relative error up to which nothing need be said of what is left."""
STAGES = {"q_m": "motor", "q_l": "load", "tau": "transmission"}


def stages_of(
    first: Diagnosis, judged: Judgement, effects: Sequence[NamedEffect]
) -> dict[str, StageGap]:
    """Return the stages' gaps in units of the unpredictable error, if a channel shows them.

    What acts on bodies whose channels were not recorded shows in the motor's.
    """
    out = dict(first.stages)
    shown = {STAGES[row.channel] for row in judged.rows}
    blamed = {
        e.stage if e.stage in shown else "motor" for e in effects if e.stage in STAGES.values()
    }
    for channel, stage in STAGES.items():
        rows = [r for r in judged.rows if r.channel == channel and r.floor]
        if rows:
            worst = max(rows, key=lambda r: r.datasheet / max(r.floor or 1.0, 1e-9))
            floor = max(worst.floor or 1.0, 1e-9)
            named = stage in blamed or any(r.unexplained for r in rows)
            if stage != "motor" and not named and out[stage].before > 0.0:
                continue  # what the motor does wrong shows in its predictions, too
            out[stage] = StageGap(worst.datasheet / floor, worst.found / floor, named)
    return out


def main_row(judged: Judgement) -> Row:
    """Return the row that measures the gap: the torque as a whole, or the longest horizon.

    A torque that is unpredictable, being small compared with its noise, does not measure the gap.
    """
    whole = judged.case.joint.structure_row.output_fixed
    torque = [r for r in judged.rows if r.channel == "tau"]
    heard = torque and (whole or torque[-1].floor is None or torque[-1].floor < LOUD)
    channel = "tau" if heard else "q_m"
    rows = [r for r in judged.rows if r.channel == channel]
    return next((r for r in rows if whole and r.seconds == WHOLE), rows[-1])


def gap_of(judged: Judgement) -> GapSize:
    """Return the gap on held-out data if there are any, from the row that measures it."""
    row = main_row(judged)
    before, after = row.datasheet, row.found
    removed = 1.0 - after / before if before > 0.0 else 0.0
    key = (row.channel, row.seconds)
    low, high = bootstrapped(
        judged.case.test, judged.errors["datasheet"], judged.errors[judged.answer], key
    )
    by = {
        r.channel: {"before": r.datasheet, "after": r.found}
        for r in judged.rows
        if r.seconds == row.seconds
    }
    floor = row.floor if row.floor is not None else 0.0
    return GapSize(before, after, floor, removed, low, high, judged.case.held, by)


def worst_row(judged: Judgement) -> Row:
    """Return the row with the largest error, except the shortest horizon.

    It is one of the main channel, or of the other angle of a joint with two.
    """
    main = main_row(judged)
    if main.seconds == WHOLE:
        return main
    channels = {main.channel, "q_l"} if main.channel == "q_m" else {main.channel}
    rows = [r for r in judged.rows if r.channel in channels and r.seconds > min(HORIZONS)]
    return max(rows, key=lambda r: r.found, default=main)


def verdict_of(judged: Judgement, effects: Sequence[NamedEffect], *, suspected: bool) -> str:
    """Return the verdict.

    Args:
        judged: The judgement.
        effects: Named effects.
        suspected: Whether the stages have named any effects, or could not be judged.
    """
    worst = worst_row(judged)
    loud = worst.found > (LOUD if worst.seconds != WHOLE else DRIFTLESS)
    unknown = unknown_row(judged) is not None
    open_ = bool(judged.unexplained) or loud or unknown
    if not effects:
        better = any(r.found < 0.85 * r.datasheet for r in judged.rows)
        main = main_row(judged)
        other = judged.answer == LEAST or bool(refined(judged, known=True))
        other = other and (suspected or not _is_tolerated(judged, main))
        moved = main.found < HALVED * main.datasheet > HALVED * TRIVIAL and other
        lasting = any(r.seconds > min(HORIZONS) and r.lasting for r in judged.unexplained)
        open_ = loud or unknown or (open_ and (better or suspected or lasting))
        return "unexplained" if moved or open_ else "no_gap"
    return "partly_explained" if open_ else "explained"


def _is_tolerated(judged: Judgement, row: Row) -> bool:
    """Return whether a joint within the datasheet's tolerances removes the gap as well."""
    if "stages" not in judged.errors:
        return False
    stages = relative(judged.case.test, judged.errors["stages"])
    return stages[row.channel, row.seconds] < HALVED * row.datasheet


def unknown_row(judged: Judgement) -> Row | None:
    """Return a row whose error is not small and may be predictable for all that a record shows.

    A short record has too few windows to tell; one of few motions may have too few to be sure.
    """
    worst = worst_row(judged)
    main = [r for r in judged.rows if r.channel == worst.channel and r.seconds > min(HORIZONS)]
    perhaps = [r for r in main if r.left is not None and r.left.share > PERHAPS]
    doubtful = [worst] if worst.left is None and worst.seconds != WHOLE else []
    doubtful += [r for r in perhaps if not r.unexplained]
    return next((r for r in doubtful if r.found > NEAR), None)


def unexplained_of(judged: Judgement, verdict: str, left: Sequence[Row]) -> Unexplained:
    """Return the unexplained part and its description, from rows with a predictable error."""
    rows = left if verdict != "no_gap" else ()
    row = max(rows, key=lambda r: r.found**2 * (r.left.share if r.left else 0.0), default=None)
    said = _said(judged)
    if row is None or row.left is None:
        unknown = unknown_row(judged)
        main = unknown or worst_row(judged)
        if verdict in ("explained", "no_gap"):
            known = main.left is not None or main.found < QUIET or main.seconds == WHOLE
            text = NOTHING_LEFT if known else _not_told(main)
            return Unexplained(0.0, None, f"{said} {text}".strip(), 0.0)
        share = min(main.found, 1.0) ** 2
        if unknown is not None:
            text = _not_told(unknown)
        elif main.found < QUIET:
            text = ""  # the refined values leave next to nothing
        else:
            slack = "although a held output does not drift"
            rest = slack if main.seconds == WHOLE else "and no regression predicts it either"
            text = f"{_not_predicted(main)}, {rest}."
        return Unexplained(share, STAGES[main.channel], f"{said} {text}".strip(), 0.0)
    predictable = min(row.found, 1.0) ** 2 * row.left.share
    share = row.left.share
    source, cause = "speed, angle, input and the past", ""
    if row.lasting:
        source = "the errors just before"
        cause = "something acts that lasts, such as an external torque, and "
    text = (
        f"{share:.0%} of the squared error of {row.channel} {_ahead(row)} ahead could be predicted "
        f"from {source}: {cause}no effect of the table explains it."
    )
    return Unexplained(share, STAGES[row.channel], f"{said} {text}".strip(), predictable)


def _not_predicted(row: Row) -> str:
    """Return the beginning of a sentence on the error of a row."""
    left = f"{100.0 * row.found:.{2 if row.found < 0.995 else 3}g} % is not predicted"
    return f"Of what {row.channel} does within {_ahead(row)}, {left}"


def _not_told(row: Row) -> str:
    return f"{_not_predicted(row)}; this record does not tell how much of it could be."


def _ahead(row: Row) -> str:
    return "the whole record" if row.seconds == WHOLE else f"{row.seconds:g} s"


def _said(judged: Judgement) -> str:
    """Return sentences on where predictions start, and on an answer without named effects."""
    sloped = any(log.from_slope for log in judged.case.logs)
    return f"{SLOPED if sloped else ''} {of_answer(judged)}".strip()


def of_answer(judged: Judgement) -> str:
    """Return a sentence on the answer if it is not a joint with named effects."""
    if judged.answer == LEAST:
        *most, last = (_regressed(judged.joint, *one) for one in REGRESSED)
        told = f"{', '.join(most)} and {last}"
        return f"Nothing predicts better than least squares on {told}: that is the joint given."
    if judged.answer == "datasheet":
        return "Nothing was found that predicts better than the datasheet."
    return imposed(judged)


def _regressed(joint: Joint, words: str, effect: str, symbol: str) -> str:
    """Return a value of the least-squares joint in words."""
    parameter = EFFECTS[effect].parameter(symbol)
    assert parameter is not None
    unit = unit_on(parameter, joint.parameters)
    return f"{words} ({joint.effects[effect][symbol]:.3g} {unit})"
