"""Where in its operating range a stage's gap lies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.diagnosis import Regime
from cjt_gym.gap.setting import Setting

Floats = NDArray[np.float64]
BINS = 6
STILL = 0.02
"""Speeds below this share of the largest make one bin: that is where friction shows itself."""


def regimes(setting: Setting, stage: str, residual: Floats) -> tuple[Regime, ...]:
    """Return the shares of a stage's squared excess residual over each variable's range.

    Over the ranges of one variable the shares add up to 1. The variable over which the gap is most
    uneven comes first.

    Args:
        setting: The record.
        stage: The stage.
        residual: Its normalised residual before any effect, shape (N,).
    """
    excess = np.square(residual)
    counted = residual != 0.0
    tables = []
    for name, unit, values, edges in _variables(setting, stage):
        shares, occupancy = _shares(excess, counted, values, edges)
        uneven = float(np.sum(np.abs(shares - occupancy)))
        rows = [
            Regime(stage, name, float(low), float(high), unit, float(share))
            for low, high, share in zip(edges[:-1], edges[1:], shares, strict=True)
        ]
        tables.append((uneven, rows))
    tables.append(_spectrum(setting, stage, residual))
    tables.sort(key=lambda pair: -pair[0])
    return tuple(row for _, rows in tables for row in rows)


def _variables(setting: Setting, stage: str) -> list[tuple[str, str, Floats, Floats]]:
    series = setting.series
    speed_of = "q_l" if stage == "load" else "q_m"
    v = series.speed(speed_of)
    top = max(float(np.abs(v).max()), 1e-12)
    inner = STILL * top
    edges = np.array([-top, -10 * inner, -inner, inner, 10 * inner, top])
    metre = setting.joint.parameters.axis == "prismatic"
    angle, torque = ("m", "N") if metre else ("rad", "N m")
    rows = [("d" + speed_of, f"{angle}/s", v, edges)]
    rows.append((speed_of, angle, series[speed_of], _even(series[speed_of])))
    if "tau" in series:
        rows.append(("tau", torque, series["tau"], _even(series["tau"])))
    name = "i" if "i" in series else "i_cmd"
    rows.append((name, "A", series[name], _even(series[name])))
    rows.append(("t", "s", series.t, _even(series.t)))
    return rows


def _even(x: Floats) -> Floats:
    low, high = float(x.min()), float(x.max())
    return np.linspace(low, high if high > low else low + 1.0, BINS + 1)


def _shares(
    excess: Floats, counted: NDArray[np.bool_], values: Floats, edges: Floats
) -> tuple[Floats, Floats]:
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    sums = np.bincount(index[counted], weights=excess[counted], minlength=len(edges) - 1)
    count = np.bincount(index[counted], minlength=len(edges) - 1)
    return sums / max(sums.sum(), 1e-300), count / max(count.sum(), 1)


def _spectrum(setting: Setting, stage: str, residual: Floats) -> tuple[float, list[Regime]]:
    power = np.asarray(np.abs(np.fft.rfft(residual - residual.mean())) ** 2, dtype=np.float64)
    f = np.asarray(np.fft.rfftfreq(len(residual), setting.series.dt), dtype=np.float64)
    edges = np.concatenate([[0.0], np.geomspace(1.0, f[-1], BINS)]) if f[-1] > 1.0 else _even(f)
    counted = np.ones(len(f), dtype=bool)
    shares, occupancy = _shares(power, counted, f, edges)
    rows = [
        Regime(stage, "frequency", float(low), float(high), "Hz", float(share))
        for low, high, share in zip(edges[:-1], edges[1:], shares, strict=True)
    ]
    return float(np.sum(np.abs(shares - occupancy))), rows
