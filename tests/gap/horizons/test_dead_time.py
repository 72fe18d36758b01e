"""How late a command acts, by the torque of a motion that a controller holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.torque.bristles import bent
from cjt_gym.gap.horizons.torque.dead_time import dead_time, in_time
from cjt_gym.gap.horizons.torque.inverse import inverse, seen_in_torque
from cjt_gym.joint import JointFile, Quantity, get_structure
from cjt_gym.records import Record
from tests.gap.horizons.arm import DT, INERTIA, held_record

RIGID = get_structure("rigid")
ROWS = 6


def commanded(record: Record, rows: int) -> Record:
    """Return a record of the command alone, each written so many rows before it acted."""
    columns = {name: record[name] for name in ("q_m", "i")}
    size = len(record) - rows
    kept = {"q_m": columns["q_m"][:size], "i_cmd": columns["i"][rows:]}
    units = {"t": "s", "q_m": "rad", "i_cmd": "A"}
    return Record({"t": DT * np.arange(size), **kept}, units, structure="rigid")


@pytest.mark.parametrize("seed", [0, 1])
def test_the_torque_tells_a_dead_time_that_motion_hardly_shows(arm: JointFile, seed: int) -> None:
    case = make_case([commanded(held_record(seed), ROWS)], [], arm, RIGID)
    late = dead_time(case.joint, case.logs)
    assert late is not None
    assert late.values[0] == pytest.approx(ROWS * DT, abs=0.5 * DT)
    seen = seen_in_torque(case.joint, case.logs)
    assert seen[late.name] == late
    assert late.name not in seen_in_torque(case.joint, case.logs, {late.name})
    straight = make_case([commanded(held_record(seed), 0)], [], arm, RIGID)
    assert dead_time(straight.joint, straight.logs) is None
    one, other = (inverse(x.joint, x.logs)[-1].inertia for x in (case, straight))
    assert one == pytest.approx(other, rel=0.1)
    assert other == pytest.approx(INERTIA, rel=0.2)


def test_a_measured_current_and_a_listed_delay_are_left_alone(arm: JointFile) -> None:
    case = make_case([held_record(0)], [], arm, RIGID)
    assert dead_time(case.joint, case.logs) is None
    assert in_time(case.logs, None) == list(case.logs)
    listed = {"command_delay": {"delay": Quantity(1e-3, "s", "test")}}
    known = replace(arm, effects={**arm.effects, **listed})
    case = make_case([commanded(held_record(0), ROWS)], [], known, RIGID)
    assert dead_time(case.joint, case.logs) is None


def test_friction_that_turns_round_slowly_is_no_delay(arm: JointFile) -> None:
    t = 2e-3 * np.arange(8000)
    q = 0.5 * np.sin(2.0 * np.pi * 0.4 * t)
    for path in (1e-3, 1e-2, 1e-1):
        noise = np.random.default_rng(1).normal(0.0, 0.02, len(t))
        torque = INERTIA * np.gradient(np.gradient(q, t), t) + 2.0 * bent(q, path) + noise
        columns = {"t": t, "q_m": q, "i_cmd": torque / 10.0}
        slow = Record(columns, {"t": "s", "q_m": "rad", "i_cmd": "A"}, structure="rigid")
        case = make_case([slow], [], arm, RIGID)
        assert dead_time(case.joint, case.logs) is None


def test_a_diagnosis_names_it_tentatively(arm: JointFile) -> None:
    found = diagnose(commanded(held_record(0), ROWS), arm, "rigid")
    (late,) = (e for e in found.effects if e.name == "command_delay")
    delay = late.parameters["delay"]
    assert late.status == "tentative"
    assert "current_lag" in late.confusable_with
    assert delay.low < ROWS * DT < delay.high
