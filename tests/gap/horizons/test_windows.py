"""Where the windows of a record lie."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap.horizons.prediction.log import Log, to_log
from cjt_gym.gap.horizons.prediction.pieces import cut, split
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, make_windows, samples
from cjt_gym.joint import get_structure
from tests.gap.horizons.rotor import DT, datasheet, record

RIGID = get_structure("rigid")
LOST = (5.0, 5.12)


@pytest.fixture(scope="module")
def log() -> Log:
    return to_log(record(), datasheet(), RIGID)


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
