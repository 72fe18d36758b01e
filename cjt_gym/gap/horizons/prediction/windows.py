"""Prediction windows of records: their starts, lengths and pieces of the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.horizons.prediction.forward import CHANNELS, LEAD, Forecast
from cjt_gym.gap.horizons.prediction.log import Log
from cjt_gym.gap.horizons.prediction.pieces import Piece, joined_up, size_of
from cjt_gym.gap.horizons.prediction.placement import SPREAD, WHOLE, placed, points, samples, stays
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

Integers = NDArray[np.int64]
Key = tuple[str, float]
HORIZONS = (0.02, 0.1, 0.5)
"""Prediction horizons [s]."""
MOST = 80
"""Maximum number of windows of a search."""
STEP = 1e-3
"""Approximate longest sample time that the joint's kernel takes in one step [s]."""
RARE = 0.1
"""Share of a record below which the pieces that are long enough for a horizon do not stand for it:
between frequent gaps, a single window would decide what happens over that horizon."""
SCRAP = 0.2
"""Length relative to the longest piece up to which a piece between two gaps is not such a one."""
DECISIVE, PREDICTED = 8, 3.0
"""Number of pieces above which a single piece is not decisive, and the ratio of the errors in it
above which the other joint predicts what happens there."""
STILL = 0.05
"""Share of a channel's mean square up to which nothing happens in a window."""
TRIVIAL = 0.03
"""Relative error that is negligible."""
AWAY = 100.0
"""Largest relative error, which stands for a prediction that is not finite."""
TINY = 1e-12


@dataclass(frozen=True)
class Group:
    """Windows of one length of one record.

    Attributes:
        log: Index of the record.
        horizons: Horizons at which errors are taken [s]; only `WHOLE` for a whole piece.
        starts: First sample of each window, shape (W,).
        length: Samples of each window.
        pieces: Piece of each window, numbered over all records, shape (W,).
        leads: Samples before each window over which the joint is held to the record, shape (W,).
        weights: Number of evenly spread windows that each stands for, shape (W,).
    """

    log: int
    horizons: tuple[float, ...]
    starts: Integers
    length: int
    pieces: Integers
    leads: Integers
    weights: Floats

    def points(self, horizon: float, dt: float) -> Integers:
        """Return the samples of a window that are evaluated at a horizon."""
        return points(horizon, self.length, dt)


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows over some records, and the magnitude of the signals in them.

    Attributes:
        logs: The records.
        groups: The windows.
        keys: Channel and horizon of each kind of error.
        scales: For each key, mean square change of the channel over its windows [unit^2].
        moving: For each key, the windows in which the channel moves noticeably, shape (W,) each.
    """

    logs: tuple[Log, ...]
    groups: tuple[Group, ...]
    keys: tuple[Key, ...]
    scales: Floats
    moving: tuple[NDArray[np.bool_], ...]

    @property
    def count(self) -> int:
        """Number of windows."""
        return sum(len(g.starts) for g in self.groups if g.horizons != (WHOLE,))

    @property
    def samples(self) -> int:
        """Samples of one prediction; long samples count as the number of their kernel steps."""
        steps = [
            len(g.starts) * g.length * max(self.logs[g.log].dt / STEP, 1.0) for g in self.groups
        ]
        return round(sum(steps))

    def every(self, step: int) -> Windows:
        """Return every `step`-th window, and every `step`-th whole piece."""
        long = [g for g in self.groups if g.horizons == (WHOLE,)]
        groups = [g for g in self.groups if g.horizons != (WHOLE,)]
        kept = [
            replace(
                g,
                starts=g.starts[::step].copy(),
                pieces=g.pieces[::step],
                leads=g.leads[::step].copy(),
                weights=g.weights[::step],
            )
            for g in groups
        ]
        return _scaled(self.logs, (*kept, *long[::step]))

    def alone(self) -> Windows:
        """Return the windows without their past, as if simulated from their first states alone."""
        groups = (replace(g, leads=np.zeros_like(g.leads)) for g in self.groups)
        return replace(self, groups=tuple(groups))

    def errors(self, joint: Joint) -> list[Floats]:
        """Return predicted minus measured for each key, shape (windows, points) each.

        Errors are relative to the rms change of the channel, times the root of the weight of their
        window. They are `AWAY` where the prediction is not finite.
        """
        parts: dict[Key, list[Floats]] = {key: [] for key in self.keys}
        used = {group.log for group in self.groups}
        forecasts = {n: Forecast(joint, self.logs[n]) for n in used}
        for group in self.groups:
            log = self.logs[group.log]
            lengths = np.full(len(group.starts), group.length)
            out = forecasts[group.log].windows(group.starts, lengths, group.leads)
            for key, at in self._kinds(group):
                known = log.measured[key[0]][group.starts[:, None] + at]
                error = out[:, at, CHANNELS[key[0]]] - known
                if key[0] == "tau":  # every record has its own zero
                    good = np.isfinite(error)
                    error = error - (np.mean(error[good]) if good.any() else 0.0)
                parts[key].append(error)
        found = []
        for k, key in enumerate(self.keys):
            error = _joined(parts[key]) / np.sqrt(self.scales[k])
            error = np.where(np.abs(error) < AWAY, error, AWAY)
            found.append(error * self.roots(key)[:, None])
        return found

    @property
    def lost(self) -> list[Floats]:
        """Errors of a joint that cannot be simulated, like those of `errors`."""
        shapes: dict[Key, list[tuple[int, int]]] = {key: [] for key in self.keys}
        for group in self.groups:
            for key, at in self._kinds(group):
                shapes[key].append((len(group.starts), len(at)))
        sizes = ((sum(n for n, _ in s), max(m for _, m in s)) for s in shapes.values())
        return [np.full(size, AWAY) for size in sizes]

    def _kinds(self, group: Group) -> list[tuple[Key, Integers]]:
        log = self.logs[group.log]
        return [
            ((channel, horizon), group.points(horizon, log.dt))
            for horizon in group.horizons
            for channel in log.measured
        ]

    def pieces(self, key: Key) -> Integers:
        """Return the piece of each window of a kind, shape (W,)."""
        return np.concatenate([g.pieces for g in self.groups_of(key)])

    def roots(self, key: Key) -> Floats:
        """Return the root of the weight of each window of a kind, shape (W,)."""
        return np.concatenate([np.sqrt(g.weights) for g in self.groups_of(key)])

    def groups_of(self, key: Key) -> list[Group]:
        """Return the groups with errors of a kind."""
        return [g for g in self.groups if key in [kind for kind, _ in self._kinds(g)]]


def _joined(parts: list[Floats]) -> Floats:
    """Return errors of several groups as one array; short rows repeat their last error."""
    width = max(p.shape[1] for p in parts)
    return np.concatenate([np.pad(p, ((0, 0), (0, width - p.shape[1])), "edge") for p in parts])


def make_windows(
    logs: Sequence[Log],
    pieces: Sequence[Piece],
    most: int = MOST,
    *,
    whole: bool = False,
    kept: float = SPREAD,
) -> Windows:
    """Return windows over pieces of records, placed as `placement` says.

    A window may run on into the next piece if there is no gap between them, and counts to that in
    which it starts. What is too short for the longest horizon gets windows of the longest that
    fits.

    Args:
        logs: The records.
        pieces: Pieces in which the windows may lie.
        most: Maximum number of windows.
        whole: Whether whole pieces are windows, too, as with a held output.
        kept: Share of the windows that is spread evenly over logs that mostly rest.
    """
    groups = []
    total = max(size_of(pieces), 1)
    for number, log in enumerate(logs):
        here = [k for k, p in enumerate(pieces) if p.log == number]
        firsts = np.array([pieces[k].start for k in here])
        left = joined_up([pieces[k] for k in here])
        for count in range(len(HORIZONS), 0, -1):
            length = samples(HORIZONS[count - 1], log.dt)
            own = [p for p in left if p.stop - p.start > length]
            if size_of(own) < RARE * size_of(left):
                continue
            left = [p for p in left if p.stop - p.start <= length]
            share = most * size_of(own) / total
            horizons = HORIZONS[:count]
            starts, before, weights = placed(log, own, length, max(share, 1.0), horizons, kept)
            if len(starts):
                numbers = np.array(here)[np.searchsorted(firsts, starts, side="right") - 1]
                room = starts if log.whole.all() else before
                lead = np.minimum(max(round(LEAD / log.dt), 3), room)
                groups.append(Group(number, horizons, starts, length, numbers, lead, weights))
    if whole:
        longest = max((p.stop - p.start for p in pieces), default=0)
        groups += [
            Group(p.log, (WHOLE,), np.array([p.start]), p.stop - p.start, np.array([k]),
                  np.array([0]), np.ones(1))
            for k, p in enumerate(pieces)
            if p.stop - p.start > SCRAP * longest
        ]  # fmt: skip
    return _scaled(tuple(logs), tuple(groups))


def rescaled(windows: Windows) -> Windows:
    """Return windows relative to what their logs do beyond motion at constant speed."""
    return _scaled(windows.logs, windows.groups)


def _scaled(logs: tuple[Log, ...], groups: tuple[Group, ...]) -> Windows:
    blank = Windows(logs, groups, (), np.zeros(0), ())
    squares: dict[Key, list[Floats]] = {}
    for group in groups:
        log = logs[group.log]
        for key, at in blank._kinds(group):
            x = log.measured[key[0]][group.starts[:, None] + at]
            did = (x - stays(log, *key, group.starts, at)) * np.sqrt(group.weights)[:, None]
            squares.setdefault(key, []).append(did**2)
    scales = [sum(float(x.sum()) for x in s) / sum(x.size for x in s) for s in squares.values()]
    each = [np.concatenate([x.mean(axis=1) for x in s]) for s in squares.values()]
    moving = tuple(x > STILL * scale for x, scale in zip(each, scales, strict=True))
    return Windows(logs, groups, tuple(squares), np.maximum(scales, TINY**2), moving)


def relative(windows: Windows, errors: Sequence[Floats]) -> dict[Key, float]:
    """Return the relative error of each kind; 1 is no better than extrapolating the start."""
    return {key: float(np.sqrt(np.mean(e**2))) for key, e in zip(windows.keys, errors, strict=True)}


def worse(
    windows: Windows, own: Sequence[Floats], other: Sequence[Floats], slack: Mapping[Key, float]
) -> list[Key]:
    """Return the kinds whose errors exceed others, with and without the worst piece.

    A single piece with an unrecorded event, such as a brake, is not decisive as long as there are
    `DECISIVE` others; but one that the other joint predicts is no such event.

    Args:
        windows: The predicted windows.
        own: Errors of each kind.
        other: Errors to compare with.
        slack: For each kind, the factor by which they may be larger.
    """
    found = []
    for key, a, b in zip(windows.keys, own, other, strict=True):
        _, pieces = np.unique(windows.pieces(key), return_inverse=True)
        mine, limit = (np.bincount(pieces, np.mean(e**2, axis=1)) for e in (a, slack[key] * b))
        every = np.ones(len(mine), dtype=bool)
        rest, worst = every.copy(), np.argmax(mine - limit)
        rest[worst] = len(mine) <= DECISIVE or mine[worst] > PREDICTED**2 * limit[worst]
        least = [TRIVIAL**2 * np.sum(some[pieces]) for some in (every, rest)]
        if mine.sum() > max(limit.sum(), least[0]) and mine[rest].sum() > max(
            limit[rest].sum(), least[1]
        ):
            found.append(key)
    return found


def bootstrapped(
    windows: Windows, before: Sequence[Floats], after: Sequence[Floats], key: Key
) -> tuple[float, float]:
    """Return the bootstrapped 95 % interval, over pieces, of an error's relative reduction."""
    k = windows.keys.index(key)
    pieces = windows.pieces(key)
    order = np.unique(pieces)
    one, two = (
        np.bincount(np.searchsorted(order, pieces), np.mean(e[k] ** 2, axis=1)) * 1.0
        for e in (before, after)
    )
    drawn = np.random.default_rng(0).integers(0, len(order), (400, len(order)))
    ratio = np.sqrt(two[drawn].sum(axis=1) / np.maximum(one[drawn].sum(axis=1), 1e-300))
    low, high = np.quantile(1.0 - ratio, [0.025, 0.975])
    return float(low), float(high)
