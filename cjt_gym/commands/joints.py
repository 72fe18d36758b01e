"""`cjt-gym joints`: the joints, structures, drives and effects to choose from."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from cjt_gym.console import Answer
from cjt_gym.console.joint_tables import TABLES, detail_lines, summary_lines
from cjt_gym.console.options import drive_of, structure_of
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
from cjt_gym.joint.configure import check_effects
from cjt_gym.joint.effects import PLACES
from cjt_gym.joint.files.joint_file import is_path
from cjt_gym.joint.structures import get_structure
from cjt_gym.records import read_record, record_names


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to show."""
    text = f"names, paths of joint files, or whole tables ({', '.join(TABLES)}); default: a summary"
    parser.add_argument("what", metavar="WHAT", nargs="*", help=text)


def run(options: argparse.Namespace) -> Answer:
    """Print the tables."""
    tables = chosen(options.what)
    lines = detail_lines(tables) if options.what else summary_lines(tables)
    return tables, "\n".join(lines)


def chosen(what: Sequence[str]) -> dict[str, list[dict[str, Any]]]:
    """Return the tables, or the rows, of those names; all tables where none is named."""
    tables = describe()
    paths = [word for word in what if is_path(word)]
    for path in paths:
        check_effects(
            load_joint_file(path), get_structure(structure_of(path, None)), drive_of(path, None)
        )
    tables["joints"] += [_joint(path) | {"name": path} for path in paths]
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
        "structure": file.structure,
        "drive": file.drive,
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
    shapes = STRUCTURES.values()
    return {
        "name": row.name,
        "stage": row.stage,
        "summary": row.summary,
        "source": row.source,
        "needs": PLACES[row.needs],
        "structures": [s.name for s in shapes if any(row.acts_in(s, drive) for drive in DRIVES)],
        "drives": [drive for drive in DRIVES if any(row.acts_in(s, drive) for s in shapes)],
        "bodies": list(row.bodies),
        "channels": list(row.channels),
        "excludes": list(row.excludes),
        "size": list(row.size),
        "parameters": [_parameter(row, p) for p in row.parameters],
    }


def _parameter(effect: Effect, p: EffectParameter) -> dict[str, Any]:
    least, is_excluded, greatest = effect.domain(p)
    told = {name: value for name, value in asdict(p).items() if name != "fields"}
    return told | {
        "minimum": least if math.isfinite(least) else None,
        "minimum_excluded": is_excluded,
        "maximum": greatest if math.isfinite(greatest) else None,
    }
