"""From the nominal joint to the explained one, one effect after the other, on held-out data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.diagnosis import NamedEffect, Step
from cjt_gym.gap.fields import Fields
from cjt_gym.gap.fit import Fit, Model, Problem
from cjt_gym.gap.force import torques
from cjt_gym.gap.hypothesis import Hypothesis
from cjt_gym.gap.replay import replay
from cjt_gym.gap.setting import Setting
from cjt_gym.gap.shrink import compared
from cjt_gym.gap.signals import commanded_current

Floats = NDArray[np.float64]
BLOCK = 0.5
"""Length of a block of the bootstrap [s]."""
DRAWS = 400


def order_of(named: Sequence[NamedEffect], effects: Sequence[Hypothesis]) -> list[int]:
    """Return the indices of effects, those that remove the largest share of the gap first."""
    removed = {(e.name, e.body, e.channel): e.gap_removed for e in named}
    keys = [(e.name, e.body, e.channel) for e in effects]
    return sorted(range(len(effects)), key=lambda k: -removed.get(keys[k], -1.0))


def models(problem: Problem, fit: Fit, nominal: Fields, order: Sequence[int]) -> list[Fields]:
    """Return the fields of nominal joint, of its tolerances, and with one effect more each.

    Args:
        problem: The record.
        fit: The explanation.
        nominal: Fields of the nominal joint.
        order: Indices of the effects in the order in which they are added.
    """
    shared = len(problem.shared)
    ends = np.cumsum([shared, *(len(e.unknowns) for e in fit.model.effects)])
    found = [nominal]
    for count in range(len(order) + 1):
        some = sorted(order[:count])
        z = np.concatenate([fit.z[:shared], *(fit.z[ends[k] : ends[k + 1]] for k in some)])
        found.append(problem.fields(Model(tuple(fit.model.effects[k] for k in some)), z))
    return found


def ladder(
    settings: Sequence[Setting],
    fields: Sequence[Fields],
    effects: Sequence[Hypothesis],
    channel: str,
) -> tuple[Step, ...]:
    """Return the replay error of each model on held-out data; see `cjt_gym.gap.shrink`.

    Args:
        settings: The held-out records.
        fields: The models: nominal, with its tolerances, and with each of the effects.
        effects: The effects in the order in which they are added.
        channel: The channel whose error counts, see `cjt_gym.gap.shrink`.
    """
    names: list[tuple[str, str | None, str | None]] = [
        ("nominal", None, None),
        ("tolerances", None, None),
        *((e.name, e.body, e.channel) for e in effects),
    ]
    steps = []
    for name, model in zip(names, fields, strict=False):
        blocks = np.concatenate([_blocks(s, model, channel) for s in settings])
        if np.isfinite(blocks).all():
            steps.append(Step(*name, *_error(blocks)))
    return tuple(steps)


def _blocks(setting: Setting, fields: Fields, channel: str) -> Floats:
    """Return the squared error and the squared signal of each block, shape (blocks, 2)."""
    signal, model = compared(setting, fields)[channel]
    error = model - signal
    size = max(int(BLOCK / setting.series.dt), 1)
    starts = np.arange(0, len(signal), size)
    squares = (np.add.reduceat(error**2, starts), np.add.reduceat(signal**2, starts))
    return np.column_stack(squares)


def _error(blocks: Floats) -> tuple[float, float, float]:
    rng = np.random.default_rng(0)
    draws = blocks[rng.integers(0, len(blocks), (DRAWS, len(blocks)))].sum(axis=1)
    spread = np.sqrt(draws[:, 0] / np.maximum(draws[:, 1], 1e-300))
    total = blocks.sum(axis=0)
    value = float(np.sqrt(total[0] / max(total[1], 1e-300)))
    low, high = np.quantile(spread, [0.025, 0.975])
    return value, float(low), float(high)


def replays(setting: Setting, before: Fields, after: Fields) -> dict[str, dict[str, Floats]]:
    """Return measured, nominal and explained signals of every channel that both models follow."""
    series = setting.series
    measured = {"dq_m": series.speed("q_m")}
    measured |= {name: series[name] for name in ("tau", "q_m", "q_l") if name in series}
    if not setting.has_spring or not setting.structure.output_fixed:
        measured.pop("q_m")  # an angle without a spring to ground drifts in any replay
        measured.pop("q_l", None)
    one, two = replay(setting, before), replay(setting, after)
    if not setting.has_spring:
        (signal, first), (other, last) = (torques(setting, fields) for fields in (before, after))
        measured["tau_m"], one["tau_m"], two["tau_m"] = signal, first, last - other + signal
    found = {}
    for name, signal in measured.items():
        if name != "q_l" and name in one and np.isfinite(one[name] + two[name]).all():
            found[name] = {"measured": signal, "before": one[name], "after": two[name]}
    if "i" in series and "i_cmd" in series:
        found["i"] = {
            "measured": series["i"],
            "before": commanded_current(before, series) + before["i_0"],
            "after": commanded_current(after, series) + after["i_0"],
        }
    return found
