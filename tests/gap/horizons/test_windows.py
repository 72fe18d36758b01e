"""Where the windows of a record lie."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap.horizons.prediction.log import Log, to_log
from cjt_gym.gap.horizons.prediction.pieces import cut, split
from cjt_gym.gap.horizons.prediction.placement import samples, stays
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, make_windows
from cjt_gym.joint import get_structure
from cjt_gym.records import Record
from tests.gap.horizons.rotor import DT, datasheet, record

RIGID = get_structure("rigid")
LOST = (5.0, 5.12)


def log_of(made: Record) -> Log:
    return to_log(made, datasheet(), RIGID)


@pytest.fixture(scope="module")
def log() -> Log:
    return log_of(record())


def test_no_window_spans_a_gap() -> None:
    log = to_log(record(gap=LOST), datasheet(), RIGID)
    lost = np.flatnonzero(~log.whole)
    assert lost.size >= 0.1 / DT
    for group in make_windows([log], cut([log])).groups:
        for start, lead in zip(group.starts, group.leads, strict=True):
            inside = (lost >= start - lead) & (lost < start + group.length)
            assert not inside.any()


def test_what_is_held_out_lies_between_what_is_fitted(log: Log) -> None:
    fitted, held = split([log], cut([log]))
    assert len(held) >= 3
    order = sorted((p.start, p in held) for p in [*fitted, *held])
    kept = [k for k, (_, is_held) in enumerate(order) if is_held]
    assert kept[0] > 0
    assert min(np.diff(kept)) > 1, "no two neighbours are held out"


def test_a_log_at_rest_has_evenly_spread_windows() -> None:
    still = record().with_columns({"q_m": np.zeros(len(record()))})
    log = log_of(still)
    (group,) = make_windows([log], cut([log])).groups
    assert np.isfinite(group.weights).all()
    assert np.ptp(np.diff(group.starts)) <= 1


def test_of_a_record_with_motion_in_few_pieces_none_is_held_out() -> None:
    log = to_log(record().slice(0, round(8.0 / DT)), datasheet(), RIGID)
    pieces = cut([log])
    assert len(pieces) > 8, "two would be held out"
    assert split([log], pieces) == (pieces, [])


def test_windows_begin_everywhere_in_a_record_though_it_is_cut_into_pieces(log: Log) -> None:
    pieces = cut([log])
    (group,) = make_windows([log], pieces, 200).groups
    last = len(log) - samples(max(HORIZONS), log.dt)
    assert np.diff(group.starts).max() < 2.0 * last / 200, "a start of motion may fall anywhere"
    assert (group.starts[0], group.starts[-1]) == (0, last), "nor is a stop at the end missed"
    for start, number in zip(group.starts, group.pieces, strict=True):
        assert pieces[number].start <= start < pieces[number].stop


def test_no_fitted_window_enters_what_is_held_out(log: Log) -> None:
    fitted, held = split([log], cut([log]))
    used = [np.zeros(len(log), dtype=bool) for _ in range(2)]
    for rows, pieces in zip(used, (fitted, held), strict=True):
        (group,) = make_windows([log], pieces).groups
        for start in group.starts:
            rows[start : start + group.length] = True
    assert all(rows.mean() > 0.15 for rows in used)
    assert not (used[0] & used[1]).any()


def resting() -> Log:
    """Return a log of 60 s that moves for one second, here and there."""
    t = np.arange(0.0, 60.0, 0.004)
    v = np.zeros_like(t)
    for start, size in ((8.0, 30.0), (31.0, -20.0), (52.0, 5.0)):
        v += size * np.exp(-(((t - start) / 0.1) ** 2))
    q = np.cumsum(v) * 0.004 + np.random.default_rng(0).normal(0.0, 1e-4, t.shape)
    record = Record(
        {"t": t, "q_m": q, "i": 0.1 * np.gradient(v, 0.004)},
        {"t": "s", "q_m": "rad", "i": "A"},
        structure="rigid",
    )
    return to_log(record, datasheet(), RIGID)


def test_in_a_log_that_mostly_rests_half_of_the_windows_move() -> None:
    log = resting()
    windows = make_windows([log], cut([log]))
    (group,) = windows.groups
    moving = np.count_nonzero(
        np.ptp(log.states[group.starts[:, None] + range(group.length), 0], 1) > 0.1
    )
    assert 0.3 < moving / len(group.starts) < 0.8
    even = np.linspace(0, len(log) - group.length - 1, 80).astype(int)
    assert np.count_nonzero(np.ptp(log.states[even[:, None] + range(group.length), 0], 1) > 0.1) < 8


@pytest.mark.parametrize("horizon", HORIZONS)
def test_they_still_stand_for_the_whole_log(horizon: float) -> None:
    log = resting()
    windows = make_windows([log], cut([log]))
    (group,) = windows.groups
    every, at = np.arange(len(log) - group.length), group.points(horizon, log.dt)
    moved = log.measured["q_m"][every[:, None] + at] - stays(log, "q_m", horizon, every, at)
    known = windows.scales[windows.keys.index(("q_m", horizon))]
    assert known == pytest.approx(np.mean(moved**2), rel=0.25)
    assert len(group.starts) <= 80
    assert group.weights.mean() == pytest.approx(1.0)


def test_in_a_log_that_moves_all_the_time_they_are_spread_evenly(log: Log) -> None:
    for group in make_windows([log], cut([log])).groups:
        assert (group.weights == 1.0).all()
