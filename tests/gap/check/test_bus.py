"""What a record from hardware says of its bus."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap.check import Examination, examine
from cjt_gym.records import Record, default_units
from tests.gap.check.moved import columns, joint


def examined(stamps: str | None, unanswered: int = 0) -> Examination:
    table = columns()
    count = len(table["t"])
    trip = np.full(count, 6e-4)
    trip[: 1 + unanswered] = 0.0
    table |= {"age": np.full(count, 8e-4), "lateness": np.full(count, 1e-4), "round_trip": trip}
    known = {"provenance": {} if stamps is None else {"stamps": stamps}}
    return examine(Record(table, default_units(table), **known), joint(), None)


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        ("hardware", "; frames were stamped by the clock of the interface."),
        ("reception", "; frames were stamped where the program received them"),
        (None, "(99 %: 0.6 ms)."),
    ],
)
def test_round_trip_and_stamps_are_told(stamps: str | None, said: str) -> None:
    found = examined(stamps)
    assert not any("lateness" in fault or "age" in fault for fault in found.faults)
    answer, delay = found.notes[-2:]
    assert answer.startswith("A command is answered after 0.6 ms")
    assert said in answer
    assert "command_delay.delay=0.0004 measurement_delay.delay=0.0011" in delay


def test_steps_without_an_answer_are_told() -> None:
    count = len(columns()["t"])
    share = examined(None, unanswered=count // 20).notes[-1]
    assert share == "No answer came within 5 % of the control steps."
