"""Stretches of a record that a second machine drives, simulated here in plain NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.errors import RecordError
from cjt_gym.gap import diagnose
from cjt_gym.gap.check.examine import ALONE, examine
from cjt_gym.gap.recorded.driven import driven_only, is_left
from cjt_gym.joint import get_structure
from cjt_gym.records import Record
from tests.gap.horizons.rotor import datasheet

DT, INERTIA, DAMPING, DRY = 1e-3, 0.02, 0.01, 0.1
RIGID = get_structure("rigid")


def bench_record(weight: float = 0.0, *, driven: bool = True) -> Record:
    """Return 10 s that the motor drives forward and, with its current off, 6 s driven backward.

    Args:
        weight: Largest torque of a weight [N m].
        driven: Whether the second machine drives; otherwise the joint coasts, or falls.
    """
    rng = np.random.default_rng(3)
    t = np.arange(16_000) * DT
    current = 0.35 + 0.2 * rng.uniform(-1.0, 1.0, 100)[(t / 0.2).astype(int)]
    current[t > 10.0] = 0.0
    q, v, angle = 0.5, 0.0, []
    for k, i in enumerate(current):
        other = -DRY - 0.03 * (t[k] - 10.0) if driven and t[k] > 10.5 else 0.0
        free = v + DT / INERTIA * (i + other - DAMPING * v - weight * np.sin(q))
        v = np.sign(free) * max(abs(free) - DT / INERTIA * DRY, 0.0)
        q += DT * v
        angle.append(q)
    columns = {"t": t, "i": current, "q_m": np.round(np.array(angle) / 1e-4) * 1e-4}
    return Record(columns, {"t": "s", "i": "A", "q_m": "rad"}, structure="rigid")


def test_what_a_second_machine_drives_is_left_out() -> None:
    record = bench_record()
    (kept,), (said,) = driven_only([record], RIGID)
    lost = kept.t[np.isnan(kept["q_m"])]
    assert lost[0] == pytest.approx(10.0, abs=0.01)
    assert lost[-1] == record.t[-1]
    np.testing.assert_array_equal(kept["q_m"][kept.t < 10.0], record["q_m"][record.t < 10.0])
    assert "speeds up although its motor is off" in said
    exam = examine(record, datasheet(1.0), RIGID)
    assert said in exam.faults
    assert ALONE in exam.advice
    assert "torque_offset" not in exam.can_tell, "what is left moves in one direction"


@pytest.mark.parametrize("weight", [0.0, 0.4])
def test_coasting_and_falling_are_the_joint_s_own(weight: float) -> None:
    record = bench_record(weight, driven=False)
    assert driven_only([record], RIGID) == ((record,), ())


def test_a_measured_torque_may_move_the_joint() -> None:
    record = bench_record()
    known = {**record.columns, "tau_l": np.zeros(len(record))}
    given = replace(record, columns=known, units={**record.units, "tau_l": "N m"})
    assert driven_only([given], RIGID) == ((given,), ())


@pytest.mark.slow
def test_friction_is_that_of_the_motor_s_own_motion() -> None:
    found = diagnose(bench_record(), datasheet(1.0), "rigid")
    assert "something else drives it" in found.unexplained.text
    assert "torque_offset" not in {e.name for e in found.effects}
    (level,) = (e.parameters["d_cm"] for e in found.effects if "d_cm" in e.parameters)
    assert level.value == pytest.approx(DRY, rel=0.1)
    at_last = found.horizons[-1]
    assert at_last.found < at_last.least_squares < 0.1 < at_last.datasheet


def test_a_piece_without_any_current_is_judged_by_its_log() -> None:
    record = bench_record()
    pieces = [record.slice(0, 10_000), record.slice(10_000)]
    (first, second), _ = driven_only(pieces, RIGID)
    assert first is pieces[0]
    assert not is_left(second)
    with pytest.raises(RecordError, match="something other than the motor drives the joint"):
        diagnose(record.slice(9_960), datasheet(1.0), "rigid")


def test_a_measured_current_may_be_noisy_while_its_command_is_off() -> None:
    record = bench_record()
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(record))
    columns = {**record.columns, "i_cmd": record["i"], "i": record["i"] + noise}
    noisy = replace(record, columns=columns, units={**record.units, "i_cmd": "A"})
    (kept,), (said,) = driven_only([noisy], RIGID)
    assert np.isnan(kept["q_m"][kept.t > 10.1]).all()
    assert "Between 10 and 16 s" in said
    flowing = {**columns, "i": columns["i"] + 0.1}
    assert driven_only([replace(noisy, columns=flowing)], RIGID)[1] == ()
