"""`cjt-gym joints`: what there is to choose from."""

from __future__ import annotations

import argparse
import json
import math
import sys
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from cjt_gym.errors import unknown_name
from cjt_gym.joint import (
    DRIVES,
    EFFECTS,
    STRUCTURES,
    Effect,
    EffectParameter,
    joint_names,
    load_joint_file,
)
from cjt_gym.joint.effects import PLACES
from cjt_gym.records import read_record, record_names

TABLES = ("joints", "records", "structures", "drives", "effects")
WIDTH = 100
NAME = 28
SYMBOL = 17
LEGEND = (
    "A value marked * makes the effect do something where it differs from 'off', a number or the "
    "joint's own parameter; the others only shape it. A value that is not given comes from the "
    "joint file, then from the default; 'needed' means that there is none."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to show."""
    text = f"tables ({', '.join(TABLES)}) or names in them; default: everything"
    parser.add_argument("what", metavar="WHAT", nargs="*", help=text)


def run(options: argparse.Namespace) -> None:
    """Print the tables."""
    tables = chosen(options.what)
    if options.json:
        sys.stdout.write(json.dumps(tables, indent=1, allow_nan=False) + "\n")
        return
    for line in _lines(tables):
        sys.stdout.write(line + "\n")


def chosen(what: Sequence[str]) -> dict[str, list[dict[str, Any]]]:
    """Return the tables, or the rows, of those names; all tables where none is named.

    Raises:
        UnknownNameError: There is no such table, and no such row.
    """
    tables = describe()
    names = {row["name"] for rows in tables.values() for row in rows}
    for word in what:
        if word not in tables and word not in names:
            raise unknown_name("name", word, [*tables, *names])
    if not what:
        return tables
    return {
        title: [row for row in rows if title in what or row["name"] in what]
        for title, rows in tables.items()
    }


def describe() -> dict[str, list[dict[str, Any]]]:
    """Return the joints, records, structures, drives and effects as plain values."""
    return {
        "joints": [_joint(name) for name in joint_names()],
        "records": [_record(name) for name in record_names()],
        "structures": [
            {
                "name": row.name,
                "summary": row.summary,
                "second_input": "dq_l" if row.output_fixed else "tau_l",
                "needs": list(row.needed_parameters),
            }
            for row in STRUCTURES.values()
        ],
        "drives": [{"name": name, "summary": text} for name, text in DRIVES.items()],
        "effects": [_effect(row) for row in EFFECTS.values()],
    }


def _joint(name: str) -> dict[str, Any]:
    file = load_joint_file(name)
    quantities = file.parameters.quantities
    return {
        "name": name,
        "summary": file.parameters.source.split(";")[0].split(", as in")[0],
        "axis": file.parameters.axis,
        "effects": sorted(file.effects),
        "parameters": {s: {"value": q.value, "unit": q.unit} for s, q in quantities.items()},
    }


def _record(name: str) -> dict[str, Any]:
    record = read_record(name)
    source = str(record.provenance.get("source", ""))
    return {
        "name": name,
        "summary": source.split(";")[0],
        "joint": record.joint,
        "structure": record.structure,
        "samples": len(record),
        "dt": record.dt,
        "columns": list(record.columns),
    }


def _effect(row: Effect) -> dict[str, Any]:
    pairs = [
        (structure.name, drive)
        for structure in STRUCTURES.values()
        for drive in DRIVES
        if row.acts_in(structure, drive)
    ]
    return {
        "name": row.name,
        "stage": row.stage,
        "summary": row.summary,
        "source": row.source,
        "needs": PLACES[row.needs],
        "structures": list(dict.fromkeys(structure for structure, _ in pairs)),
        "drives": [name for name in DRIVES if any(drive == name for _, drive in pairs)],
        "bodies": list(row.bodies),
        "channels": list(row.channels),
        "excludes": list(row.excludes),
        "size": list(row.size),
        "parameters": [_parameter(row, p) for p in row.parameters],
    }


def _parameter(effect: Effect, p: EffectParameter) -> dict[str, Any]:
    least, is_excluded, greatest = effect.domain(p)
    return {
        "symbol": p.symbol,
        "unit": p.unit,
        "neutral": p.neutral,
        "relative_to": p.relative_to,
        "low": p.low,
        "high": p.high,
        "minimum": least if math.isfinite(least) else None,
        "minimum_excluded": is_excluded,
        "maximum": greatest if math.isfinite(greatest) else None,
        "default": p.default,
        "joint_parameter": p.joint_parameter,
        "typical": list(p.typical) if isinstance(p.typical, tuple) else p.typical,
        "typical_of": p.typical_of,
        "series": p.series,
        "shared": p.shared,
        "description": p.description,
    }


def _lines(tables: dict[str, list[dict[str, Any]]]) -> Iterator[str]:
    """Yield the tables as text of at most `WIDTH` columns."""
    for title in TABLES[:-1]:
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
        effect = EFFECTS[row["name"]]
        yield ""
        yield from _effect_lines(effect)


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
