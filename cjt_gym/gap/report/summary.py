"""A diagnosis on a terminal, and at a glance in a notebook."""

from __future__ import annotations

import textwrap
from html import escape

from cjt_gym.gap.diagnosis import Diagnosis, NamedEffect
from cjt_gym.gap.report.words import VERDICTS, interval, number, percent, verdict_sentence

WIDTH = 96
MOST_EFFECTS = 5


def summary(diagnosis: Diagnosis) -> str:
    """Return a diagnosis as plain text of at most 25 lines.

    Args:
        diagnosis: What is told.
    """
    gap = diagnosis.gap
    title = VERDICTS[diagnosis.verdict].upper()
    lines = textwrap.wrap(f"{title}. {verdict_sentence(diagnosis)}", WIDTH, max_lines=4)
    kept = "held-out data" if gap.held_out else "the fitted data"
    lines += [
        "",
        f"gap on {kept}   before {percent(gap.before)}   after {percent(gap.after)}   "
        f"noise floor {percent(gap.floor)}",
    ]
    rows = [(n, s) for n, s in diagnosis.stages.items() if s.before > 0.0 and n != "sensing"]
    lines += [f"{'stage':<14}{'before':>9}{'after':>9}   (residual, 1 = noise)"]
    for name, stage in rows:
        mark = "  <- gap" if stage.significant else ""
        lines.append(f"{name:<14}{number(stage.before):>9}{number(stage.after):>9}{mark}")
    if diagnosis.effects:
        lines += [f"{'effect':<20}{'status':<11}{'confidence':>10}{'removes':>9}  parameters"]
        lines += [_row(effect) for effect in diagnosis.effects[:MOST_EFFECTS]]
    if diagnosis.unexplained.stage is not None:
        lines += textwrap.wrap(f"left: {diagnosis.unexplained.text}", WIDTH, max_lines=2)
    lines += textwrap.wrap(f"next: {diagnosis.suggestion.text}", WIDTH, max_lines=2)
    return "\n".join(lines)


def _row(effect: NamedEffect) -> str:
    name = effect.name if effect.channel is None else f"{effect.name} ({effect.channel})"
    numbers = ", ".join(f"{k} = {interval(p)}" for k, p in effect.parameters.items())
    head = f"{name:<20}{effect.status:<11}{effect.confidence:>10.2f}"
    head += f"{percent(effect.gap_removed):>9}  "
    return head + textwrap.shorten(numbers, max(WIDTH - len(head), 20), placeholder=" …")


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
