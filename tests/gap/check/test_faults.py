"""Which faults of a log `examine` finds, and that a sound log has none."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym import load_joint
from cjt_gym.errors import RecordError
from cjt_gym.gap.check import examine
from cjt_gym.gap.check.faults import REFLECTED
from cjt_gym.joint import get_structure
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record, read_record
from tests.gap.check.moved import INERTIA, K_T, QUICK, Floats, columns, joint, record

Table = dict[str, Floats]


def faults(table: Table) -> tuple[str, ...]:
    return examine(record(table), joint(), None).faults


def test_a_sound_log_has_none() -> None:
    assert faults(columns()) == ()


@pytest.mark.parametrize(("share", "said"), [(0.5, True), (1.0, False)])
def test_a_current_beyond_the_peak_of_the_joint_is_told(share: float, said: bool) -> None:
    table, file = columns(), joint()
    peak = Quantity(share * float(np.abs(table["i"]).max()), "A", "test")
    limited = replace(file, parameters=file.parameters.replace(i_p=peak))
    found = examine(record(table), limited, None).faults
    assert [text for text in found if "peak current i_p" in text] == list(found)
    assert bool(found) == said


@pytest.mark.parametrize(("share", "said"), [(0.1, True), (0.5, False)])
def test_a_command_far_beyond_the_peak_of_the_joint_is_told(share: float, said: bool) -> None:
    table, file = columns(), joint()
    del table["i"]
    peak = Quantity(share * float(np.abs(table["i_cmd"]).max()), "A", "test")
    limited = replace(file, parameters=file.parameters.replace(i_p=peak))
    found = examine(record(table), limited, None).faults
    assert any(text.startswith("i_cmd reaches") for text in found) == said


def test_records_of_different_lengths_are_judged_together() -> None:
    both = []
    for seconds in (4.0, 8.0):
        table = columns(QUICK, seconds)
        del table["i_cmd"]
        both.append(record(table))
    alone, together = (examine(some, joint(), None) for some in (both[1], both))
    assert together.faults == alone.faults
    assert set(together.can_tell) == set(alone.can_tell)


def test_steps_in_another_unit_are_no_quantization() -> None:
    found = examine(record(coarse_degrees(columns())), joint(), None)
    (row,) = (row for row in found.cannot_tell if row.name == "quantization")
    assert row.why.startswith("q_m has steps 57.3 times")


@pytest.mark.parametrize(("times", "said"), [(2, True), (3, False), (4, True)])
def test_steps_of_edges_that_were_not_counted_are_told(times: int, said: bool) -> None:
    table = columns()
    step = times * joint().sensors["q_m"]["resolution"].number
    found = examine(record(table | {"q_m": step * np.round(table["q_m"] / step)}), joint(), None)
    assert any("counts_per_rev" in note for note in found.notes) == said
    assert "quantization" in found.can_tell


def test_an_empty_current_is_one_fault_and_nothing_else_is_said_of_it() -> None:
    table = columns()
    found = examine(record(table | {"i": np.full(len(table["t"]), np.nan)}), joint(), None)
    assert [fault for fault in found.faults if fault.startswith("i:")] == [
        "i: 100 % of the samples are missing."
    ]


def test_a_turned_current_is_not_late() -> None:
    found = examine(record(against_its_command(columns())), joint(), None)
    assert not any("follows i_cmd by" in note for note in found.notes)


def test_motion_in_few_samples_is_not_said_to_be_none() -> None:
    steps = np.cumsum(np.clip(np.arange(180) - 90, 0, 30) % 30)
    rng = np.random.default_rng(0)
    table = {
        "t": 0.02 * np.arange(180),
        "i": np.gradient(np.gradient(0.01 * steps)) + rng.normal(0.0, 1e-3, 180),
        "q_m": 0.01 * steps + rng.normal(0.0, 1e-5, 180),
    }
    found = examine(record(table), joint(), None)
    reasons = {row.name: row.why for row in found.cannot_tell}
    assert reasons["inertia"] == "The motor moves in fewer than 50 samples."
    assert not found.at_rest


def test_a_noisy_velocity_is_none() -> None:
    assert not [text for text in faults(noisy_velocity(columns())) if "slope" in text]


def keep(table: Table, rows: Floats) -> Table:
    return {name: x[rows] for name, x in table.items()}


def slope(table: Table) -> Floats:
    return np.asarray(np.gradient(table["q_m"], 1e-3))


def half_velocity_beside_a_staggered_angle(table: Table) -> Table:
    """Return an angle whose rows are each read early or late, so that its slope is noise."""
    t = table["t"] + np.random.default_rng(0).uniform(-0.04, 0.04, len(table["t"]))
    return table | {"dq_m": 0.5 * slope(table), "q_m": np.interp(t, table["t"], table["q_m"])}


def coarse_degrees(table: Table) -> Table:
    return table | {"q_m": np.rad2deg(np.round(table["q_m"] / 1e-5) * 1e-5)}


def against_its_command(table: Table) -> Table:
    return table | {"i": -table["i"]}


def exchanged(table: Table) -> Table:
    """A torque of a few times the current, each in the column of the other."""
    torque = 4.0 * table["i"] + 3.0 * np.sin(table["t"])
    return table | {"i": torque, "tau": table["i"]}


def noisy_velocity(table: Table) -> Table:
    noise = np.random.default_rng(1).normal(0.0, 3.0, len(table["t"]))
    return table | {"dq_m": slope(table) + noise}


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


def early(table: Table) -> Table:
    return table | {"i": np.roll(table["i"], -3)}


def at_rest_at_last(table: Table) -> Table:
    last = int(0.78 * len(table["t"]))
    held = {name: np.where(np.arange(len(x)) < last, x, x[last]) for name, x in table.items()}
    noise = np.random.default_rng(2).normal(0.0, 1e-5, len(table["t"]))
    return held | {"t": table["t"], "q_m": held["q_m"] + noise}


def stale(table: Table) -> Table:
    q = table["q_m"].copy()
    q[1000:7000:50] = q[999:6999:50]
    return table | {"q_m": q}


def magnitude(table: Table) -> Table:
    speed = np.gradient(table["q_m"], 1e-3)
    smooth = np.convolve(speed, np.ones(25) / 25, "same")
    return {"t": table["t"], "i": np.abs(table["i"]), "dq_m": smooth}


def sign_in_a_bit(table: Table) -> Table:
    speed = np.gradient(np.convolve(table["q_m"], np.ones(25) / 25, "same"), 1e-3)
    return table | {"dq_m": np.where(speed < 0.0, 500.0 - speed, speed)}


SPOILT: Mapping[str, Callable[[Table], Table]] = {
    "half_velocity": lambda x: x | {"dq_m": 0.5 * slope(x)},
    "in_degrees": lambda x: x | {"q_m": np.rad2deg(x["q_m"])},
    "velocity_beside_degrees": lambda x: x | {"q_m": np.rad2deg(x["q_m"]), "dq_m": slope(x)},
    "double_current": lambda x: x | {"i": 2.0 * x["i"]},
    "weak_current": lambda x: x | {"i": 0.93 * x["i"]},
    "other_torque": lambda x: x | {"tau_cmd": 0.3 * x["i_cmd"]},
    "in_rpm": lambda x: x | {"dq_m": 30.0 / np.pi * slope(x)},
    "turned_velocity": lambda x: x | {"dq_m": -slope(x)},
    "angle_over_again": lambda x: x | {"dq_m": np.rad2deg(x["q_m"])},
    "other_velocity": lambda x: x | {"dq_m": np.random.default_rng(1).normal(size=len(x["t"]))},
    "in_counts": lambda x: x | {"q_m": np.round(x["q_m"] / 1e-3)},
    "few_counts": lambda x: x | {"q_m": np.round(x["q_m"] / 0.1) * 0.1},
    "against": lambda x: x | {"i": -x["i"], "i_cmd": -x["i_cmd"]},
    "clipped": lambda x: x | {"i": np.clip(x["i"], -2.5, 2.5)},
    "still_command": lambda x: x | {"i_cmd": np.ones_like(x["i_cmd"])},
    "noisy": lambda x: x | {"i": x["i"] + np.random.default_rng(1).normal(0.0, 0.2, len(x["i"]))},
    "magnitude": magnitude,
    "sign_in_a_bit": sign_in_a_bit,
    "half_velocity_beside_a_staggered_angle": half_velocity_beside_a_staggered_angle,
    "coarse_degrees": coarse_degrees,
    "against_its_command": against_its_command,
    "exchanged": exchanged,
    "mixed": mixed,
    "jittered": jittered,
    "with_gap": with_gap,
    "early": early,
    "at_rest_at_last": at_rest_at_last,
    "stale": stale,
}


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ("magnitude", "it looks like a magnitude"),
        ("sign_in_a_bit", "or how its sign is coded, is wrong"),
        ("half_velocity", "dq_m is 0.5 times the slope of q_m: its unit or scale is wrong, or"),
        ("half_velocity_beside_a_staggered_angle", "times the slope of q_m: its unit or scale"),
        ("in_degrees", "near 180/pi"),
        (
            "coarse_degrees",
            "q_m has steps 57.3 times the resolution that the joint file states, as",
        ),
        ("velocity_beside_degrees", "q_m: its slope is 57.3 times dq_m, as if in deg."),
        ("against_its_command", "i: sign turned (i follows i_cmd"),
        ("double_current", "i is 2 times i_cmd."),
        ("weak_current", "i is 0.93 times i_cmd."),
        ("exchanged", "tau follows i_cmd as a current does, and i does not"),
        ("other_torque", "tau_cmd is 3 times k_t n i_cmd."),
        ("angle_over_again", "dq_m: is q_m over again rather than its slope."),
        ("other_velocity", "dq_m: does not follow the slope of q_m."),
        ("in_counts", "q_m has only whole numbers"),
        ("few_counts", "steps of its resolution."),
        ("against", "sign turned"),
        ("mixed", "The sampling is mixed: 4 and 10 ms"),
        ("jittered", "The sampling jitters: intervals of 7 to 13 ms."),
        ("with_gap", "The log has 1 gap of up to 52 ms"),
        ("clipped", "it looks cut off there"),
        ("still_command", "i_cmd never changes: 1 throughout."),
        ("noisy", "times what the joint file states"),
        ("early", "i leads i_cmd by 3 samples"),
        ("at_rest_at_last", "The last fifth of the record, from 6.4 s on, is at rest"),
        ("stale", "repeated samples"),
    ],
)
def test_a_fault_is_found(spoil: str, said: str) -> None:
    found = faults(SPOILT[spoil](columns()))
    assert any(said in fault for fault in found), found


@pytest.mark.parametrize(
    ("samples", "said"),
    [(1, "as in a log that writes each command beside"), (3, "a dead time of the drive, or")],
)
def test_a_current_that_follows_its_command_is_no_fault(samples: int, said: str) -> None:
    table = columns()
    table["i_cmd"] = np.roll(table["i_cmd"], -samples)
    found = examine(record(table), joint(), None)
    assert found.faults == ()
    assert any(f"i follows i_cmd by {samples} sample" in n and said in n for n in found.notes)


def test_a_simulated_log_has_no_fault_in_its_instants() -> None:
    arm = load_joint("orange_80_6000", "rigid", effects={"coulomb": {}, "noise": {}})
    rng = np.random.default_rng(0)
    steps = np.repeat(rng.uniform(-20.0, 20.0, 80), 50)
    found = examine(arm.simulate(steps, dt_physics=1e-4), arm.file, None)
    assert not any("instants" in fault for fault in found.faults), found.faults
    assert any("i follows i_cmd by 1 sample (1 ms), as in a log" in note for note in found.notes)


def test_a_current_two_rows_late_is_found_by_an_uneven_clock() -> None:
    table = mixed(columns(QUICK, seconds=30.0))
    for rows, faulty in ((1, False), (2, True)):
        late = table | {"i_cmd": np.roll(table["i_cmd"], -rows)}
        found = [fault for fault in faults(late) if "instants" in fault]
        assert bool(found) == faulty, found
    assert "by 2 rows whatever their duration" in found[0]
    assert "Map i_cmd with samples_late = -1" in found[0]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (-4, "q_m leads the torque of i by 4.5 samples (4.5 ms): "),
        (4, "q_m follows the torque of i by 3.5 samples (3.5 ms), although both are measured"),
    ],
)
def test_a_motion_of_other_instants_than_its_current_is_found(rows: int, said: str) -> None:
    """Angles are sums of speeds: half a sample ahead from the start."""
    table = columns(kind=QUICK)
    del table["i_cmd"]
    assert not any("instants" in fault for fault in faults(table))
    ends = slice(4, -4), slice(4 - rows, len(table["t"]) - 4 - rows)
    found = faults({n: x[ends[n == "q_m"]] for n, x in table.items()})
    assert any(said in fault for fault in found), found


def test_a_single_sine_does_not_show_instants() -> None:
    """Inertia and damping make up for any lag of it; only friction's reversal would show one."""
    t = np.arange(9000) * 1e-3
    w = 2.0 * np.pi * 3.0
    q = 0.1 * np.sin(w * t) + 0.0015 * np.sin(3.0 * w * t)
    speed = np.gradient(q, t)
    friction = 0.5 * np.tanh(20.0 * np.cos(w * (t + 0.008)))
    torque = 0.02 * np.gradient(speed, t) + 0.1 * speed + friction
    found = faults({"t": t, "q_m": q, "i": torque / joint().parameters.k_t})
    assert not any("instants" in fault for fault in found), found


def test_the_mapping_that_a_fault_asks_for_mends_it(tmp_path: Path) -> None:
    table = early(columns())
    np.savez(tmp_path / "log.npz", **table)
    late = re.search(r"or i_cmd with samples_late = (\d+)", " ".join(faults(table)))
    assert late is not None
    mapping = {"columns": {"t": {}, "q_m": {}, "i": {}}}
    mapping["columns"]["i_cmd"] = {"samples_late": int(late[1])}
    again = read_record(tmp_path / "log.npz", mapping=mapping)
    found = examine(again, joint(), get_structure("rigid"))
    assert not any("i_cmd" in fault for fault in found.faults), found.faults


@pytest.mark.parametrize(
    ("spoil", "said"),
    [("in_rpm", "as if in rpm"), ("turned_velocity", "has the sign against the slope of q_m")],
)
def test_a_contradiction_is_told_once(spoil: str, said: str) -> None:
    found = [fault for fault in faults(SPOILT[spoil](columns())) if fault.startswith("dq_m")]
    assert len(found) == 1
    assert said in found[0]


@pytest.mark.parametrize(("dt", "told"), [(1e-3, True), (0.01, False)])
def test_what_a_current_does_between_slow_rows_is_no_noise(dt: float, told: bool) -> None:
    table = columns(dt=dt)
    table["i"] = table["i"] + np.random.default_rng(1).normal(0.0, 0.3, len(table["i"]))
    assert any("i has noise of" in fault for fault in faults(table)) == told


def test_rows_off_their_instants_are_no_noise() -> None:
    arm = load_joint("orange_80_6000", "rigid")
    file = replace(arm.file, sensors={"q_m": {"noise": Quantity(1e-6, "rad", "datasheet")}})
    clock = np.random.default_rng(1).normal(0.0, 3e-5, 6000)
    t = 1e-3 * np.arange(6000)
    q = np.interp(t + clock, t, np.sin(4.0 * t))
    scatter = np.random.default_rng(2).normal(0.0, 2e-5, 6000)
    units = {"t": "s", "i": "A", "q_m": "rad"}
    for angle, told in ((q, False), (np.sin(4.0 * t) + scatter, True)):
        columns = {"t": t, "i": np.cos(4.0 * t), "q_m": angle}
        found = examine(
            Record(columns, units, structure="rigid"), file, get_structure("rigid")
        ).faults
        assert any("q_m has noise of" in fault for fault in found) == told


def test_a_slow_log_has_no_late_current() -> None:
    table = columns(QUICK, dt=0.05)
    table["i_cmd"] = np.roll(table["i_cmd"], -1)
    assert not any("instants" in fault for fault in faults(table))


@pytest.mark.parametrize(("times", "told"), [(1.0, False), (1.0 / 2500.0, True), (0.1, False)])
def test_an_inertia_of_the_rotor_without_the_square_of_the_ratio_is_told(
    times: float, told: bool
) -> None:
    geared = joint(n=50.0, k_t=K_T / 50.0, I_m=times * INERTIA)
    exam = examine(record(columns(QUICK)), geared, None)
    assert any("lacked the factor n^2 = 2500" in fault for fault in exam.faults) == told
    assert (REFLECTED in exam.advice) == told


def test_a_gap_asks_for_a_log_without_gaps_alone() -> None:
    advice = examine(record(with_gap(columns())), joint(), None).advice
    assert [said for said in advice if said.startswith("Log ")] == ["Log without gaps."]


def test_only_the_angle_is_said_to_be_turned_where_its_velocity_is_right() -> None:
    table = columns()
    speed = np.gradient(np.convolve(table["q_m"], np.ones(25) / 25, "same"), 1e-3)
    found = faults(table | {"q_ref": table["q_m"], "q_m": -table["q_m"], "dq_m": speed})
    assert [text for text in found if "sign" in text] == [
        text for text in found if text.startswith("q_m: sign turned")
    ]


def test_a_joint_that_slides_is_not_judged_in_radians() -> None:
    slides = load_joint("emps", "rigid").file
    with pytest.raises(RecordError, match="must be in m and N, as emps is prismatic, got i_cmd in"):
        examine(record(columns()), slides, None)
