"""From the nominal joint to the explained one, one effect after the other, on held-out data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.diagnosis import NamedEffect, Step
from cjt_gym.gap.fit import Fit, Model, Problem
from cjt_gym.gap.force import torques
from cjt_gym.gap.joint_file import Refined, identified_joint
from cjt_gym.gap.replay import Written, replay
from cjt_gym.gap.setting import Setting
from cjt_gym.gap.shrink import compared

Floats = NDArray[np.float64]
BLOCK = 0.5
"""Length of a block of the bootstrap [s]."""
DRAWS = 400


def steps(
    problem: Problem,
    fit: Fit,
    nominal: Written,
    named: Sequence[NamedEffect],
    refined: Refined,
    record: str,
) -> list[Written]:
    """Return the nominal joint, the one within its tolerances, and with one effect more each.

    Args:
        problem: The record.
        fit: The explanation.
        nominal: The nominal joint.
        named: What is named, in the order in which it is added.
        refined: Datasheet values that the record tells; see `identified_joint`.
        record: Name of the record.
    """
    shared, setting = len(problem.shared), problem.stages.setting
    ends = np.cumsum([shared, *(len(e.unknowns) for e in fit.model.effects)])
    at = {(e.name, e.body, e.channel): k for k, e in enumerate(fit.model.effects)}
    keys = [(e.name, e.body, e.channel) for e in named]
    found = [nominal]
    for count in range(len(named) + 1):
        some = sorted(at[key] for key in keys[:count] if key in at)
        z = np.concatenate([fit.z[:shared], *(fit.z[ends[k] : ends[k + 1]] for k in some)])
        fields = problem.fields(Model(tuple(fit.model.effects[k] for k in some)), z)
        file = identified_joint(setting, fields, named[:count], refined, record)
        found.append(Written(fields, file))
    return found


def ladder(
    settings: Sequence[Setting],
    models: Sequence[Written],
    named: Sequence[NamedEffect],
    channel: str,
) -> tuple[Step, ...]:
    """Return the replay error of each model on held-out data; see `cjt_gym.gap.shrink`.

    Args:
        settings: The held-out records.
        models: What `steps` returns.
        named: The effects in the order in which they are added.
        channel: The channel whose error counts, see `cjt_gym.gap.shrink`.
    """
    names: list[tuple[str, str | None, str | None]] = [
        ("nominal", None, None),
        ("tolerances", None, None),
        *((e.name, e.body, e.channel) for e in named),
    ]
    found = []
    for name, model in zip(names, models, strict=False):
        blocks = np.concatenate([_blocks(s, model, channel) for s in settings])
        if np.isfinite(blocks).all():
            found.append(Step(*name, *_error(blocks)))
    return tuple(found)


def _blocks(setting: Setting, model: Written, channel: str) -> Floats:
    """Return the squared error and the squared signal of each block, shape (blocks, 2)."""
    signal, there = compared(setting, model)[channel]
    error = there - signal
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


def replays(setting: Setting, before: Written, after: Written) -> dict[str, dict[str, Floats]]:
    """Return measured, nominal and explained signals of every channel that both models follow."""
    series = setting.series
    measured = {"dq_m": series.speed("q_m")}
    measured |= {name: series[name] for name in ("tau", "q_m") if name in series}
    if "i_cmd" in series and "i" in series:
        measured["i"] = series["i"]
    if not setting.has_spring or not setting.structure.output_fixed:
        measured.pop("q_m")  # an angle without a spring to ground drifts in any replay
    one, two = replay(setting, before), replay(setting, after)
    if not setting.has_spring:
        (signal, first), (other, last) = (torques(setting, m.fields) for m in (before, after))
        measured["tau_m"], one["tau_m"], two["tau_m"] = signal, first, last - other + signal
    found = {}
    for name, signal in measured.items():
        if name in one and np.isfinite(one[name] + two[name]).all():
            found[name] = {"measured": signal, "before": one[name], "after": two[name]}
    return found
