"""How far the gap shrinks from model to model, in replays of unseen data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cjt_gym.gap.diagnosis import GapSize, NamedEffect
from cjt_gym.gap.evidence import Step
from cjt_gym.gap.judged.replay import Written, replay
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.stages.force import fair_cutoff, torque_noise, torques
from cjt_gym.joint.kernel.arrays import Floats

COUNTED = ("tau", "tau_m", "dq_m")
"""Channels whose errors are reported, the one that counts first."""
BLOCK = 0.5
"""Length of a block of the bootstrap [s]."""
FEWEST = 10
"""Minimum number of blocks in a record."""
DRAWS = 400
HARM = 0.1
"""Relative growth of the gap above which an effect does harm."""


def followed(setting: Setting, models: Sequence[Written]) -> dict[str, Floats]:
    """Return each channel as measured and as every model replays it, shape (1 + models, N).

    Without a spring it is the drive torque that the measured motion needs, since a replay would
    drift; all models are compared with the applied torque as the first model has it.
    """
    series = setting.series
    measured = {"dq_m": series.speed("q_m")}
    if setting.has_spring and "tau" in series:
        measured["tau"] = series["tau"]
    if setting.has_spring and setting.structure.output_fixed:
        measured["q_m"] = series["q_m"]  # without a spring to ground any replay of it drifts
    if "i" in series:
        measured["i"] = series["i"]
    runs = [replay(setting, model) for model in models]
    found = {
        name: np.stack([signal, *(run[name] for run in runs)])
        for name, signal in measured.items()
        if name in runs[0]
    }
    if not setting.has_spring:
        pairs = [torques(setting, model.fields) for model in models]
        applied = pairs[0][0]
        found["tau_m"] = np.stack([applied, *(need - own + applied for own, need in pairs)])
    return found


def off(setting: Setting, model: Written) -> Floats:
    """Return the error of a model's replay in the channel that counts, shape (N,)."""
    measured, replayed = followed(setting, [model])[main_channel(setting)]
    return np.asarray(replayed - measured)


def measure_gap(
    settings: Sequence[Setting],
    models: Sequence[Written],
    held_out: bool,
    named: Sequence[NamedEffect] = (),
) -> tuple[GapSize, tuple[Step, ...], dict[str, dict[str, Floats]]]:
    """Return how far the gap shrinks over records that a fit has not seen.

    Args:
        settings: The records; the error of a channel is taken over all of them.
        models: The nominal joint, optionally the one within its tolerances and those with one
            more effect each, and the explained joint.
        held_out: Whether the records were withheld from the fit.
        named: The effects in the order in which the models have them.

    Returns:
        The gap without and with the effects; the error of each model; the last record as measured
        and as the first and the last model replay it, by channel.
    """
    found = [followed(setting, models) for setting in settings]
    names = dict.fromkeys(name for one in found for name in one)  # not all in every record
    sound = {
        name: [f[name] for f in found if name in f and np.isfinite(f[name][[1, -1]]).all()]
        for name in names
    }
    sound = {name: parts for name, parts in sound.items() if parts}
    replays = {
        name: dict(zip(("measured", "before", "after"), parts[-1][[0, 1, -1]], strict=True))
        for name, parts in sound.items()
    }
    counted = {name: sound[name] for name in COUNTED if name in sound}
    if not counted:
        return GapSize(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, held_out, {}), (), replays
    main, dt = next(iter(counted)), settings[0].series.dt
    size = size_of(counted, main, _noise(settings[0], main), dt, held_out)
    keys = [("nominal", None, None), ("tolerances", None, None)]
    keys += [(e.name, e.body, e.channel) for e in named]  # type: ignore[misc]
    value, (low, high) = relative(counted[main]), _spread(counted[main], dt)[1:]
    steps = zip(keys, value, low, high, strict=False)
    return size, tuple(Step(*k, *map(float, x)) for k, *x in steps if np.isfinite(x).all()), replays


def harms(settings: Sequence[Setting], without: Written, explained: Written) -> bool:
    """Return whether an effect certainly enlarges the gap on unseen data.

    Strained datasheet values in its place may fit a record about as well, so the gap must grow by
    more than `HARM`.
    """
    return bool(settings) and measure_gap(settings, [without, explained], True)[0].high < -HARM


def main_channel(setting: Setting) -> str:
    """Return the channel whose error is the gap."""
    if not setting.has_spring:
        return "tau_m"
    return "tau" if "tau" in setting.series else "dq_m"


def size_of(
    signals: Mapping[str, Sequence[Floats]], main: str, noise: float, dt: float, held_out: bool
) -> GapSize:
    """Return the gap of replays.

    Args:
        signals: By channel one array per record, its first row measured, its second and last the
            first and the last model's, shape (rows, N).
        main: The channel that counts.
        noise: Standard deviation of one of its samples.
        dt: Sample time [s].
        held_out: Whether the records were withheld from the fit.
    """
    table = {name: relative(parts)[[0, -1]] for name, parts in signals.items()}
    before, after = (float(x) for x in table[main])
    removed = 1.0 - after / before if before > 0.0 else 0.0
    low, high = _spread(signals[main], dt)[0]
    floor = noise / max(_rms(np.concatenate([x[0] for x in signals[main]])), 1e-300)
    channels = {n: {"before": float(b), "after": float(a)} for n, (b, a) in table.items()}
    return GapSize(before, after, floor, removed, low, high, held_out, channels)


def relative(parts: Sequence[Floats]) -> Floats:
    """Return the error of each model over the rms of the signal, shape (models,)."""
    x = np.concatenate(parts, axis=1)
    return np.asarray([_rms(row - x[0]) for row in x[1:]]) / max(_rms(x[0]), 1e-300)


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _spread(parts: Sequence[Floats], dt: float) -> tuple[tuple[float, float], Floats, Floats]:
    """Return 95 % intervals by a bootstrap over blocks.

    The first is that of the share that the last model removes; the others are the low and high
    ends of each model's error, shape (models,) each.
    """
    tables = []
    for x in parts:
        length = max(min(int(BLOCK / dt), x.shape[1] // FEWEST), 1)
        squares = np.concatenate([x[:1], x[1:] - x[0]]) ** 2
        tables.append(np.add.reduceat(squares, np.arange(0, x.shape[1], length), axis=1))
    table = np.concatenate(tables, axis=1)
    draws = np.random.default_rng(0).integers(0, table.shape[1], (DRAWS, table.shape[1]))
    sums = np.maximum(table[:, draws].sum(axis=2), 1e-300)
    low, high = np.quantile(1.0 - np.sqrt(sums[-1] / sums[1]), [0.025, 0.975])
    ends = np.quantile(np.sqrt(sums[1:] / sums[0]), [0.025, 0.975], axis=1)
    return (float(low), float(high)), ends[0], ends[1]


def _noise(setting: Setting, channel: str) -> float:
    if channel == "tau":
        return setting.std("tau")
    if channel == "tau_m":
        return torque_noise(setting, fair_cutoff(setting))
    return setting.std("q_m") * float(np.sqrt(2.0)) / (4.0 * setting.series.dt)
