"""How far the gap shrinks: replay of unseen data, without and with the effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.force import fair_cutoff, torque_noise, torques
from cjt_gym.gap.replay import Written, replay
from cjt_gym.gap.setting import Setting

Floats = NDArray[np.float64]
BLOCK = 0.5
"""Length of a block of the bootstrap [s]."""
FEWEST = 10
"""Least number of blocks of a record."""
DRAWS = 400
HARM = 0.1
"""Relative growth of the gap from which an effect does harm."""


@dataclass(frozen=True)
class Gap:
    """The replay error on held-out data, relative to the rms of the signal.

    Attributes:
        before: With the nominal joint.
        after: With the effects added.
        floor: What the noise of the sensor alone would leave.
        removed: Share of the error that is gone.
        low: Low end of its 95 % interval.
        high: High end of its 95 % interval.
        held_out: Whether the data were kept from the fit.
        by_channel: Errors before and after, by channel.
        replays: Measured, nominal and explained signals by channel, each of shape (N,).
    """

    before: float
    after: float
    floor: float
    removed: float
    low: float
    high: float
    held_out: bool
    by_channel: Mapping[str, Mapping[str, float]]
    replays: Mapping[str, Mapping[str, Floats]] = field(default_factory=dict)


def measure_gap(
    settings: Sequence[Setting], nominal: Written, explained: Written, held_out: bool
) -> Gap:
    """Return how far the gap shrinks over records that a fit has not seen.

    The error of a channel is taken over all records. The joint torque counts where there is one;
    without a spring the drive torque that the measured motion needs, because nothing else keeps a
    replay from drifting; else the motor's velocity.
    """
    errors: dict[str, list[tuple[Floats, Floats, Floats]]] = {}
    replays: dict[str, dict[str, Floats]] = {}
    for setting in settings:
        one, two = compared(setting, nominal), compared(setting, explained)
        for name, (signal, before) in one.items():
            # Both models are held against the torque that the drive applied, as each knows it.
            after = two[name][1] - two[name][0] + signal
            if np.isfinite(before).all() and np.isfinite(after).all():
                errors.setdefault(name, []).append((before - signal, after - signal, signal))
                replays[name] = {"measured": signal, "before": before, "after": after}
    if not errors:
        return Gap(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, held_out, {})
    table = {name: _relative(parts) for name, parts in errors.items()}
    main = main_channel(settings[0]) if main_channel(settings[0]) in table else next(iter(table))
    first, last = table[main]
    low, high = _interval(errors[main], settings[0].series.dt)
    noise = _noise(settings[0], main)
    rms = float(np.sqrt(np.mean(np.concatenate([s for _, _, s in errors[main]]) ** 2)))
    channels = {name: {"before": b, "after": a} for name, (b, a) in table.items()}
    floor = noise / max(rms, 1e-300)
    removed = _removed(first, last)
    return Gap(first, last, floor, removed, low, high, held_out, channels, replays)


def harms(settings: Sequence[Setting], without: Written, explained: Written) -> bool:
    """Return whether the gap on data that a fit has not seen is surely larger with an effect.

    Datasheet values that are strained in its stead may fit a record about as well; so the gap must
    grow by more than `HARM`.
    """
    return measure_gap(settings, without, explained, True).high < -HARM


def gap_of(replays: Mapping[str, Mapping[str, Floats]], main: str, noise: float, dt: float) -> Gap:
    """Return the gap of replays of one record that no fit has seen.

    Args:
        replays: "measured", "before" and "after" by channel, each of shape (N,).
        main: The channel that counts.
        noise: Deviation of one of its samples.
        dt: Sample time [s].
    """
    errors = {
        name: [(r["before"] - r["measured"], r["after"] - r["measured"], r["measured"])]
        for name, r in replays.items()
    }
    table = {name: _relative(parts) for name, parts in errors.items()}
    first, last = table[main]
    low, high = _interval(errors[main], dt)
    rms = float(np.sqrt(np.mean(replays[main]["measured"] ** 2)))
    channels = {name: {"before": b, "after": a} for name, (b, a) in table.items()}
    floor = noise / max(rms, 1e-300)
    removed = _removed(first, last)
    return Gap(first, last, floor, removed, low, high, True, channels, replays)


def main_channel(setting: Setting) -> str:
    """Return the channel whose error is the gap."""
    if not setting.has_spring:
        return "tau_m"
    return "tau" if "tau" in setting.series else "dq_m"


def compared(setting: Setting, written: Written) -> dict[str, tuple[Floats, Floats]]:
    """Return the measured and the modelled signal, shape (N,), of every channel to compare."""
    model = replay(setting, written)
    found = {"dq_m": (setting.series.speed("q_m"), model["dq_m"])}
    if "tau" in setting.series and setting.has_spring:
        found["tau"] = (setting.series["tau"], model["tau"])
    if not setting.has_spring:
        found["tau_m"] = torques(setting, written.fields)
    return found


def _noise(setting: Setting, channel: str) -> float:
    if channel == "tau":
        return setting.std("tau")
    if channel == "tau_m":
        return torque_noise(setting, fair_cutoff(setting))
    return setting.std("q_m") * float(np.sqrt(2.0)) / (4.0 * setting.series.dt)


def _relative(parts: list[tuple[Floats, Floats, Floats]]) -> tuple[float, float]:
    one, two, signal = (np.concatenate([p[k] for p in parts]) for k in range(3))
    scale = max(float(np.sqrt(np.mean(signal**2))), 1e-300)
    return float(np.sqrt(np.mean(one**2))) / scale, float(np.sqrt(np.mean(two**2))) / scale


def _removed(before: float, after: float) -> float:
    return 1.0 - after / before if before > 0.0 else 0.0


def _interval(parts: list[tuple[Floats, Floats, Floats]], dt: float) -> tuple[float, float]:
    """Return the 95 % interval of the share removed, by a bootstrap over blocks."""
    tables: list[list[Floats]] = []
    for one, two, _ in parts:
        size = max(min(int(BLOCK / dt), len(one) // FEWEST), 1)
        starts = np.arange(0, len(one), size)
        tables.append([np.add.reduceat(error**2, starts) for error in (one, two)])
    table = np.concatenate(tables, axis=1).T
    rng = np.random.default_rng(0)
    sums = table[rng.integers(0, len(table), (DRAWS, len(table)))].sum(axis=1)
    removed = 1.0 - np.sqrt(sums[:, 1] / np.maximum(sums[:, 0], 1e-300))
    low, high = np.quantile(removed, [0.025, 0.975])
    return float(low), float(high)
