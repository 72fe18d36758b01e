"""Predictable part of an error, whatever its cause.

A flexible ridge regression (on random Fourier features) of the error at the end of each window on
the state at its start, the input within it and the recent past; one on what torques of many shapes
would do within the window; and one on the errors of the windows just before. They are trained on
some pieces of the record and tested on the others, without a sample in common: what they predict
there is not noise. The remainder is the floor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.horizons.prediction.forward import CHANNELS, Forecast
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, Key, Windows
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
FEATURES = 60
FOLDS = 6
RIDGES = np.geomspace(1e-2, 1e4, 9)
NEXT = 0.01
"""Time between the accelerations that show how the motion has changed [s]."""
FEWEST = 30
"""Fewest windows for a result."""
CLIP = 4.0
"""Limit of the errors, in robust deviations, so that a single impact has little influence."""
LOOKS = 25
"""Samples of a window at which a torque of some shape is evaluated."""
SHARP = (0.02, 0.05, 0.2)
"""Speeds, relative to fast motion, over which dry friction turns round or falls."""
TURNS = (1.0, 2.0)
"""Waves per revolution of a torque over the angle."""
SWINGS = (3.0, 6.0)
"""The same in waves over half the travel, times two pi."""
EARLIER = 2
"""Number of windows before each whose errors may show its own: two tell a vibration's phase."""


@dataclass(frozen=True)
class Predictable:
    """Predictable part of the errors of one kind.

    Attributes:
        share: Share of their mean square that a regression predicts on unseen pieces, 0 to 1.
        deviation: Standard deviation of that share, from the folds.
        lasting: Whether the errors just before predict it best: what acts outlasts a window.
    """

    share: float
    deviation: float
    lasting: bool = False


def features(windows: Windows, key: Key) -> tuple[Floats, Floats]:
    """Return variables on which an error may depend, of unit deviation, shape (windows, n) each.

    The first are state, input and its past, the second how the motion has changed until then.
    """
    horizon, rows, changes = key[1], [], []
    for group in windows.groups_of(key):
        log = windows.logs[group.log]
        last = int(group.points(horizon, log.dt)[-1])
        before = max(round(0.05 / log.dt), 2)
        start, stop = group.starts, group.starts + last
        total = np.concatenate([[0.0], np.cumsum(log.command)])
        past = np.maximum(start - before, 0)
        v, q, a = log.speed[start], log.states[start, 0], log.acceleration[start]
        u = (total[stop] - total[start]) / np.maximum(stop - start, 1)
        old = (total[start] - total[past]) / np.maximum(start - past, 1)
        load = log.load[start]
        twist = log.states[start, 0] - log.states[start, 2]
        rows.append(
            np.stack(
                [v, np.sign(v) * np.sqrt(np.abs(v)), u, old, u - old, a, q, load, twist,
                 log.t[start]], axis=1,
            )
        )  # fmt: skip
        around = [np.clip(start + k * round(NEXT / log.dt), 0, len(log) - 1) for k in (-2, -1)]
        changes.append(
            np.stack([*(log.acceleration[k] for k in around), log.speed[around[0]]], axis=1)
        )
    return _scaled(np.concatenate(rows)), _scaled(np.concatenate(changes))


def torques(windows: Windows, forecasts: Mapping[int, Forecast], key: Key) -> Floats:
    """Return what torques of many shapes do within each window, scaled, shape (windows, n).

    A torque displaces a mass by its integral, weighed with the time that is left. Angle and speed
    are those that the joint predicts, in which an unknown disturbance cannot show.

    Args:
        windows: The windows.
        forecasts: The joint on each record.
        key: The kind of error.
    """
    logs = windows.logs
    fast, strong = (
        max(float(np.percentile(np.abs(np.concatenate(x)), 95)), 1e-12)
        for x in ([log.speed for log in logs], [log.command for log in logs])
    )
    angles = np.concatenate([log.states[:, 0] for log in logs])
    middle, travel = float(angles.mean()), max(0.5 * float(np.ptp(angles)), 1e-12)
    rows = []
    for group in windows.groups_of(key):
        log = logs[group.log]
        last = int(group.points(key[1], log.dt)[-1])
        lengths = np.full(len(group.starts), last + 1)
        q = forecasts[group.log].windows(group.starts, lengths, group.leads)[:, :, 0]
        at = np.unique(np.linspace(0, last, LOOKS + 1).astype(int))
        v = np.gradient(q, log.dt, axis=1)[:, at] / fast
        u = log.command[group.starts[:, None] + at] / strong
        shapes = _shapes(u, v, q[:, at], (q[:, at] - middle) / travel)
        rows.append(np.mean(shapes * (1.0 - at / max(last, 1)), axis=2).T)
    return _scaled(np.nan_to_num(np.concatenate(rows)))


def _shapes(u: Floats, v: Floats, q: Floats, x: Floats) -> Floats:
    """Return torques of many shapes, shape (n, windows, samples).

    Args:
        u: Input, relative to a strong one.
        v: Speed, relative to fast motion.
        q: Angle [rad].
        x: Angle, from -1 to 1 over the travel.
    """
    sign = np.tanh(v / SHARP[0])
    waves = [
        wave(k * y) for y, ks in ((q, TURNS), (x, SWINGS)) for k in ks for wave in (np.sin, np.cos)
    ]
    even = [np.ones_like(u), x, x**2, *waves]
    dry = [sign * one for one in (*even, np.abs(u), *(np.exp(-((v / w) ** 2)) for w in SHARP[1:]))]
    smooth = [u, u * np.abs(u), u**3, np.abs(u), v, v * np.abs(v), v**3, np.abs(v), x**3]
    driven = [u * one for one in (x, np.sin(q), np.cos(q))]  # of a k_t that varies
    return np.stack([*even, *dry, *smooth, *driven])


def _scaled(x: Floats) -> Floats:
    spread = x.std(axis=0)
    x = x[:, spread > 1e-12] - x[:, spread > 1e-12].mean(axis=0)
    return np.asarray(np.clip(x / spread[spread > 1e-12], -4.0, 4.0))


def earlier(windows: Windows, forecasts: Mapping[int, Forecast], key: Key) -> Floats:
    """Return errors at the ends of the windows just before, of unit deviation, shape (windows, n).

    Each ends where the next begins. They are 0 where the record has no room for them.

    Args:
        windows: The windows.
        forecasts: The joint on each record.
        key: The kind of error.
    """
    channel, horizon = key
    rows = []
    for group in windows.groups_of(key):
        log = windows.logs[group.log]
        last = int(group.points(horizon, log.dt)[-1])
        broken = np.concatenate([[0], np.cumsum(~log.whole)])
        errors = []
        for k in range(1, EARLIER + 1):
            start = np.maximum(group.starts - k * last, 0)
            known = (group.starts >= k * last) & (broken[group.starts + 1] == broken[start])
            leads, lengths = np.minimum(group.leads, start), np.full(len(start), last + 1)
            out = forecasts[group.log].windows(start, lengths, leads)[:, last, CHANNELS[channel]]
            error = out - log.measured[channel][start + last]
            errors.append(np.where(known & np.isfinite(error), error, 0.0))
        rows.append(np.stack(errors, axis=1))
    return _scaled(np.concatenate(rows))


def predictable(
    windows: Windows,
    errors: list[Floats],
    key: Key,
    past: Floats | None = None,
    shapes: Floats | None = None,
    seed: int = 0,
) -> Predictable:
    """Return the predictable share of the errors of a kind.

    Args:
        windows: The predicted windows.
        errors: Errors of each kind.
        key: The kind.
        past: What `earlier` returns, to predict errors from earlier ones as well.
        shapes: What `torques` returns, to predict them from torques of many shapes as well.
        seed: Seed of the random features.
    """
    error = errors[windows.keys.index(key)][:, -1]
    pieces, (state, changes) = windows.pieces(key), features(windows, key)
    good = np.isfinite(error)
    error, pieces, state, changes = error[good], pieces[good], state[good], changes[good]
    if len(error) < FEWEST or len(np.unique(pieces)) < FOLDS or not np.any(error):
        return Predictable(0.0, 1.0)
    size = np.median(np.abs(error)) / 0.6745
    y = np.clip(error, -CLIP * size, CLIP * size) if size > 0.0 else error
    order = np.unique(pieces)
    fold = (np.searchsorted(order, pieces) * FOLDS) // len(order)
    folds = _folds(_spans(windows, key)[good], fold)
    if min(train.sum() for train, _ in folds) < FEWEST // 2:
        return Predictable(0.0, 1.0)
    sets = [state, np.hstack([state, changes])]
    root = windows.roots(key)[good][:, None]
    known = [_shares(root * _waves(x, seed), y, folds) for x in sets]
    if shapes is not None:
        known.append(_shares(root * _with_one(shapes[good]), y, folds))
    share, deviation = max(known)
    lasting = False
    if past is not None and past.any():
        by_past = _shares(root * _with_one(past[good]), y, folds)
        lasting = by_past[0] > share
        share, deviation = max(by_past, (share, deviation))
    return Predictable(float(np.clip(share, 0.0, 1.0)), deviation, lasting)


def _spans(windows: Windows, key: Key) -> Integers:
    """Return the record, first sample and sample after the last of each window, shape (W, 3)."""
    spans = []
    for group in windows.groups_of(key):
        last = int(group.points(key[1], windows.logs[group.log].dt)[-1])
        log = np.full(len(group.starts), group.log)
        spans.append(np.stack([log, group.starts, group.starts + last + 1], axis=1))
    return np.concatenate(spans)


def _folds(spans: Integers, fold: Integers) -> list[tuple[Flags, Flags]]:
    """Return which windows train and which test in each fold; no two of them share a sample."""
    found = []
    for f in range(FOLDS):
        test = fold == f
        train = ~test
        for log in np.unique(spans[test, 0]):
            start, stop = spans[test & (spans[:, 0] == log), 1:].T
            apart = (spans[:, 1] >= stop.max()) | (spans[:, 2] <= start.min())
            train &= apart | (spans[:, 0] != log)
        found.append((train, test))
    return found


def _with_one(x: Floats) -> Floats:
    return np.hstack([np.ones((len(x), 1)), x])


def _waves(x: Floats, seed: int) -> Floats:
    """Return variables and random waves of them, shape (windows, n)."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(x.shape[1], FEATURES)) * 0.5
    phase = rng.uniform(0.0, 2.0 * np.pi, FEATURES)
    return np.hstack([np.ones((len(x), 1)), x, np.tanh(10.0 * x[:, :1]), np.cos(x @ w + phase)])


def _shares(phi: Floats, y: Floats, folds: list[tuple[Flags, Flags]]) -> tuple[float, float]:
    """Return the predicted share over folds and its deviation, at the best ridge parameter."""
    total = np.array([np.sum(y[test] ** 2) for _, test in folds])
    left = np.zeros((FOLDS, len(RIDGES)))
    for f, (train, test) in enumerate(folds):
        a, b = phi[train], y[train]
        u, s, vt = np.linalg.svd(a, full_matrices=False)
        project = u.T @ b
        for k, ridge in enumerate(RIDGES):
            weights = vt.T @ (s / (s**2 + ridge) * project)
            left[f, k] = np.sum((y[test] - phi[test] @ weights) ** 2)
    best = int(np.argmin(left.sum(axis=0)))
    share = 1.0 - left[:, best].sum() / max(total.sum(), 1e-300)
    each = (total - left[:, best]) / max(total.sum(), 1e-300)
    return float(share), float(np.std(each) * np.sqrt(FOLDS))


def left(windows: Windows, joint: Joint, *, past: bool = False) -> dict[Key, Predictable]:
    """Return the predictable part of a joint's errors of each kind.

    Args:
        windows: Windows of records.
        joint: The joint.
        past: Whether to predict errors from earlier ones as well.
    """
    errors = windows.errors(joint)
    forecasts = {n: Forecast(joint, windows.logs[n]) for n in {g.log for g in windows.groups}}
    return {
        key: predictable(
            windows, errors, key,
            earlier(windows, forecasts, key) if past else None, torques(windows, forecasts, key),
        )
        for key in windows.keys
        if key[1] in HORIZONS
    }  # fmt: skip
