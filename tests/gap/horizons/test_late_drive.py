"""A drive that is late by no whole number of rows, beside friction, by the command alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.findings.corrected_values import LATE
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record
from tests.gap.horizons.rotor import DAMPING, DRY, DT, datasheet, record


@pytest.mark.slow
def test_friction_and_a_late_drive_are_told() -> None:
    made = record(late=2.5 * DT)
    columns = {"t": made.t, "q_m": made["q_m"], "i_cmd": made["i"]}
    units = {"t": "s", "q_m": "rad", "i_cmd": "A"}
    found = diagnose(Record(columns, units), datasheet(1.0, 0.05), "rigid")
    named = {e.name: e for e in found.effects}
    assert named["coulomb"].parameters["d_cm"].value == pytest.approx(DRY, rel=0.05)
    (late,) = (e for e in found.effects if e.name in LATE)
    assert late.parameters["delay"].value == pytest.approx(2.5 * DT, abs=0.25 * DT)
    # a lag as late predicts clearly worse
    assert (late.name, late.status) == ("command_delay", "confirmed")


@pytest.mark.slow
def test_a_dead_time_is_that_beyond_a_log_s_own_row() -> None:
    """A row holds a command and the current measured before it acted, a row late without any."""
    made = record(late=4.0 * DT)
    i = np.concatenate([np.zeros(5), made["i"][:-5]])
    i += 0.005 * np.random.default_rng(0).standard_normal(len(i))
    columns = {"t": made.t, "q_m": made["q_m"], "i_cmd": made["i"], "i": i}
    units = {"t": "s", "q_m": "rad", "i_cmd": "A", "i": "A"}
    found = diagnose(Record(columns, units), datasheet(1.0, 0.05), "rigid")
    (late,) = (e for e in found.effects if e.name == "command_delay")
    delay = late.parameters["delay"]
    assert delay.low < 4.0 * DT < delay.high
    assert delay.value == pytest.approx(4.0 * DT, abs=0.25 * DT)


@pytest.mark.slow
def test_a_log_slower_than_the_drive_shows_a_dead_time_beyond_a_row() -> None:
    """Up to one row of it may be when the rows were written."""
    dead, every = 8, 5
    made = record(late=dead * 1e-3, dt=1e-3)
    i = np.concatenate([np.zeros(dead), made["i"][:-dead]])
    i += 0.005 * np.random.default_rng(0).standard_normal(len(i))
    columns = {"t": made.t, "q_m": made["q_m"], "i_cmd": made["i"], "i": i}
    units = {"t": "s", "q_m": "rad", "i_cmd": "A", "i": "A"}
    slow = Record({name: x[::every] for name, x in columns.items()}, units)
    found = diagnose(slow, datasheet(1.0, 0.05), "rigid")
    late = [e for e in found.effects if e.name in LATE]
    assert [(e.name, e.status) for e in late] == [("command_delay", "tentative")]
    delay = late[0].parameters["delay"]
    assert delay.low <= dead * 1e-3 <= delay.high < 0.012


@pytest.mark.slow
def test_a_current_that_follows_at_once_means_no_late_drive() -> None:
    """Its noise is not specified; current and angle of a row may be half a row apart."""
    made, clean = record(noise=6e-4, dt=1e-3), record(dt=1e-3)
    columns = {"t": made.t, "q_m": made["q_m"], "i_cmd": clean["i"], "i": made["i"]}
    units = {"t": "s", "q_m": "rad", "i_cmd": "A", "i": "A"}
    sheet = datasheet(1.0, 0.2)
    known = sheet.parameters.replace(
        d_m=Quantity(DAMPING, "N m s/rad", "test", 0.3), k_t=Quantity(1.0, "N m/A", "test", 0.02)
    )
    dry = {"body": "motor", "d_cm": Quantity(DRY, "N m", "test", 0.2)}
    sheet = replace(sheet, parameters=known, effects={"coulomb": dry})
    found = diagnose(Record(columns, units), sheet, "rigid")
    assert (found.verdict, found.effects) == ("no_gap", ())
