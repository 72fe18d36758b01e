"""The report as one self-contained HTML file."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from html import escape
from importlib import metadata, resources

from cjt_gym.gap.candidates.separated import advice
from cjt_gym.gap.diagnosis import NOTHING_LEFT, Diagnosis, NamedEffect
from cjt_gym.gap.report.bars import confidence_bar, regime_strips, stage_bars, waterfall
from cjt_gym.gap.report.drawing import with_own_ids
from cjt_gym.gap.report.figures import (
    friction_charts,
    replay_charts,
    ripple_charts,
    spring_charts,
)
from cjt_gym.gap.report.horizons import TITLE, examined, horizon_table
from cjt_gym.gap.report.table import Table
from cjt_gym.gap.report.words import (
    CHANNELS,
    VERDICTS,
    effect_name,
    error_of,
    interval,
    noise_floor,
    number,
    percent,
    verdict_sentence,
)

ONE_BODY = {"inertia": ("load_inertia",), "coulomb": ("load_coulomb",)}
"""Effects that are one where motor and load are."""
PACKAGES = ("cjt-gym", "numpy", "scipy", "numba")


def page(
    diagnosis: Diagnosis, title: str, notes: Sequence[str] = (), tables: Sequence[Table] = ()
) -> str:
    """Return the whole page as text; the arguments are those of `write_report`."""
    style = (resources.files(__package__) / "style.css").read_text(encoding="utf-8")
    ahead = horizon_table(diagnosis)
    sections = (
        ("Measured against replayed", "signals", _signals(diagnosis)),
        (TITLE, "horizons", "" if ahead is None else ahead.html()),
        ("What the record can tell", "record", examined(diagnosis)),
        ("How far", "how-far", _how_far(diagnosis)),
        ("Where", "where", _where(diagnosis)),
        ("Which effect", "which", _which(diagnosis)),
        ("Maps of the fitted record", "maps", _maps(diagnosis)),
        *((table.title, f"table-{k}", table.html()) for k, table in enumerate(tables)),
        ("What it could be confused with", "confusable", _confusable(diagnosis)),
        ("What remains unexplained", "left", _left(diagnosis)),
        ("What to do next", "next", _paragraph(diagnosis.suggestion.text)),
        ("Notes on the records", "notes", _list(notes)),
        ("How it was computed", "computed", _computed(diagnosis)),
    )
    body = "".join(
        f"<section id={key}><h2>{heading}</h2>{content}</section>"
        for heading, key, content in sections
        if content
    )
    return (
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width,initial-scale=1'>"
        "<meta name=color-scheme content='light dark'>"
        f"<title>{escape(title)}</title><style>{style}</style></head><body><main>"
        f"{_head(diagnosis, title)}{with_own_ids(body)}</main></body></html>\n"
    )


def _head(diagnosis: Diagnosis, title: str) -> str:
    gap, source = diagnosis.gap, diagnosis.evidence.source
    figures = [("gap", percent(gap.before)), ("noise floor", noise_floor(gap))]
    if diagnosis.effects or gap.after != gap.before:
        figures = [("gap before", figures[0][1]), ("gap after", percent(gap.after)), figures[1]]
        spread = f"{percent(gap.low)} … {percent(gap.high)}"
        removed = f"{error_of(diagnosis)} removed".removeprefix("the ")
        figures.append((removed, f"{percent(gap.removed)}<small>{spread}</small>"))
    tiles = "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in figures)
    about = " · ".join(escape(text) for text in (source.joint, source.structure) if text)
    return (
        f"<header><h1>{escape(title)}</h1><p class=about>{about}</p>"
        f"<div class='verdict {diagnosis.verdict}'><strong>{VERDICTS[diagnosis.verdict]}</strong>"
        f"<p>{escape(verdict_sentence(diagnosis))}</p></div><dl class=tiles>{tiles}</dl></header>"
    )


def _how_far(diagnosis: Diagnosis) -> str:
    steps = diagnosis.evidence.ladder
    if not steps:
        return ""
    kept = "data that the fit has not seen" if diagnosis.gap.held_out else "the fitted data"
    channel = next(text for name, text in CHANNELS.items() if name in diagnosis.gap.by_channel)
    aid = f"Error of the replayed {channel} on {kept}, relative to the signal. "
    if diagnosis.effects:
        aid += "Each bar adds one effect; hatched is what it removed. "
    aid += "Whiskers are 95 % intervals, the dashed line is what noise alone leaves."
    return _aid(aid) + waterfall(steps, diagnosis.gap)


def _where(diagnosis: Diagnosis) -> str:
    explained = bool(diagnosis.effects)
    drawn = stage_bars(diagnosis.stages, explained)
    if not drawn:
        return ""
    aid = "Residual of each stage between measured ends, in units of what the specified noise "
    bars = _aid(f"{aid}explains: 1, the dashed line, is a perfect model.") + drawn
    if diagnosis.verdict == "no_gap":
        return bars
    regimes = diagnosis.evidence.regimes
    maps = [
        f"<h3>Inside the {escape(stage)} stage</h3>"
        + regime_strips(before, after if explained and after else None)
        for stage, (before, after) in regimes.items()
    ]
    if not maps:
        return bars
    aid = "Shares of the stage's gap over one variable at a time; each panel adds up to 100 %."
    if explained and any(after for _, after in regimes.values()):
        aid += " In front, what is left of it with the named effects."
    return bars + _aid(aid) + "".join(maps)


def _which(diagnosis: Diagnosis) -> str:
    if not diagnosis.effects:
        return ""
    rows = "".join(_effect(effect) for effect in diagnosis.effects)
    return (
        _aid(
            "Numbers with their 95 % intervals; confidence is the chance that the name is right; "
            "a tentative effect may be the shadow of something that the table lacks. The share of "
            "evidence is how much of the proof of a gap comes back if this effect alone is left "
            "out; how far the replay improves stands above."
        )
        + "<div class=wide><table><thead><tr><th>effect</th><th>parameters</th><th>status</th>"
        "<th>confidence</th><th>share of evidence</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
    )


def _effect(effect: NamedEffect) -> str:
    at = " · ".join(x for x in (f"{effect.stage} stage", effect.channel) if x)
    numbers = "".join(
        f"<div><var>{escape(name)}</var> {escape(interval(p))}</div>"
        for name, p in effect.parameters.items()
    )
    name = effect_name(effect.name, effect.body, effect.channel)
    cells = (
        ("", f"<b>{escape(effect.name)}</b><small>{escape(name)}<br>{escape(at)}</small>"),
        ("", numbers),
        ("status", _status(effect)),
        ("confidence", confidence_bar(effect.confidence)),
        ("share of evidence", percent(effect.gap_removed)),
    )
    row = "".join(
        f"<td{f' data-head={head!r}' if head else ''}>{cell}</td>" for head, cell in cells
    )
    return f"<tr>{row}</tr>"


def _status(effect: NamedEffect) -> str:
    why = f"<small>{escape(effect.doubt)}</small>" if effect.doubt else ""
    return f"<span class='pill {effect.status}'>{escape(effect.status)}</span>{why}"


def _signals(diagnosis: Diagnosis) -> str:
    charts = replay_charts(diagnosis)
    if not charts:
        return ""
    again = diagnosis.evidence.restarted
    aid = f"Predictions of {number(again)} s each" if again else "Open-loop replay"
    aid += " under the recorded input. The shaded stretch, in which the datasheet's error is "
    aid += "largest, is shown enlarged."
    return _aid(aid) + "".join(charts)


def _maps(diagnosis: Diagnosis) -> str:
    maps = [*friction_charts(diagnosis), *ripple_charts(diagnosis), *spring_charts(diagnosis)]
    return f"<div class=maps>{''.join(maps)}</div>" if maps else ""


def _confusable(diagnosis: Diagnosis) -> str:
    pairs = [(e, rival) for e in diagnosis.effects for rival in e.confusable_with]
    one = diagnosis.evidence.source.structure == "rigid"
    items = [
        _same(effect.name, rival)
        if one and rival in ONE_BODY.get(effect.name, ())
        else _pair(effect.name, rival, diagnosis.suggestion.text)
        for effect, rival in pairs
    ]
    return f"<ul>{''.join(items)}</ul>" if items else ""


def _same(name: str, rival: str) -> str:
    return (
        f"<li><b>{escape(name)}</b> or <b>{escape(rival)}</b>: motor and load are one body here, "
        "so that no record tells them apart.</li>"
    )


def _pair(name: str, rival: str, suggestion: str) -> str:
    how = advice(name, rival)
    return (
        f"<li><b>{escape(name)}</b> or <b>{escape(rival)}</b> ({escape(effect_name(rival))}): on "
        f"this record both explain nearly as much. {'' if how in suggestion else escape(how)}</li>"
    )


def _left(diagnosis: Diagnosis) -> str:
    text = diagnosis.unexplained.text
    return "" if text == NOTHING_LEFT else _paragraph(text)


def _computed(diagnosis: Diagnosis) -> str:
    source = diagnosis.evidence.source
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
    rows = [
        ("fitted", source.fitted),
        ("held out" if diagnosis.gap.held_out else "replayed, not held out", source.held_out),
        ("nominal joint", (source.joint,)),
        ("structure", (source.structure,)),
        ("computed in", (f"{number(diagnosis.seconds)} s",)),
        ("versions", (f"{versions}, Python {platform.python_version()}",)),
    ]
    cells = "".join(
        f"<div><dt>{name}</dt><dd>{'<br>'.join(escape(line) for line in lines)}</dd></div>"
        for name, lines in rows
        if any(lines)
    )
    return f"<dl class=facts>{cells}</dl>"


def _aid(text: str) -> str:
    return f"<p class=aid>{escape(text)}</p>"


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>" if text else ""


def _list(lines: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>" if lines else ""
