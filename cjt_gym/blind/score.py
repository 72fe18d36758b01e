"""Score of a diagnosis: the content of diagnosis.json against the label of its case."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from cjt_gym.blind.compare import compare
from cjt_gym.blind.rates import mean, rate, reliability
from cjt_gym.blind.robustness import by_defect, defects_of
from cjt_gym.blind.signature import VISIBLE

NONE, OUTSIDE, FAILED = "(none)", "(outside the table)", "(failed)"
"""Entries of the confusion matrix that are not effects."""
LEFT: Final = ("unexplained", "partly_explained")
MATERIAL: Final = 2.0
"""Ratio of gap to noise floor above which its reduction is compared."""
Label = Mapping[str, Any]
Row = dict[str, Any]


def accepted(label: Label) -> dict[str, str]:
    """Return the names that count as right, each with the true effect that it represents.

    With a locked output whose angle is arbitrary, a constant torque on the motor and an offset of
    the torque sensor are equivalent in every record. Without a spring motor and load are one mass,
    whose inertia and dry friction can be attributed to either.
    """
    names = {name: name for name in label["effects"]}
    for twins in _twins(str(label.get("structure", ""))):
        for one, other in (twins, twins[::-1]):
            if one in names and other not in names:
                names[other] = one
    return names


def _twins(structure: str) -> tuple[tuple[str, str], ...]:
    """Return the pairs of effects that are equivalent in a structure."""
    if structure.startswith("output_fixed"):
        return (("torque_offset", "torque_bias"),)
    if structure == "rigid":
        return (("inertia", "load_inertia"), ("coulomb", "load_coulomb"))
    return ()


def is_beside(effect: Mapping[str, Any], not_counted: Collection[str]) -> bool:
    """Return whether an effect of a diagnosis is not counted, by name or by name and channel."""
    name = effect["name"]
    return name in not_counted or f"{name}:{effect.get('channel')}" in not_counted


def agrees(true: str, first: str) -> bool:
    """Return whether an entry of the confusion matrix is correct."""
    return true == first or (true, first) == (OUTSIDE, NONE)


def score_case(name: str, label: Label, result: Mapping[str, Any]) -> Row:
    """Return the score of one case as plain values.

    Args:
        name: Name of the case.
        label: Its label, as `draw_case` gives it. Only `effects` is required; what depends on
            other entries is not scored without them. Effects in its `not_counted` are neither
            wrong nor missing.
        result: Content of its diagnosis.json, or {"error": text} if the diagnosis failed.
    """
    right, beside = accepted(label), set(label.get("not_counted", []))
    truth = [effect for effect in label["effects"] if effect not in beside]
    others = list(label.get("outside_the_table", []))
    named = result.get("effects", [])
    effects = [effect for effect in named if not is_beside(effect, beside)]
    found = [effect["name"] for effect in effects]
    hits = {right[other] for other in found if other in right}
    wrong = {other for other in found if other not in right}
    seen = label.get("signature", {})
    hidden = [effect for effect in (*truth, *others) if seen.get(effect, math.inf) < VISIBLE]
    exact = hits == set(truth) and not wrong
    confirmed = {e["name"] for e in effects if e["status"] == "confirmed"}
    untold = {row["name"] for row in result.get("record", {}).get("cannot_tell", [])}
    return {
        "case": name,
        "kind": _kind(truth, others),
        "structure": label.get("structure"),
        "excitation": (label.get("excitation") or [None])[0],
        "closed_loop": (label.get("closed_loop") or [None])[0],
        "truth": truth,
        "outside": others,
        "invisible": hidden,
        "signature": dict(seen),
        "defects": defects_of(label, truth, others),
        "not_counted": [effect["name"] for effect in named if is_beside(effect, beside)],
        "named": found,
        "status": [effect["status"] for effect in effects],
        "verdict": result.get("verdict", "failed"),
        "first_right": bool(found) and found[0] in right,
        "excluded": bool(truth) and untold.issuperset(truth),
        "exact": exact,
        "f1": _f1(len(truth), len(hits), len(wrong)),
        "wrong": sorted(wrong),
        "wrong_confirmed": sorted(confirmed - set(right)),
        "true_and_first": _true_and_first(truth, others, found, right, result),
        "recognised": result.get("verdict") in LEFT,
        "confidences": [[effect["confidence"], effect["name"] in right] for effect in effects],
        "numbers": _numbers(label, named),
        "shrink": _shrink(label, result) if exact and not others else None,
        "seconds": result.get("seconds"),
        "cpu_seconds": result.get("cpu_seconds"),
        "error": result.get("error"),
    }


def _kind(truth: Sequence[str], others: Sequence[str]) -> str:
    if others:
        return "outside_and_known" if truth else "outside"
    return ("none", "single", "pair")[min(len(truth), 2)]


def _f1(true: int, hits: int, wrong: int) -> float:
    total = true + hits + wrong
    return 2.0 * hits / total if total else 1.0


def _true_and_first(
    truth: list[str],
    others: list[str],
    found: list[str],
    right: Mapping[str, str],
    result: Mapping[str, Any],
) -> list[str]:
    """Return row and column of the confusion matrix."""
    first = found[0] if found else FAILED if "error" in result else NONE
    if first in right:
        return [right[first], right[first]]
    return [truth[0] if truth else OUTSIDE if others else NONE, first]


def _numbers(label: Label, effects: Iterable[Mapping[str, Any]]) -> list[Row]:
    if "true" not in label:
        return []
    return [row for effect in effects for row in compare(label, effect)]


def _shrink(label: Label, result: Mapping[str, Any]) -> Row | None:
    """Return the predicted and the true reduction of the replay error.

    The true one is that of the true model over the stated one in the same kind of replay,
    including the noise that no model removes. It is comparable only if the diagnosis found the true
    effects, and meaningful only if the gap exceeds the noise.
    """
    gap, truth = result.get("gap"), label.get("gap", {})
    if not gap or "free_run" not in truth or not label["effects"]:
        return None
    true = truth["free_run"]
    channel = "tau" if "tau" in gap["by_channel"] else "dq_m"
    floor = truth.get("floor", {}).get(channel, gap["floor"])
    before = math.hypot(true["stated"][channel], floor)
    after = math.hypot(true["true"][channel], floor)
    if not before > MATERIAL * floor:
        return None
    return {
        "predicted": gap["removed"],
        "low": gap["low"],
        "high": gap["high"],
        "true": 1.0 - after / before,
    }


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of a whole test as plain values.

    Cases with an effect too small to be visible are counted separately, in `invisible`; otherwise
    they enter only the figures on wrong names, intervals and time.
    """
    seen = [row for row in rows if not row["invisible"]]
    known = [row for row in seen if row["kind"] in ("single", "pair")]
    single = [row for row in seen if row["kind"] == "single"]
    pair = [row for row in seen if row["kind"] == "pair"]
    none = [row for row in rows if row["kind"] == "none"]
    outside = [row for row in seen if row["kind"].startswith("outside")]
    beside = [row for row in seen if row["kind"] == "outside_and_known"]
    numbers = [number for row in rows for number in row["numbers"]]
    pairs = [c for row in rows for c in row["confidences"]]
    return {
        "cases": len(rows),
        "failed": sum(row["error"] is not None for row in rows),
        "first_right": {
            "known": rate(row["first_right"] for row in known),
            "single": rate(row["first_right"] for row in single),
            "pair": rate(row["first_right"] for row in pair),
            "not_excluded": rate(row["first_right"] for row in known if not row["excluded"]),
        },
        "exact": rate(row["exact"] for row in known),
        "f1": mean([row["f1"] for row in known]),
        "false_alarms": rate(bool(row["named"]) for row in none),
        "called_unexplained": rate(row["recognised"] for row in known + none),
        "outside": {
            "recognised": rate(row["recognised"] for row in outside),
            "known_beside_named": rate(
                bool(set(row["named"]) & set(row["truth"])) for row in beside
            ),
        },
        "wrong_confirmed": {
            "with_outside": rate(bool(row["wrong_confirmed"]) for row in outside),
            "without_outside": rate(bool(row["wrong_confirmed"]) for row in known + none),
        },
        "coverage": _coverage(numbers),
        "shrink": _shrinks(rows),
        "confidence": reliability([c for c, _ in pairs], [right for _, right in pairs]),
        "invisible": _invisible(rows),
        "confusion": _confusion(rows),
        "defects": by_defect(rows),
        "structures": {
            name: rate(row["first_right"] for row in known if row["structure"] == name)
            for name in sorted({str(row["structure"]) for row in known})
        },
        "seconds": _seconds([row["seconds"] for row in rows if row["seconds"] is not None]),
        "cpu_seconds": _seconds([r["cpu_seconds"] for r in rows if r["cpu_seconds"] is not None]),
    }


def _coverage(numbers: Sequence[Row]) -> dict[str, Any]:
    kinds = sorted({(n["effect"], n["parameter"]) for n in numbers})
    return rate(n["covered"] for n in numbers) | {
        "parameters": {
            f"{effect}.{parameter}": rate(
                n["covered"]
                for n in numbers
                if (n["effect"], n["parameter"]) == (effect, parameter)
            )
            for effect, parameter in kinds
        }
    }


def _shrinks(rows: Sequence[Row]) -> dict[str, Any]:
    found = [row["shrink"] for row in rows if row["shrink"]]
    errors = [abs(s["predicted"] - s["true"]) for s in found]
    return {
        "error": mean(errors),
        "median": float(np.median(errors)) if errors else None,
        "within_5_points": rate(error <= 0.05 for error in errors),
    }


def _invisible(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of cases with an effect too small to be visible.

    "Right" names only true effects; "silent" names none.
    """
    cases = [row for row in rows if row["invisible"]]
    return {
        "cases": len(cases),
        "right": rate(bool(r["named"]) and not r["wrong"] for r in cases),
        "silent": rate(not r["named"] for r in cases),
        "wrong": rate(bool(r["wrong"]) for r in cases),
    }


def _confusion(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the confusion matrix: true effect by first name, with counts."""
    count = Counter(tuple(row["true_and_first"]) for row in rows if not row["invisible"])
    return {
        "true": sorted({true for true, _ in count}),
        "first": sorted({first for _, first in count}),
        "counts": [[true, first, n] for (true, first), n in sorted(count.items())],
    }


def _seconds(values: Sequence[float]) -> dict[str, float | None]:
    if not values:
        return {"median": None, "p95": None, "largest": None}
    return {
        "median": float(np.median(values)),
        "p95": float(np.quantile(values, 0.95)),
        "largest": float(max(values)),
    }
