"""The tables of `cjt-gym joints` as text: a summary, and whole rows."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from cjt_gym.joint import EFFECTS, PARAMETERS, STAGES, Effect, EffectParameter, load_joint_file
from cjt_gym.joint.effects import PLACES
from cjt_gym.joint.files.quantity import Quantity

Tables = dict[str, list[dict[str, Any]]]
TABLES = ("joints", "records", "structures", "drives", "effects")
WIDTH = 100
NAME = 28
SYMBOL = 17
LEGEND = (
    "A value marked * makes the effect do something where it differs from 'off', a number or the "
    "joint's own parameter; the others only shape it. A value that is not given comes from the "
    "joint file, then from the default; 'needed' means that there is none."
)
MORE = (
    "cjt-gym joints NAME shows the numbers of a joint, of a joint file or of an effect; "
    "cjt-gym joints effects shows a whole table, --json everything."
)


def summary_lines(tables: Tables) -> Iterator[str]:
    """Yield a line for every joint, record, structure and drive, and the effects by stage."""
    for title in TABLES[:-1]:
        yield title.capitalize()
        for row in tables[title]:
            text = textwrap.shorten(row["summary"], WIDTH - NAME - 3, placeholder=" ...")
            yield f"  {row['name']:{NAME}s} {text}"
        yield ""
    yield "Effects"
    for stage in STAGES:
        names = ", ".join(row["name"] for row in tables["effects"] if row["stage"] == stage)
        yield from _wrapped(f"  {stage:{NAME}s} ", names)
    yield ""
    yield from _wrapped("", MORE)


def detail_lines(tables: Tables) -> Iterator[str]:
    """Yield the full description of the rows."""
    if tables["joints"]:
        yield "Joints"
    for row in tables["joints"]:
        yield from _joint_lines(row)
        yield ""
    for title in TABLES[1:-1]:
        if not tables[title]:
            continue
        yield title.capitalize()
        for row in tables[title]:
            yield from _wrapped(f"  {row['name']:{NAME}s} ", row["summary"])
        yield ""
    if not tables["effects"]:
        return
    yield "Effects"
    yield from _wrapped("  ", LEGEND)
    for row in tables["effects"]:
        yield ""
        yield from _effect_lines(EFFECTS[row["name"]])


def _joint_lines(row: Mapping[str, Any]) -> Iterator[str]:
    file = load_joint_file(row["name"])
    p = file.parameters
    yield from _wrapped(f"  {row['name']:{NAME}s} ", p.source)
    said = [f"{p.axis} axis", file.structure or "", f"drive {file.drive}" if file.drive else ""]
    yield from _wrapped(" " * (NAME + 3), ", ".join(filter(None, said)))
    for symbol, quantity in p.quantities.items():
        description = PARAMETERS[symbol].description
        yield from _wrapped(f"    {symbol:9s} {_value(quantity):24s} ", description)
    if {"k_b", "I_m"} <= set(p.quantities):
        inertia = sum(getattr(p, symbol) for symbol in ("I_m", "I_g") if symbol in p.quantities)
        frequency = math.sqrt(p.k_b / inertia) / (2.0 * math.pi)
        what = "at which motor and gear swing on the torsion bar with the output locked"
        yield from _wrapped(f"    {'':9s} {f'{frequency:.3g} Hz':24s} ", what)
    for title, table in (("effect", file.effects), ("sensor", file.sensors)):
        for name, entries in table.items():
            numbers = ", ".join(
                f"{key} {_value(entry) if isinstance(entry, Quantity) else entry}"
                for key, entry in entries.items()
            )
            yield from _wrapped(f"    {title} {name}  ", numbers or "on")


def _value(quantity: Quantity) -> str:
    values = quantity.value if isinstance(quantity.value, tuple) else (quantity.value,)
    text = (
        f"{', '.join(f'{x:.6g}' for x in values)} {'' if quantity.unit == '-' else quantity.unit}"
    )
    if quantity.guess:
        return f"{text.strip()} (guess)"
    share = "" if quantity.tolerance is None else f" +-{100.0 * quantity.tolerance:.3g} %"
    return f"{text.strip()}{share}"


def _effect_lines(effect: Effect) -> Iterator[str]:
    yield from _wrapped(f"  {effect.name:{NAME}s} ", f"{effect.stage}: {effect.summary}")
    place = PLACES[effect.needs]
    notes = [f"acts {place}" if not effect.needs else f"acts in {place}"]
    for title in ("bodies", "channels", "excludes"):
        names = getattr(effect, title)
        if names:
            notes.append(f"{title} {', '.join(names)}")
    yield from _wrapped(" " * (NAME + 3), "; ".join(notes))
    for p in effect.parameters:
        star = "*" if p.symbol in effect.size else " "
        head = f"    {star} {p.symbol:{SYMBOL}s} {p.unit:12s}"
        span = f"{p.low:g} .. {p.high:g}"
        off = f"off {off_in_words(p)}" if p.symbol in effect.size else ""
        yield f"{head} {off:11s} range {span:16s} default {default_in_words(effect, p)}"
        notes = [p.description, f"typical {typical_in_words(p)}", domain_in_words(effect, p)]
        if p.joint_parameter is not None:
            notes.append(f"in the joint file {p.joint_parameter}")
        if p.series:
            notes.append("a list of numbers")
        if p.shared:
            notes.append("one number per joint, shared by all effects")
        yield from _wrapped(" " * (SYMBOL + 7), "; ".join(notes))


def off_in_words(p: EffectParameter) -> str:
    """Return the value at which an effect is off: a number or a parameter of the joint."""
    return p.relative_to if p.relative_to is not None else f"{p.neutral or 0.0:g}"


def domain_in_words(effect: Effect, p: EffectParameter) -> str:
    """Return which values a parameter may have."""
    least, is_excluded, greatest = effect.domain(p)
    bounds = []
    if math.isfinite(least):
        bounds.append(f"{'>' if is_excluded else '>='} {least:g}")
    if math.isfinite(greatest):
        bounds.append(f"<= {greatest:g}")
    return f"must be {' and '.join(bounds)}" if bounds else "any sign"


def default_in_words(effect: Effect, p: EffectParameter) -> str:
    """Return what a parameter is that neither the user nor the joint file gives."""
    if p.default is not None:
        return f"{p.default:g}"
    if p.relative_to is not None and len(effect.size) > 1:
        return p.relative_to
    return "needed"


def typical_in_words(p: EffectParameter) -> str:
    """Return a typical value with what it is a multiple of."""
    values = p.typical if isinstance(p.typical, tuple) else (p.typical,)
    text = ", ".join(f"{x:g}" for x in values)
    if not p.typical_of or not any(values):
        return text
    of = {"torque": "peak torque", "current": "peak current"}.get(p.typical_of, p.typical_of)
    return f"{text} x {of}"


def _wrapped(head: str, text: str) -> list[str]:
    """Return a text behind a head, with the following lines indented to where it began."""
    return textwrap.wrap(
        text,
        WIDTH,
        initial_indent=head,
        subsequent_indent=" " * len(head),
        break_long_words=False,
        break_on_hyphens=False,
    )
