"""A diagnosis on a terminal, and at a glance in a notebook."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from html import escape

from cjt_gym.gap.diagnosis import NOTHING_LEFT, Diagnosis, NamedEffect, StageGap
from cjt_gym.gap.report.horizons import horizon_table
from cjt_gym.gap.report.words import (
    SPACE,
    VERDICTS,
    interval,
    joined,
    noise_floor,
    number,
    percent,
    verdict_sentence,
)

WIDTH = 96
MOST_EFFECTS = 5


def summary(diagnosis: Diagnosis) -> str:
    """Return a diagnosis as plain text of at most 60 lines."""
    gap, explained = diagnosis.gap, bool(diagnosis.effects)
    refined = explained or gap.after != gap.before
    title = VERDICTS[diagnosis.verdict].upper()
    lines = textwrap.wrap(f"{title}. {verdict_sentence(diagnosis)}", WIDTH, max_lines=6)
    kept = "held-out data" if gap.held_out else "the fitted data"
    after = f"after {percent(gap.after)}   " if refined else ""
    before = f"{'before ' if refined else ''}{percent(gap.before)}"
    lines += ["", f"gap on {kept}   {before}   {after}noise floor {noise_floor(gap)}"]
    head = f"{'before':>10}{'after':>10}" if refined else f"{'residual':>10}"
    lines += [f"{'stage':<14}{head}   (residual, 1 = noise)"]
    for name, stage in diagnosis.stages.items():
        if stage.before > 0.0 and name != "sensing":
            lines.append(_stage(name, stage, refined))
    if explained:
        lines += [f"{'effect':<20}{'status':<11}{'confidence':>10}{'evidence':>9}  parameters"]
        lines += [line for e in diagnosis.effects[:MOST_EFFECTS] for line in _row(e)]
        lines += _doubts(diagnosis.effects[:MOST_EFFECTS])
    if (ahead := horizon_table(diagnosis)) is not None:
        lines += ["", *ahead.text(WIDTH).splitlines(), ""]
    if diagnosis.unexplained.text != NOTHING_LEFT:
        lines += _sentences(f"left: {diagnosis.unexplained.text}", 4)
    lines += _sentences(f"next: {diagnosis.suggestion.text}", 5)
    return "\n".join(lines)


def _sentences(text: str, most: int) -> list[str]:
    """Return text as lines, without its last sentences where there would be too many."""
    lines = textwrap.wrap(text, WIDTH)
    while len(lines) > most and ". " in text:
        text = text.rsplit(". ", 1)[0] + "."
        lines = textwrap.wrap(f"{text} More in the report.", WIDTH)
    return lines[:most]


def _stage(name: str, stage: StageGap, refined: bool) -> str:
    after = f"{number(stage.after):>10}" if refined else ""
    mark = "  <- gap" if stage.significant else ""
    return f"{name:<14}{number(stage.before):>10}{after}{mark}"


def _row(effect: NamedEffect) -> list[str]:
    """Return an effect as lines, with as many of its numbers as three lines hold."""
    name = effect.name if effect.channel is None else f"{effect.name} ({effect.channel})"
    numbers = (f"{k} = {interval(p)}".replace(" ", SPACE) for k, p in effect.parameters.items())
    head = f"{name:<20}{effect.status:<11}{effect.confidence:>10.2f}"
    head += f"{percent(effect.gap_removed):>9}  "
    width = max(WIDTH - len(head), 20)
    first, *more = textwrap.wrap(", ".join(numbers), width, max_lines=3, placeholder=" …")
    return [head + first, *(" " * len(head) + line for line in more)]


def _doubts(effects: Sequence[NamedEffect]) -> list[str]:
    """Return why effects are tentative, those of one reason together, and what looks alike."""
    names: dict[str, dict[str, None]] = {}  # each once, though it may act on several channels
    for effect in effects:
        if effect.doubt:
            names.setdefault(effect.doubt, {})[effect.name] = None
    said = [f"{joined(list(some))}: tentative, as {why}" for why, some in names.items()]
    for effect in effects:
        rivals = [name for name in effect.confusable_with if name not in effect.doubt]
        if effect.status == "tentative" and rivals:
            said.append(f"{effect.name}: {joined(rivals, 'or')} may take its place")
    said = list(dict.fromkeys(said))
    return [textwrap.shorten(line, WIDTH, placeholder=" …") for line in said]


def face(diagnosis: Diagnosis) -> str:
    """Return a diagnosis as a few lines of HTML, for a notebook."""
    rows = "".join(
        f"<tr><td>{escape(e.name)}</td><td>{escape(e.body or e.channel or '')}</td>"
        f"<td>{escape(', '.join(f'{k} = {interval(p)}' for k, p in e.parameters.items()))}</td>"
        f"<td>{escape(e.status)}</td><td>{e.confidence:.2f}</td></tr>"
        for e in diagnosis.effects
    )
    head = "<tr><th>effect<th>where<th>parameters<th>status<th>confidence</tr>"
    table = f"<table>{head}{rows}</table>" if rows else ""
    title = escape(VERDICTS[diagnosis.verdict])
    return f"<p><b>{title}.</b> {escape(verdict_sentence(diagnosis))}</p>{table}"
