"""What `examine` says that a record can and cannot tell, on motion whose physics is known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.errors import RecordError
from cjt_gym.gap.check import Examination, examine
from cjt_gym.gap.check.channels import Channel
from cjt_gym.gap.check.drive import MEASURE
from cjt_gym.gap.check.examine import _once
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.joint import JointFile, get_structure, load_joint_file
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.joint import Joint
from cjt_gym.records import Record, read_record
from tests.gap.check.moved import BOTH, CONSTANT, CREEP, FRICTION, ONE, columns, joint, record
from tests.gap.simulator import nominal, simulate

HELD = "output_fixed_rigid_gearbox"
FRICTION_ROWS = ("inertia", "damping", "coulomb", "coulomb_asym", "viscous_asym", "stribeck")


def reasons(found: Examination) -> dict[str, str]:
    return {row.name: row.why for row in found.cannot_tell}


def test_every_effect_of_the_contract_is_either_told_or_not() -> None:
    found = examine(record(columns()), joint(), None)
    assert len(found.can_tell) + len(found.cannot_tell) == 30
    assert not set(found.can_tell) & set(reasons(found))
    assert set(found.smallest) == set(found.can_tell)
    assert all(np.isfinite(size) and size > 0.0 for size, _ in found.smallest.values())


def test_motion_both_ways_at_many_speeds_shows_inertia_and_all_friction() -> None:
    found = examine(record(columns(BOTH)), joint(), None)
    assert set(FRICTION_ROWS) | {"torque_offset", "command_delay"} <= set(found.can_tell)
    size, unit = found.smallest["coulomb"]
    assert unit == "N m"
    assert size < 0.2 * FRICTION


@pytest.mark.parametrize("kind", [ONE, CREEP])
def test_motion_one_way_shows_no_asymmetry_and_no_offset(kind: str) -> None:
    found = examine(record(columns(kind)), joint(), None)
    assert {"coulomb_asym", "viscous_asym", "torque_offset"} <= set(reasons(found))
    assert "100 % of the motion is in the positive direction" in reasons(found)["coulomb_asym"]
    assert {"inertia", "damping"} <= set(found.can_tell)
    assert any("one direction only" in fault for fault in found.faults)


def test_records_in_opposite_directions_tell_together_what_neither_tells_alone() -> None:
    there, back = columns(ONE), columns(ONE, seed=1)
    back |= {name: -back[name] for name in ("i", "i_cmd", "q_m")}
    found = examine([record(there), record(back)], joint(), None)
    assert {"coulomb_asym", "torque_offset"} <= set(found.can_tell)


@pytest.mark.parametrize("with_reversals", [True, False])
def test_one_speed_does_not_tell_damping_from_coulomb_friction(with_reversals: bool) -> None:
    table = columns(CONSTANT)
    steady = np.abs(np.abs(np.gradient(table["q_m"], 1e-3)) - 2.0) < 0.2
    assert 0.9 < np.mean(steady) < 1.0
    if not with_reversals:
        table["q_m"][~steady] = np.nan
    why = reasons(examine(record(table), joint(), None))
    assert "The speeds lie between 2 and 2 rad/s" in why["damping"]
    assert "dry and viscous friction look alike" in why["coulomb"]


def test_fast_motion_alone_shows_neither_breakaway_nor_presliding() -> None:
    why = reasons(examine(record(columns(ONE)), joint(), None))
    assert "0.0 % of the motion above the noise is slower than a tenth" in why["stribeck"]
    assert "The motion never reverses or starts from rest." in why["presliding"]


def test_without_a_command_the_drive_is_not_seen() -> None:
    table = columns()
    del table["i_cmd"]
    drive = {"command_delay", "current_lag", "current_saturation", "command_quantization"}
    assert drive <= set(reasons(examine(record(table), joint(), None)))


def test_a_command_alone_shows_a_delay_by_the_motion() -> None:
    table = columns()
    del table["i"]
    found = examine(record(table), joint(), None)
    size, unit = found.smallest["command_delay"]
    assert unit == "s"
    assert 0.25e-3 <= size < 0.01
    assert reasons(found)["command_quantization"].startswith("The current is not measured")


def test_a_torque_that_the_structure_does_not_use_does_not_show_the_torque_constant() -> None:
    beside = examine(record(columns() | {"tau": 0.1 * columns()["i"]}), joint(), None)
    assert reasons(beside)["torque_constant"].startswith("No torque is used")


def test_a_measured_current_shows_every_limit_that_the_command_exceeds() -> None:
    table = columns()
    peak = float(np.abs(table["i_cmd"]).max())
    most = joint(i_p=100.0 * peak)
    found = examine(record(table), most, None)
    assert found.smallest["current_saturation"] == (pytest.approx(peak), "A")
    del table["i"]
    assert "of the" in reasons(examine(record(table), most, None))["current_saturation"]


def test_a_delay_below_a_quarter_of_a_sample_is_not_promised() -> None:
    found = examine(record(columns(dt=0.01)), joint(), None)
    assert found.smallest["command_delay"][0] > 2.4e-3


def test_a_rigid_joint_shows_no_spring_no_load_and_no_torque_constant() -> None:
    why = reasons(examine(record(columns()), joint(), None))
    rows = {"stiffness", "backlash", "hardening", "spring_hysteresis", "torque_gain"}
    assert rows | {"torque_constant", "load_inertia", "torque_delay", "gear_ripple"} <= set(why)


def test_rest_tells_nothing_of_motion() -> None:
    table = columns()
    table["q_m"] = np.zeros_like(table["q_m"])
    found = examine(record(table), joint(), None)
    assert not set(FRICTION_ROWS) & set(found.can_tell)
    assert "q_m never changes: 0 throughout." in found.faults


def test_a_joint_that_coasts_shows_its_friction_beside_its_inertia() -> None:
    """It is let go ten times, at either speed, and stops by dry and viscous friction."""
    fall, t = FRICTION / joint().parameters.I_m, 1e-3 * np.arange(1000)
    swings = []
    for start in np.array([4.0, -2.0, 6.0, -5.0, 3.0, -6.0, 2.5, -4.0, 5.0, -3.0]):
        speed = np.maximum((abs(start) + fall) * np.exp(-t) - fall, 0.0) * np.sign(start)
        swings.append(1e-3 * np.cumsum(speed))
    ends = np.cumsum([0.0, *(s[-1] for s in swings[:-1])])
    q = np.concatenate([s + end for s, end in zip(swings, ends, strict=True)])
    q = q + np.random.default_rng(0).normal(0.0, 1e-6, len(q))
    table = {"t": 1e-3 * np.arange(len(q)), "i": np.zeros(len(q)), "i_cmd": np.zeros(len(q))}
    found = examine(record(table | {"q_m": q}), joint(), None)
    assert {"damping", "coulomb"} <= set(found.can_tell)
    assert 1e-9 < found.smallest["coulomb"][0] < FRICTION
    assert reasons(found)["inertia"].startswith("Nothing drives the joint")
    assert not [fault for fault in found.faults if "never changes" in fault]


def test_noise_of_the_current_hides_small_friction() -> None:
    loud, quiet = columns(), columns()
    loud["i"] = loud["i"] + np.random.default_rng(1).normal(0.0, 1.0, len(loud["i"]))
    sizes = [
        examine(record(table), joint(), None).smallest["coulomb"][0] for table in (loud, quiet)
    ]
    assert sizes[0] > 2.0 * sizes[1]


def test_a_held_joint_with_a_spring_shows_spring_sensor_and_motor() -> None:
    found = examine(simulate(friction=(1.5, 1.5)), nominal(), get_structure(HELD))
    rows = {"stiffness", "torque_gain", "torque_bias", "torque_delay", "torque_constant"}
    rows |= {"coulomb", "coulomb_asym", "inertia", "backlash", "hardening", "spring_hysteresis"}
    assert rows | {"noise", "quantization"} <= set(found.can_tell)
    assert {"gravity", "load_inertia", "load_coulomb"} <= set(reasons(found))


def test_a_held_joint_shows_its_spring_by_the_motor_where_no_torque_is_measured() -> None:
    whole = simulate(friction=(1.5, 1.5))
    table = {"t": whole.t} | {name: whole[name] for name in ("i_cmd", "i", "q_m")}
    found = examine(record(table, HELD), nominal(), None)
    assert {"stiffness", "hardening"} <= set(found.can_tell)
    assert {"backlash", "spring_hysteresis", "torque_gain"} <= set(reasons(found))


def test_play_shows_between_two_angles_where_no_torque_is_measured() -> None:
    load = {"I_g": Quantity(0.0, "kg m^2"), "I_l": Quantity(0.5, "kg m^2")}
    sheet = replace(nominal(), parameters=nominal().parameters.replace(**load))
    loose = quiet(
        Joint(sheet, "rigid_gearbox", "current", {"backlash": {"gap": 0.01, "offset": 0.0}})
    )
    t, rng = 1e-3 * np.arange(6000), np.random.default_rng(0)
    i = 2.0 * np.sin(2.0 * np.pi * 1.3 * t) + 1.5 * np.sin(2.0 * np.pi * 9.0 * t)
    made = loose.simulate(i * sheet.parameters.k_t * sheet.parameters.n, dt=1e-3)
    table = {"t": t, "i_cmd": i}
    table |= {n: made[f"true_{n}"] + rng.normal(0.0, 1e-6, len(t)) for n in ("q_m", "q_l")}
    found = examine(record(table, "rigid_gearbox"), sheet, None)
    assert 0.0 < found.smallest["backlash"][0] < 0.01
    assert "spring_hysteresis" in found.can_tell


def test_a_gearbox_is_told_from_spring_and_load_by_the_torque_between_them() -> None:
    whole, sheet = simulate(friction=(1.5, 1.5)), load_joint_file("orange_80_6000")
    table = {"t": whole.t} | {name: whole[name] for name in ("i_cmd", "i", "q_m", "tau")}

    def why(structure: str) -> str:
        return reasons(examine(record(table, structure), sheet, None)).get("gear_stiffness", "")

    assert not why("output_fixed")
    assert "angle q_l" in why("full_dynamics")
    del table["tau"]
    assert "in series" in why("output_fixed")


def test_without_the_angle_the_spring_is_not_seen() -> None:
    whole = simulate(friction=(1.5, 1.5))
    table = {"t": whole.t} | {name: whole[name] for name in ("i_cmd", "i", "tau")}
    found = examine(record(table, HELD), nominal(), None)
    rows = ("stiffness", "torque_gain", "backlash", "hardening", "spring_hysteresis")
    assert set(rows) <= set(reasons(found))
    assert {"coulomb", "torque_constant", "command_delay"} <= set(found.can_tell)


def test_a_resonance_above_nyquist_hides_inertia() -> None:
    whole = simulate(friction=(1.5, 1.5))
    table = {"t": whole.t} | {name: whole[name] for name in ("i_cmd", "i", "tau")}
    slow = {name: x[::20] for name, x in table.items()}
    found = examine(record(slow, HELD), nominal(), None)
    assert "inertia" in found.can_tell  # 22.5 Hz, below the 25 Hz of this log
    slower = {name: x[::25] for name, x in table.items()}
    found = examine(record(slower, HELD), nominal(), None)
    assert "22.5 Hz, above the log's Nyquist frequency of 20 Hz" in reasons(found)["inertia"]
    assert any("above the log's Nyquist frequency of 20 Hz" in fault for fault in found.faults)


def test_emps_shows_friction_and_no_spring() -> None:
    found = examine(read_record("emps"), load_joint_file("emps"), None)
    assert set(FRICTION_ROWS) | {"torque_offset"} <= set(found.can_tell)
    assert found.faults == ()
    assert {"stiffness", "gravity", "torque_constant"} <= set(reasons(found))


@pytest.mark.parametrize("name", ["odrive_cogging", "odrive_anticogging"])
def test_odrive_shows_cogging_and_coulomb_friction(name: str) -> None:
    rec = read_record(name)
    found = examine(rec, load_joint_file(rec.joint_file), None)  # type: ignore[arg-type]
    assert {"cogging", "coulomb", "inertia"} <= set(found.can_tell)
    assert found.smallest["cogging"][0] < 0.01


def test_without_a_joint_sizes_are_in_the_unit_of_the_current() -> None:
    found = examine(record(columns()), None, None)
    assert found.smallest["coulomb"][1] == "A"
    assert {"noise", "quantization"} <= set(reasons(found))


def test_its_dictionary_is_what_the_contract_says() -> None:
    found = examine(record(columns()), joint(), None).to_dict()
    assert set(found) == {"can_tell", "cannot_tell", "faults", "notes"}
    assert all(set(row) == {"name", "why"} for row in found["cannot_tell"])  # type: ignore[attr-defined]
    assert json.loads(json.dumps(found)) == found


def test_a_record_that_is_too_short_is_refused() -> None:
    with pytest.raises(RecordError, match="at least 50 samples"):
        examine(record(columns(seconds=0.03)), joint(), None)
    with pytest.raises(RecordError, match="needs a record"):
        examine([], joint(), None)


def test_no_advice_is_included_in_another() -> None:
    steps = "Record steps of different sizes in the command, and the measured current."
    assert _once(["", MEASURE, steps, MEASURE]) == (steps,)
    assert _once([MEASURE, "Log without gaps.", ""]) == (MEASURE, "Log without gaps.")


def test_rounding_is_no_noise_and_zero_has_no_sign() -> None:
    found = Channel("i", "A", -0.0, 2.0, 0.0, 0.0, 6.8e-15, 0.0, 0.0).to_dict()
    assert (str(found["low"]), found["noise"]) == ("0.0", None)
    assert Channel("i", "A", 0.0, 2.0, 0.0, 0.0, 5e-3, 0.0, 0.0).to_dict()["noise"] == 5e-3


@pytest.mark.parametrize("seen", [0.748, 0.748 * (1.0 + 2e-8)])
def test_a_step_that_is_stated_is_no_noise_of_a_whole_step(seen: float) -> None:
    found = Channel("dq_m", "rad/s", 0.0, 5.236, seen, 0.748, 0.0, 0.0, 0.0)
    assert found.noise == pytest.approx(0.748 / np.sqrt(12.0))


@pytest.mark.parametrize(("damping", "steady"), [(0.0, True), (0.02, False)])
def test_one_torque_that_accelerates_a_wheel_tells_no_friction(
    damping: float, steady: bool
) -> None:
    """Of a wheel that reaches its speed something else is said."""
    rng, dt = np.random.default_rng(0), 0.005
    t = dt * np.arange(1000)
    inertia, dry, torque = 4e-3, 0.03, 0.21
    rate = max(damping, 1e-9) / inertia
    speed = (torque - dry) / inertia / rate * -np.expm1(-rate * t)
    columns = {
        "t": t,
        "i": torque / 0.07 + 0.1 * rng.standard_normal(len(t)),
        "dq_m": speed + 0.1 * rng.standard_normal(len(t)),
    }
    made = Record(columns, {"t": "s", "i": "A", "dq_m": "rad/s"}, structure="rigid")
    known = {"I_m": inertia, "I_g": 0.0, "I_l": 0.0, "d_m": 0.0, "n": 1.0, "k_t": 0.07}
    file = JointFile(JointParameters.from_values("wheel", known))
    found = examine(made, file, get_structure("rigid"))
    why = reasons(found)["coulomb"]
    assert why.startswith("One torque accelerates the joint steadily") == steady
    assert ("inertia" in reasons(found)) == steady
