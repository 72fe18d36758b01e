"""Which tuned gains ship with the package."""

from __future__ import annotations

from typing import Any

import pytest

from cjt_gym.baselines import CONTROLLERS
from tools.tuned_gains import JOINTS, STRUCTURES, searches, ships

GOOD: dict[str, Any] = {
    "feasible": True,
    "designed_feasible": True,
    "held_out": {"tuned": 0.6, "designed": 0.7, "low": 0.8, "high": 0.9},
}


@pytest.mark.parametrize(
    ("facts", "held_out", "out"),
    [
        ({}, {}, True),
        ({}, {"low": 0.9, "high": 1.1}, True),  # as good as the designed ones
        ({}, {"low": 1.1, "high": 1.2}, False),  # the designed ones are better
        ({"designed_feasible": False}, {"low": 1.1, "high": 1.2}, True),  # by breaking a limit
        ({"designed_feasible": False}, {"tuned": 1.0, "low": 1.1}, False),
        ({}, {"tuned": 1.02}, False),  # no better than the open loop
        ({"feasible": False}, {}, False),
    ],
)
def test_gains_ship_where_they_are_better(
    facts: dict[str, Any], held_out: dict[str, float], out: bool
) -> None:
    assert ships({**GOOD, **facts, "held_out": {**GOOD["held_out"], **held_out}}) == out


def test_every_law_with_gains_is_searched_where_it_holds() -> None:
    wanted = set(searches(JOINTS, STRUCTURES))
    assert ("open_loop", JOINTS[0], STRUCTURES[0]) not in wanted
    assert ("impedance", JOINTS[0], STRUCTURES[0]) not in wanted  # its gains are those of another
    for name, _, structure in wanted:
        assert structure in CONTROLLERS[name].structures
    here = (JOINTS[0], "output_fixed_rigid_gearbox")
    assert len([name for name, *where in wanted if tuple(where) == here]) == len(CONTROLLERS) - 2
