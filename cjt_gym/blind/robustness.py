"""How well a diagnosis bears what is wrong with real logs, by kind of defect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from cjt_gym.blind.defects import DEFECTS
from cjt_gym.blind.rates import rate

MIXED: Final = "known_and_unknown"
"""Counts among the defects: an effect outside the table beside known ones."""
Row = Mapping[str, Any]


def defects_of(label: Mapping[str, Any], truth: Sequence[str], outside: Sequence[str]) -> list[str]:
    """Return the kinds of defects of a case, by its key and its effects of the table and others."""
    return list(label.get("defects", {})) + ([MIXED] if truth and outside else [])


def by_defect(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of the cases with each kind of defect, and of all; empty without defects.

    A case counts for every defect it has. First and all names count where a known effect is to be
    seen, false alarms where there is none at all, wrong confirmed names everywhere. A case that
    could not be diagnosed counts against all of them.
    """
    kinds = {kind: [r for r in rows if kind in r["defects"]] for kind in (*DEFECTS, MIXED)}
    if not any(kinds[kind] for kind in DEFECTS):
        return {}
    return {kind: _score(some) for kind, some in kinds.items() if some} | {"all": _score(rows)}


def _score(rows: Sequence[Row]) -> dict[str, Any]:
    known = [row for row in rows if row["truth"] and not row["invisible"]]
    none = [row for row in rows if row["kind"] == "none"]
    return {
        "cases": len(rows),
        "first_right": rate(row["first_right"] for row in known),
        "exact": rate(row["exact"] for row in known),
        "no_wrong_confirmed": rate(not (row["wrong_confirmed"] or row["error"]) for row in rows),
        "no_false_alarm": rate(not (row["named"] or row["error"]) for row in none),
    }
