"""A loop that runs for some time loses no sample, and tells how late it was.

No time is asserted, for machines on which tests run are busy; so no loop is closed, either, which a
machine that stalls would make unstable.
"""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from tests.canbus.soak import soaked
from tests.canbus.witness import Witnesses


def check(result: dict[str, Any]) -> None:
    """Look whether everything is there."""
    assert result["rows_missing"] == 0
    assert result["steps"] > 10
    for name in ("lateness_us", "ages_us", "answers_us"):
        values = list(result[name].values())
        assert values == sorted(values)
        assert values[-1] > 0.0
    assert result["rmse"] > 0.0


def test_short_soak_is_complete_and_tells_how_late_it_was() -> None:
    for seconds in (3.0, 20.0, 60.0):  # a machine that stands still may leave no step in three
        result = soaked(seconds, rate=500.0, allowance=0.9, controller="open_loop")
        if result["steps"] > 10:
            break
    check(result)


@pytest.mark.slow
def test_soak_of_a_minute_at_a_kilohertz() -> None:
    result = soaked(60.0, rate=1000.0, allowance=0.5, controller="open_loop")
    check(result)
    assert result["faults"] == []


def test_witnesses_see_a_processor_that_stands_still_and_nothing_else(tmp_path: Path) -> None:
    cpu = min(os.sched_getaffinity(0))
    witnesses = Witnesses()
    with witnesses.watching(tmp_path, [cpu], None) as (number,):
        begin = time.perf_counter()
        os.kill(number, signal.SIGSTOP)
        time.sleep(0.3)
        os.kill(number, signal.SIGCONT)
        end = time.perf_counter()
        time.sleep(0.2)
    assert 0.25 < witnesses.longest(begin, end) < end - begin + 0.1
    assert witnesses.longest(end + 10.0, end + 11.0) == 0.0
