"""Score of a diagnosis by kind of defect of the logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from cjt_gym.blind.defects import DEFECTS
from cjt_gym.blind.rates import rate

MIXED: Final = "known_and_unknown"
"""Counted among the defects: an effect outside the table together with known ones."""
Row = Mapping[str, Any]


def defects_of(label: Mapping[str, Any], truth: Sequence[str], outside: Sequence[str]) -> list[str]:
    """Return the kinds of defects of a case, from its label and its effects."""
    return list(label.get("defects", {})) + ([MIXED] if truth and outside else [])


def by_defect(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of the cases with each kind of defect, and of all; empty without defects.

    A case counts for every defect it has. First and all names count if a known effect is
    visible, false alarms if there is no effect at all, wrong confirmed names always. A failed
    diagnosis counts against all of them.
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
