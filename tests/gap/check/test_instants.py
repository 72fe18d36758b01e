"""Logs that hold each command beside what was measured after it acted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.check import examine
from cjt_gym.gap.check.instants import answers_in_its_row, in_step, misplaced
from cjt_gym.joint import Joint, JointFile, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import Record
from tests.gap.check.moved import record as log
from tests.gap.simulator import nominal, simulate

HELD = get_structure("output_fixed_rigid_gearbox")


def replies(seen: Record) -> Record:
    """Return a log whose rows are a command and the drive's reply to it."""
    later = {name: np.append(seen[name][1:], 0.0) for name in ("i", "q_m", "q_l", "tau")}
    return seen.with_columns(later).slice(0, len(seen) - 1)


def current_alone(seen: Record) -> Record:
    """Return a log that reads the angles, sends the command and reads the current."""
    later = seen.with_columns({"i": np.append(seen["i"][1:], 0.0)})
    return later.slice(0, len(seen) - 1)


@pytest.mark.parametrize("bandwidth", [None, 100.0])
def test_a_reply_is_told_from_a_measurement_before_the_command(bandwidth: float | None) -> None:
    def slow(wanted: np.ndarray) -> np.ndarray:
        share, current = 1.0 - np.exp(-2.0 * np.pi * (bandwidth or 0.0) * 1e-3), [0.0]
        for value in wanted:
            current.append(current[-1] + share * (value - current[-1]))
        return np.array(current[1:])

    before = simulate(drive=slow if bandwidth else None)
    after = replies(before)
    assert not answers_in_its_row(before)
    assert answers_in_its_row(after)
    (same,), _ = in_step([before], [], nominal(), HELD)
    assert same is before
    rows = np.arange(1, len(before) - 1)
    for (moved,) in in_step([after], [after], nominal(), HELD):
        for name in ("i_cmd", "i", "q_m"):
            assert np.array_equal(moved[name], before[name][rows])
    (mended,), _ = in_step([current_alone(before)], [], nominal(), HELD)
    for name in ("i_cmd", "i", "q_m"):
        assert np.array_equal(mended[name][: len(rows)], before[name][rows])


@pytest.mark.parametrize(
    ("written", "said"),
    [(replies, "samples_late = 1 for i_cmd"), (current_alone, "samples_late = -1 for i.")],
)
def test_it_is_told_as_a_remark_not_as_a_fault(
    written: Callable[[Record], Record], said: str
) -> None:
    found = examine(written(simulate()), nominal(), HELD)
    assert any(said in note for note in found.notes)
    assert not any("instants" in fault for fault in found.faults)


def test_a_command_that_answers_the_current_is_no_reply() -> None:
    """A loop's command depends on the current measured in its row, with the opposite sign."""
    rng = np.random.default_rng(0)
    i, command = np.zeros(4000), np.zeros(4000)
    for k in range(3, 4000):
        i[k] = 0.6 * i[k - 1] + 0.4 * command[k - 3] + 0.1 * rng.standard_normal()
        command[k] = 1.5 * np.sin(0.01 * k) - i[k]
    columns = {"t": 1e-3 * np.arange(4000), "i_cmd": command, "i": i}
    assert not answers_in_its_row(log(columns))


@pytest.mark.slow
@pytest.mark.parametrize("written", [replies, current_alone])
def test_such_a_log_is_diagnosed_like_any_other(written: Callable[[Record], Record]) -> None:
    found = diagnose(written(simulate(seconds=6.0, friction=(5.0, 5.0))), nominal(), HELD.name)
    assert found.verdict == "explained"
    assert [(e.name, e.status) for e in found.effects] == [("coulomb", "confirmed")]
    assert found.stages["drive"].after < 1.3


@pytest.mark.parametrize("every", [2, 10])
def test_rows_of_one_instant_of_a_loop_faster_than_its_log_stay_where_they_are(every: int) -> None:
    fine = simulate(8.0, friction=(3.0, 3.0))
    columns = {"t": fine.t, **fine.columns}
    slow = log({name: x[::every] for name, x in columns.items()}, HELD.name)
    assert answers_in_its_row(slow)
    assert misplaced(slow) is None
    (same,), _ = in_step([slow], [], nominal(), HELD)
    assert same is slow


def test_a_load_that_leads_on_its_spring_is_no_fault_of_the_rows() -> None:
    """Below its resonance with a free load, the motor may lead what one body would do."""
    values = {"I_m": 0.5, "I_g": 0.4, "I_l": 0.4, "k_g": 12e3, "k_b": 12e3, "k_t": 0.01, "n": 100.0}
    values |= {"d_m": 0.03, "d_g": 15.0, "d_l": 0.4, "d_mg": 80.0, "d_gl": 1.5}
    file = JointFile(JointParameters.from_values("two springs", values))
    shape = get_structure("full_dynamics")
    rng = np.random.default_rng(1)
    torque = np.repeat(rng.uniform(-20.0, 20.0, 400), 20)
    moved = Joint(file, shape.name, "current", {}).simulate(torque, dt=1e-3)["true_q_m"]
    angle = moved + 1e-5 * rng.standard_normal(len(moved))
    seen = Record({"i_cmd": torque, "q_m": angle}, {"i_cmd": "A", "q_m": "rad"}, dt=1e-3)
    assert examine([seen], file, shape).faults == ()


@pytest.mark.parametrize("late", [0, 1])
def test_a_smooth_command_shows_its_row_by_the_instants(late: int) -> None:
    """What a multisine does next follows from its past: only its timing tells."""
    rng = np.random.default_rng(0)
    t, f = 1e-3 * np.arange(6000), np.arange(0.25, 30.0, 0.25)
    phase = rng.uniform(0.0, 2.0 * np.pi, len(f))
    command = (np.sin(2.0 * np.pi * f * t[:, None] + phase) / np.hypot(1.0, f / 3.0)).sum(axis=1)
    i = np.roll(command, late) + 8e-3 * rng.standard_normal(len(t))
    speed = 0.02 * np.cumsum(np.roll(command, 1))
    angle = 1e-3 * np.cumsum(np.roll(speed, 1)) + 1e-5 * rng.standard_normal(len(t))
    seen = log({"t": t, "i_cmd": command, "i": i, "q_m": angle})
    assert answers_in_its_row(seen) == (late == 0)
    assert misplaced(seen) == (("i", -1) if late == 0 else None)


@pytest.mark.parametrize("seed", range(4))
def test_lost_rows_do_not_make_a_current_know_its_own_command(seed: int) -> None:
    rng, t = np.random.default_rng(seed), 1e-3 * np.arange(8000)
    command = 2.0 * np.sin(2.0 * np.pi * (0.3 * t + 1.5 * t**2))
    command += 0.3 * np.convolve(rng.standard_normal(t.size), np.full(4, 0.25), "same")
    i = np.append(0.0, command[:-1]) + 0.02 * rng.standard_normal(t.size)
    angle = np.cumsum(np.cumsum(i)) * 5e-5
    kept = np.sort(rng.choice(t.size, t.size // 2, replace=False))
    columns = {"t": t[kept], "i_cmd": command[kept], "i": i[kept], "q_m": angle[kept]}
    assert misplaced(log(columns)) is None
