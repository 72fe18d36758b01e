"""Where the datasheet predicts as well as anything could, there is no gap."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.diagnosis import Horizon, Interval, NamedEffect
from cjt_gym.gap.horizons.findings.answer import at_the_floor
from tests.gap.horizons.rotor import datasheet, record

FLOOR = 0.05


@pytest.fixture(scope="module")
def told() -> Diagnosis:
    return diagnose(record(seconds=6.0), datasheet(), "rigid")


def named(stage: str, status: str) -> NamedEffect:
    number = {"delay": Interval(4e-3, 3e-3, 5e-3, "s")}
    return NamedEffect("command_delay", stage, None, None, number, status, 0.5, 0.1, (), 1.0)


@pytest.mark.parametrize(
    ("error", "found", "status", "measured", "gap"),
    [
        (1.05, 1.05, "tentative", False, False),
        (1.05, 1.05, "confirmed", False, False),
        (1.05, 0.9, "confirmed", False, True),
        (1.05, 1.05, "tentative", True, True),
        (1.2, 1.0, "tentative", False, True),
    ],
)
def test_what_changes_nothingat_the_floor_is_no_gap(
    told: Diagnosis, error: float, found: float, status: str, measured: bool, gap: bool
) -> None:
    row = Horizon(0.5, "q_m", error * FLOOR, None, found * FLOOR, FLOOR)
    size = replace(told.gap, before=error * FLOOR, after=found * FLOOR, floor=FLOOR)
    effects = (named("drive", status),)
    given = replace(told, verdict="explained", effects=effects, gap=size, horizons=(row,))
    sheet = datasheet()
    judged = at_the_floor(given, sheet, measured=measured)
    assert (judged.verdict == "no_gap") != gap
    if not gap:
        assert not judged.effects
        assert judged.joint == replace(sheet, found=judged.joint.found)
        assert judged.joint.found
        assert judged.horizons[0].found == judged.horizons[0].datasheet
