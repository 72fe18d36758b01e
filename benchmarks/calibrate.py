"""Calibrate the diagnosis: `python benchmarks/calibrate.py DIR...`.

DIR is what `cjt-gym blind-test --out DIR` has written (its folders `labels` and `diagnoses`). The
map from the evidence of a name to its confidence (`cjt_gym.gap.judged.confidence`) is fitted to
every second case and checked on the others; so is the factor by which the intervals would have
to grow to cover 95 % (`INFLATION` of `cjt_gym.gap.stages.intervals` times this factor).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from cjt_gym.blind.rates import reliability
from cjt_gym.blind.score import accepted, is_beside, score_case
from cjt_gym.gap.judged import confidence as in_use

Floats = NDArray[np.float64]
NAMES = ("LEVEL", "PER_LEAD", "OFF", "UNSEEN", "TENTATIVE")
SPREAD = 1.0
"""Deviation of each constant's logarithm around the one in use: what few wrong names leave open."""


def cases(folders: Sequence[Path]) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Yield name, key and diagnosis of every case."""
    for folder in folders:
        for path in sorted((folder / "diagnoses").glob("*.json")):
            label = folder / "labels" / path.name
            yield path.stem, json.loads(label.read_text()), json.loads(path.read_text())


def names(label: dict[str, Any], result: dict[str, Any]) -> Iterator[tuple[list[float], bool]]:
    """Yield the features of every fitted name, in the order of NAMES, and whether it is right."""
    right = accepted(label)
    left_out = {"noise", "quantization", *label.get("not_counted", [])}
    for effect in result.get("effects", []):
        if is_beside(effect, left_out):
            continue  # read off the channel, not fitted, or neither right nor wrong
        worth = effect["worth"]
        off = 0.0 if worth is None else min(abs(worth - 1.0), in_use.OFF_MOST)
        lead = float(np.log1p(max(effect["lead"], 0.0)))
        tentative = effect["status"] == "tentative"
        row = [1.0, lead, -off, -float(worth is None), -float(tentative)]
        yield row, effect["name"] in right


def fitted(features: Floats, right: Floats, start: Floats) -> Floats:
    """Return the constants of the logistic map, kept positive and near those in use."""

    def loss(logs: Floats) -> float:
        odds = features @ (start * np.exp(logs))
        misfit = np.logaddexp(0.0, np.where(right > 0.5, -odds, odds))
        return float(misfit.sum() + 0.5 * np.sum((logs / SPREAD) ** 2))

    found: Floats = start * np.exp(minimize(loss, np.zeros(len(start))).x)
    return found


def growth(numbers: Sequence[dict[str, Any]]) -> float:
    """Return the factor by which intervals would have to grow to cover 95 %."""
    off = []
    for row in numbers:
        side = row["high"] if row["true"] > row["value"] else row["low"]
        off.append(abs(row["true"] - row["value"]) / max(abs(side - row["value"]), 1e-300))
    return float(np.quantile(off, 0.95)) if off else float("nan")


def report(title: str, features: Floats, right: Floats, constants: Floats) -> None:
    """Print how often names were right, by how sure the map is of them."""
    sure = 1.0 / (1.0 + np.exp(-features @ constants))
    table = reliability(list(sure), list(right > 0.5))
    print(f"{title}: {len(right)} names, calibration error {table['error']:.3f}")
    for row in table["bins"]:
        print(
            f"  {row['from']:.2f} .. {row['to']:.2f}  mean {row['confidence']:.3f}  "
            f"right {row['hits']}/{row['total']}"
        )


def main() -> int:
    """Fit, check, print."""
    parts: list[list[tuple[list[float], bool]]] = [[], []]
    numbers: list[list[dict[str, Any]]] = [[], []]
    for k, (name, label, result) in enumerate(cases([Path(a) for a in sys.argv[1:]])):
        parts[k % 2] += names(label, result)
        numbers[k % 2] += score_case(name, label, result)["numbers"]
    start = np.array([getattr(in_use, name) for name in NAMES])
    x = [np.array([f for f, _ in part]) for part in parts]
    y = [np.array([float(good) for _, good in part]) for part in parts]
    half = fitted(x[0], y[0], start)
    whole = fitted(np.concatenate(x), np.concatenate(y), start)
    report("in use, all cases", np.concatenate(x), np.concatenate(y), start)
    report("fitted to even cases, on odd ones", x[1], y[1], half)
    for name, value in zip(NAMES, whole, strict=True):
        print(f"{name} = {value:.2f}")
    for title, rows in (("even", numbers[0]), ("odd", numbers[1])):
        covered = [row["covered"] for row in rows]
        share = f"{sum(covered)}/{len(covered)}"
        print(f"intervals, {title} cases: cover {share}; 95 % with factor {growth(rows):.2f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
