"""Which faults of a log `examine` finds, and that a sound log has none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cjt_gym.gap.check import examine
from cjt_gym.joint import get_structure
from tests.gap.check.moved import Floats, columns, joint, record
from tests.gap.simulator import nominal, simulate

Table = dict[str, Floats]


def faults(table: Table) -> tuple[str, ...]:
    return examine(record(table), joint(), None).faults


def test_a_sound_log_has_none() -> None:
    assert faults(columns()) == ()


def keep(table: Table, rows: Floats) -> Table:
    return {name: x[rows] for name, x in table.items()}


def half_velocity(table: Table) -> Table:
    return table | {"dq_m": 0.5 * np.gradient(table["q_m"], 1e-3)}


def in_degrees(table: Table) -> Table:
    return table | {"q_m": np.rad2deg(table["q_m"])}


def in_counts(table: Table) -> Table:
    return table | {"q_m": np.round(table["q_m"] / 1e-3)}


def few_counts(table: Table) -> Table:
    return table | {"q_m": np.round(table["q_m"] / 0.1) * 0.1}


def against(table: Table) -> Table:
    return table | {"i": -table["i"], "i_cmd": -table["i_cmd"]}


def mixed(table: Table) -> Table:
    steps = np.random.default_rng(0).choice([4, 10], len(table["t"]))
    rows = np.cumsum(steps)
    return keep(table, rows[rows < len(table["t"])])


def jittered(table: Table) -> Table:
    steps = np.random.default_rng(0).choice([7, 8, 9, 10, 11, 12, 13], len(table["t"]))
    rows = np.cumsum(steps)
    return keep(table, rows[rows < len(table["t"])])


def with_gap(table: Table) -> Table:
    rows = np.arange(len(table["t"]))
    return keep(table, rows[(rows < 3000) | (rows > 3050)])


def clipped(table: Table) -> Table:
    return table | {"i": np.clip(table["i"], -2.5, 2.5)}


def still_command(table: Table) -> Table:
    return table | {"i_cmd": np.ones_like(table["i_cmd"])}


def noisy(table: Table) -> Table:
    return table | {"i": table["i"] + np.random.default_rng(1).normal(0.0, 0.2, len(table["i"]))}


def early(table: Table) -> Table:
    return table | {"i": np.roll(table["i"], -3)}


def late(table: Table) -> Table:
    return table | {"i": np.roll(table["i"], 3)}


def at_rest_at_last(table: Table) -> Table:
    last = int(0.78 * len(table["t"]))
    held = {name: np.where(np.arange(len(x)) < last, x, x[last]) for name, x in table.items()}
    noise = np.random.default_rng(2).normal(0.0, 1e-5, len(table["t"]))
    return held | {"t": table["t"], "q_m": held["q_m"] + noise}


def stale(table: Table) -> Table:
    q = table["q_m"].copy()
    q[1000:7000:50] = q[999:6999:50]
    return table | {"q_m": q}


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (half_velocity, "dq_m is 0.5 times the slope of q_m."),
        (in_degrees, "near 180/pi"),
        (in_counts, "q_m has whole numbers only"),
        (few_counts, "steps of its resolution only"),
        (against, "sign turned"),
        (mixed, "The sampling is mixed: 4 and 10 ms"),
        (jittered, "The sampling jitters: intervals of 7 to 13 ms."),
        (with_gap, "The log has 1 gap of up to 52 ms"),
        (clipped, "it looks cut off there"),
        (still_command, "i_cmd never changes: 1 throughout."),
        (noisy, "times what the joint file specifies"),
        (early, "i goes 3 samples ahead of i_cmd"),
        (late, "i follows i_cmd by 3 samples (3 ms)"),
        (at_rest_at_last, "The last fifth of the record, from 6.4 s on, is at rest"),
        (stale, "repeated samples"),
    ],
    ids=lambda x: getattr(x, "__name__", ""),
)
def test_a_fault_is_found(spoil: Callable[[Table], Table], said: str) -> None:
    found = faults(spoil(columns()))
    assert any(said in fault for fault in found), found


def test_angles_that_differ_by_the_gear_are_found() -> None:
    table = columns()
    table["q_l"] = 50.0 * table["q_m"]
    geared = joint(n=50.0, k_b=1e5, k_t=0.002, I_l=0.001)
    found = examine(record(table), geared, get_structure("rigid")).faults
    assert any("q_l is 50 times q_m, the ratio n of the gear" in fault for fault in found)


def test_a_torque_against_its_spring_is_found() -> None:
    held = get_structure("output_fixed_rigid_gearbox")
    sound, odd = nominal(), nominal(k_b=0.3)
    said = "times the nominal stiffness times the deflection"
    rec = simulate(friction=(1.5, 1.5))
    assert not any(said in fault for fault in examine(rec, sound, held).faults)
    assert any("tau is 3.33 " + said in fault for fault in examine(rec, odd, held).faults)
