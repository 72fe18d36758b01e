"""Where in its operating range a stage's gap lies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cjt_gym.gap.diagnosis import StageGap
from cjt_gym.gap.evidence import Regime
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.joint.kernel.arrays import Floats

BINS = 8
STILL = 0.02
"""Speeds below this share of the largest form one bin, where friction dominates."""
CELLS = 1 << 16
"""Maximum number of angle cells for the transform of a residual."""
NARROW = 1.5
"""Half width of the bin around the highest line over the angle, in units of its resolution."""
PAD = 4
"""Factor by which the angle's range is padded, so that lines look smooth."""


@dataclass(frozen=True, eq=False)
class Axis:
    """One variable over which a gap is spread."""

    name: str  # column, "t", "frequency" or "cycles_per_rev"
    unit: str
    edges: Floats  # bins, shape (B + 1,)
    # function that returns a residual's sum of squares in each bin, and that expected of noise;
    # each of shape (B,)
    total: Callable[[Floats], tuple[Floats, Floats]]


def where(
    setting: Setting,
    stages: Mapping[str, StageGap],
    before: Mapping[str, Floats],
    after: Mapping[str, Floats],
) -> dict[str, tuple[tuple[Regime, ...], tuple[Regime, ...]]]:
    """Return the regimes of each stage with a gap, before and after, worst stage first.

    The stage with the largest residual is always included.
    """
    ranked = sorted(before, key=lambda name: -stages[name].before)
    kept = [name for k, name in enumerate(ranked) if k == 0 or stages[name].significant]
    return {name: regimes(setting, name, before[name], after[name]) for name in kept}


def regimes(
    setting: Setting, stage: str, before: Floats, after: Floats
) -> tuple[tuple[Regime, ...], tuple[Regime, ...]]:
    """Return the shares of a stage's excess residual over each variable's range.

    The excess is the squared residual beyond that of the specified noise. Over the ranges of one
    variable the shares before sum to 1; those after are shares of the same total, that is, the
    remainder. The variable over which the gap is most uneven comes first.

    Args:
        setting: The record.
        stage: The stage.
        before: Its normalised residual before any effect, shape (N,).
        after: The same with the effects, shape (N,).
    """
    tables = []
    for axis in _axes(setting, stage, before):
        first, noise = axis.total(before)
        last, _ = axis.total(after)
        shares, whole = _excess(first, noise)
        left = np.maximum(last - noise, 0.0) / whole
        uneven = float(np.sum(np.abs(shares - noise / max(float(noise.sum()), 1e-300))))
        tables.append((uneven, _rows(stage, axis, shares), _rows(stage, axis, left)))
    tables.sort(key=lambda table: -table[0])
    return (
        tuple(row for _, rows, _ in tables for row in rows),
        tuple(row for _, _, rows in tables for row in rows),
    )


def _excess(squares: Floats, noise: Floats) -> tuple[Floats, float]:
    """Return each bin's share of the excess, and the excess; without excess, of all squares."""
    excess = np.maximum(squares - noise, 0.0)
    if excess.sum() < 0.05 * noise.sum():
        excess = squares
    whole = max(float(excess.sum()), 1e-300)
    return excess / whole, whole


def _rows(stage: str, axis: Axis, shares: Floats) -> list[Regime]:
    return [
        Regime(stage, axis.name, float(low), float(high), axis.unit, float(share))
        for low, high, share in zip(axis.edges[:-1], axis.edges[1:], shares, strict=True)
    ]


def _axes(setting: Setting, stage: str, residual: Floats) -> list[Axis]:
    series = setting.series
    angle_of = "q_l" if stage == "load" else "q_m"
    v = series.speed(angle_of)
    top = max(float(np.abs(v).max()), 1e-12)
    inner = STILL * top
    fast = [3 * inner, 10 * inner, 25 * inner, top]
    metre = setting.joint.parameters.axis == "prismatic"
    angle, torque = ("m", "N") if metre else ("rad", "N m")
    edges = np.array([*(-x for x in fast[::-1]), -inner, inner, *fast])
    q = series[angle_of]
    rows = [
        _over("d" + angle_of, f"{angle}/s", v, edges),
        _over(angle_of, angle, q, _even(q)),
        _over("t", "s", series.t, _even(series.t)),
        _frequency(series.dt, len(residual)),
    ]
    if "tau" in series:
        rows.append(_over("tau", torque, series["tau"], _even(series["tau"])))
    name = "i" if "i" in series else "i_cmd"
    rows.append(_over(name, setting.command_unit, series[name], _even(series[name])))
    cycles = _cycles(q, v * series.dt, residual, metre)
    return rows if cycles is None else [*rows, cycles]


def _even(x: Floats) -> Floats:
    low, high = float(x.min()), float(x.max())
    return np.linspace(low, high if high > low else low + 1.0, BINS + 1)


def _over(name: str, unit: str, values: Floats, edges: Floats) -> Axis:
    summed = _summed(values, edges)

    def total(residual: Floats) -> tuple[Floats, Floats]:
        return summed(residual**2), summed((residual != 0.0).astype(np.float64))

    return Axis(name, unit, edges, total)


def _summed(values: Floats, edges: Floats) -> Callable[[Floats], Floats]:
    """Return the function that sums weights, one for each value, in the bins between edges."""
    bins = len(edges) - 1
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, bins - 1)
    return lambda weights: np.asarray(np.bincount(index, weights, bins), dtype=np.float64)


def _frequency(dt: float, size: int) -> Axis:
    f = np.asarray(np.fft.rfftfreq(size, dt), dtype=np.float64)
    start = min(1.0, f[-1] / 10.0)
    edges = np.concatenate([[0.0], np.geomspace(start, f[-1], BINS)])
    summed = _summed(f, edges)
    lines = summed(np.ones(len(f)))

    def total(residual: Floats) -> tuple[Floats, Floats]:
        power = np.abs(np.fft.rfft(residual)) ** 2 * 2.0 / size
        return summed(power), np.count_nonzero(residual) / len(f) * lines

    return Axis("frequency", "Hz", edges, total)


def _cycles(q: Floats, moved: Floats, residual: Floats, metre: bool) -> Axis | None:
    """Return the spatial frequency, with a narrow bin around the residual's highest line.

    Args:
        q: Angle [rad], shape (N,).
        moved: Its change over one sample [rad], shape (N,).
        residual: Normalised residual before any effect, shape (N,).
        metre: Whether the angle is a position in metres.
    """
    travel = float(np.ptp(q))
    moving = np.abs(moved) > STILL * float(np.abs(moved).max())
    if travel <= 0.0 or not moving.any():
        return None
    # Above a quarter of the sampling rate, at the typical speed, no line can be resolved.
    cells = int(np.clip(0.5 * travel / np.median(np.abs(moved[moving])), 1, CELLS / PAD))
    index = np.minimum(((q - q.min()) / travel * cells).astype(np.int64), cells - 1)
    revolution = 1.0 if metre else 2.0 * np.pi
    f = np.arange(cells * PAD // 2 + 1) / (PAD * travel) * revolution

    def power(x: Floats) -> Floats:
        transform = np.fft.rfft(np.bincount(index, weights=x, minlength=cells), cells * PAD)
        return np.asarray(np.abs(transform) ** 2 / PAD)

    # Below three cycles per travel nothing repeats: offset, stiffness and friction dominate.
    first, step = 3 * PAD, float(NARROW * PAD * f[1])
    if first >= len(f) // 2:
        return None
    peak = float(f[first + int(np.argmax(power(residual)[first:]))])
    wide = np.concatenate([[0.0], np.geomspace(f[first], f[-1], BINS - 2)])
    outside = wide[np.abs(wide - peak) > step]
    edges = np.sort(np.concatenate([outside, [peak - step, min(peak + step, f[-1])]]))
    edges = np.unique(np.append(edges, f[-1]))
    summed = _summed(f, edges)
    lines = summed(np.ones(len(f)))

    def total(x: Floats) -> tuple[Floats, Floats]:
        return summed(power(x)), lines * np.count_nonzero(x) / PAD

    return Axis("cycles_per_rev", "1/m" if metre else "1/rev", edges, total)
