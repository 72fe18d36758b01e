"""`cjt-gym joints`: what there is to choose from."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from cjt_gym.joint import DRIVES, EFFECTS, STRUCTURES, joint_names, load_joint_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Take no options beyond the common ones."""


def run(options: argparse.Namespace) -> None:
    """Print the tables."""
    tables = describe()
    if options.json:
        sys.stdout.write(json.dumps(tables, indent=1) + "\n")
        return
    for title in ("joints", "structures", "drives"):
        sys.stdout.write(f"{title.capitalize()}\n")
        for row in tables[title]:
            sys.stdout.write(f"  {row['name']:28s} {row['summary']}\n")
        sys.stdout.write("\n")
    sys.stdout.write("Effects\n")
    for row in tables["effects"]:
        sys.stdout.write(f"  {row['name']:28s} {row['stage']:8s} {row['summary']}\n")
        for p in row["parameters"]:
            off = p["relative_to"] if p["neutral"] is None else f"{p['neutral']:g}"
            span = f"{p['low']:g} .. {p['high']:g}"
            sys.stdout.write(
                f"      {p['symbol']:10s} [{p['unit']}]  off at {off}, range {span}: "
                f"{p['description']}\n"
            )


def describe() -> dict[str, list[dict[str, Any]]]:
    """Return the joints, structures, drives and effects as plain values."""
    return {
        "joints": [_joint(name) for name in joint_names()],
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
        "effects": [
            {
                "name": row.name,
                "stage": row.stage,
                "summary": row.summary,
                "source": row.source,
                "bodies": list(row.bodies),
                "channels": list(row.channels),
                "excludes": list(row.excludes),
                "parameters": [
                    {
                        "symbol": p.symbol,
                        "unit": p.unit,
                        "neutral": p.neutral,
                        "relative_to": p.relative_to,
                        "low": p.low,
                        "high": p.high,
                        "series": p.series,
                        "description": p.description,
                    }
                    for p in row.parameters
                ],
            }
            for row in EFFECTS.values()
        ],
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
