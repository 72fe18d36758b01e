"""Logs that lose a few rows every now and then."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.check.examine import examine
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.windows import HORIZONS
from cjt_gym.gap.recorded.bridged import LONGEST, bridged
from cjt_gym.joint import get_structure
from cjt_gym.records import Record
from tests.gap.check.moved import BOTH, DAMPING, FRICTION, QUICK, columns, joint, record

RIGID = get_structure("rigid")
DT = 5e-3
EVERY, LOST = 35, 5
"""Rows from one gap to the next, and rows that are lost in each."""


def broken(kind: str = BOTH, lost: int = LOST) -> tuple[Record, Record]:
    """Return a log without and with gaps."""
    table = {name: x for name, x in columns(kind, 20.0, dt=DT).items() if name != "i_cmd"}
    keep = np.arange(len(table["t"])) % EVERY < EVERY - lost
    return record(table), record({name: x[keep] for name, x in table.items()})


def test_short_gaps_are_filled_where_the_input_changes_slowly() -> None:
    whole, log = broken()
    (filled,), (said,) = bridged([log])
    rows = len(filled)
    np.testing.assert_allclose(filled.t, whole.t[:rows], atol=1e-12)
    known = np.isin(filled.t, log.t)
    for name in ("i", "q_m"):
        np.testing.assert_array_equal(filled[name][known], log[name])
    travel = np.abs(np.diff(whole["q_m"])).max()
    assert np.abs(filled["q_m"] - whole["q_m"][:rows]).max() < 0.25 * travel
    assert "gaps of up to 30 ms filled by interpolation" in said
    assert said in examine(log, joint(), RIGID).notes


@pytest.mark.parametrize(("kind", "lost"), [(QUICK, 9), (BOTH, round(LONGEST / DT) + 2)])
def test_no_gap_is_filled_that_is_long_or_in_which_much_happens(kind: str, lost: int) -> None:
    _, log = broken(kind, lost)
    (same,), said = bridged([log])
    assert same is log
    assert said == ()


@pytest.mark.slow
def test_a_log_of_short_stretches_is_judged_over_half_a_second_and_explained() -> None:
    _, log = broken()
    assert {"damping", "coulomb"} <= set(examine(log, joint(), RIGID).can_tell)
    found = diagnose(log, joint())
    assert {row.seconds for row in found.horizons} == set(HORIZONS)
    values = {e.name: e.parameters for e in found.effects}
    assert values["coulomb"]["d_cm"].value == pytest.approx(FRICTION, rel=0.05)
    assert values["damping"]["d_m"].value == pytest.approx(DAMPING, rel=0.1)


def test_one_long_stretch_among_many_short_ones_does_not_stand_for_a_horizon() -> None:
    table = columns(QUICK, 40.0, dt=DT)
    keep = (np.arange(len(table["t"])) % EVERY < EVERY - 9) | (table["t"] < 0.9)
    log = record({name: x[keep] for name, x in table.items()})
    case = make_case([log], [], joint(), RIGID)
    assert {seconds for _, seconds in case.fit.keys} == {0.02, 0.1}
