"""Signs: what physics ties together is put right; what nothing ties is left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from cjt_gym.blind import draw_case, write_case
from cjt_gym.gap.check import examine
from cjt_gym.gap.recorded.orient import orient
from cjt_gym.joint import JointFile, Structure, get_structure, load_joint_file
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import Record, read_record
from tests.gap.horizons.rotor import datasheet
from tests.gap.test_back_emf import motor, sheet

Blind = tuple[Record, JointFile, Structure]


def blind(seed: int, structure: str, effects: list[str], folder: Path) -> Blind:
    case = draw_case(seed, structure=structure, effects=effects, duration=4.0)
    write_case(case, folder)
    record = read_record(folder / "diagnose.npz")
    return record, load_joint_file(folder / "nominal.toml"), get_structure(structure)


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> Blind:
    return blind(5, "full_dynamics", ["coulomb"], tmp_path_factory.mktemp("free"))


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Blind:
    folder = tmp_path_factory.mktemp("locked")
    return blind(6, "output_fixed_rigid_gearbox", ["stribeck"], folder)


def turned(record: Record, *names: str) -> Record:
    return record.with_columns({name: -record[name] for name in names})


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_voltage_that_was_turned_is_told_by_the_speed_alone(sign: float) -> None:
    columns = {name: motor()[name] for name in ("t", "v", "dq_m")}
    told = Record(columns, {"t": "s", "v": "V", "dq_m": "rad/s"}).with_columns(
        {"v": sign * columns["v"]}
    )
    oriented, repairs = orient(told, sheet(0.05), get_structure("rigid"))
    assert bool(repairs) == (sign < 0.0)
    assert np.corrcoef(oriented["v"], oriented["dq_m"])[0, 1] > 0.0


@pytest.mark.parametrize("kind", ["free", "locked"])
def test_signs_that_agree_are_left(kind: str, request: pytest.FixtureRequest) -> None:
    record, joint, structure = request.getfixturevalue(kind)
    oriented, repairs = orient(record, joint, structure)
    assert oriented is record
    assert repairs == ()


@pytest.mark.parametrize("names", [("i",), ("i_cmd",), ("q_m",), ("tau",), ("i", "tau")])
def test_turned_channels_are_found(names: tuple[str, ...], free: Blind) -> None:
    record, joint, structure = free
    oriented, repairs = orient(turned(record, *names), joint, structure)
    assert {repair.channel for repair in repairs} == set(names)
    assert all(np.array_equal(oriented[name], record[name]) for name in record.columns)
    assert oriented.provenance["repairs"] == [repair.text for repair in repairs]


@pytest.mark.parametrize("name", ["i", "q_m", "tau"])
def test_turned_channels_are_found_with_a_locked_output(name: str, locked: Blind) -> None:
    record, joint, structure = locked
    oriented, _ = orient(turned(record, name), joint, structure)
    assert np.array_equal(oriented[name], record[name])


def test_angles_that_are_swapped_look_like_a_torque_of_the_other_sign(
    free: Blind, locked: Blind
) -> None:
    record, joint, structure = free
    swapped = record.with_columns({"q_m": record["q_l"], "q_l": record["q_m"]})
    (repair,) = orient(swapped, joint, structure)[1]
    assert repair.text.startswith("tau: sign turned")
    assert repair.text.endswith("Or q_m and q_l are swapped.")
    assert any(
        "as if its sign were turned or q_m and q_l were swapped" in fault
        for fault in examine(swapped, joint, structure).faults
    )
    record, joint, structure = locked
    (repair,) = orient(turned(record, "tau"), joint, structure)[1]
    assert "swapped" not in repair.text, "the load's angle is that of a lock"


def test_a_load_angle_that_is_turned(free: Blind, locked: Blind) -> None:
    record, joint, structure = free
    assert np.array_equal(orient(turned(record, "q_l"), joint, structure)[0]["q_l"], record["q_l"])
    record, joint, structure = locked
    spoilt = turned(record, "q_l")
    assert orient(spoilt, joint, structure)[0] is spoilt, "it hardly moves: nothing to tell from"


def test_missing_samples_do_no_harm(free: Blind) -> None:
    record, joint, structure = free
    tau = -record["tau"]
    tau[100:160] = np.nan
    holed = Record(
        {**record.columns, "tau": tau}, record.units, allow_nan=True, structure=record.structure
    )
    oriented, repairs = orient(holed, joint, structure)
    assert [repair.channel for repair in repairs] == ["tau"]
    assert np.isnan(oriented["tau"][100:160]).all()


def test_a_drive_without_a_spring() -> None:
    record = read_record("emps")
    joint, structure = load_joint_file("emps"), get_structure("rigid")
    assert orient(record, joint, structure) == (record, ())
    oriented, repairs = orient(turned(record, "q_m"), joint, structure)
    assert [repair.channel for repair in repairs] == ["q_m"]
    assert np.array_equal(oriented["q_m"], record["q_m"])


@pytest.mark.parametrize("swing", [1.2, 0.2], ids=["far", "a little"])
def test_a_weight_that_is_lifted_does_not_turn_a_sign(swing: float) -> None:
    """Slow motion against a weight looks like an inertia of the other sign."""
    t = np.arange(10000) * 2e-3
    q = swing * (np.sin(2.0 * np.pi * 0.31 * t) + 0.4 * np.sin(2.0 * np.pi * 0.47 * t))
    speed = np.gradient(q, t)
    torque = 0.01 * np.gradient(speed, t) + 2.0 * np.sin(q) + 0.1 * np.tanh(20.0 * speed)
    columns = {"t": t, "q_m": q, "i": torque / 0.1}
    record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
    values = {"I_m": 0.01, "I_g": 0.0, "I_l": 0.0, "n": 1.0, "k_t": 0.1}
    sheet = JointFile(JointParameters.from_values("arm", values))
    assert orient(record, sheet, get_structure("rigid"))[0] is record


def test_a_motor_that_brakes_what_a_measured_load_moves() -> None:
    """The current opposes the motion all the time, and is none the less right."""
    t = 2e-3 * np.arange(6000)
    waves = [(0.4, 0.9), (0.2, 2.3), (0.05, 5.9)]
    q, v, a = (
        sum(x * w**k * np.sin(w * t + x + k * np.pi / 2.0) for x, w in waves) for k in range(3)
    )
    joint, structure = load_joint_file("emps"), get_structure("rigid")
    braking = -2.0 * np.asarray(v)
    load = 3.0 * np.asarray(a) + 1.5 * np.asarray(v) - braking
    units = {"i": "A", "q_m": "rad", "tau_l": "N m"}
    record = Record({"i": braking, "q_m": np.asarray(q), "tau_l": load}, units, dt=2e-3)
    assert orient(record, joint, structure) == (record, ())
    unaware = Record({"i": braking, "q_m": np.asarray(q)}, {"i": "A", "q_m": "rad"}, dt=2e-3)
    assert orient(unaware, joint, structure)[1], "without the load the current looks reversed"


def test_a_velocity_against_its_angle(free: Blind) -> None:
    record, joint, structure = free
    slope = np.gradient(record["q_m"], record.t)
    with_velocity = record.with_columns({"dq_m": -slope}, {"dq_m": "rad/s"})
    oriented, _ = orient(with_velocity, joint, structure)
    assert np.array_equal(oriented["dq_m"], slope)


@pytest.mark.parametrize(
    ("factors", "channel"),
    [({"q_m": 180 / np.pi, "q_l": 180 / np.pi}, "q_m"), ({"i": 1e3, "i_cmd": 1e3}, "i")],
)
def test_units_that_a_law_gives_away(
    factors: dict[str, float], channel: str, locked: Blind
) -> None:
    record, joint, structure = locked
    spoilt = record.with_columns({name: record[name] * f for name, f in factors.items()})
    oriented, repairs = orient(spoilt, joint, structure)
    assert oriented is spoilt, "noticed, not changed"
    assert [(repair.kind, repair.channel) for repair in repairs] == [("unit", channel)]


@pytest.mark.parametrize(("factor", "given_away"), [(180.0 / np.pi, True), (1.5, False)])
def test_one_angle_in_another_unit_than_the_other(
    factor: float, given_away: bool, free: Blind
) -> None:
    record, joint, structure = free
    spoilt = record.with_columns({"q_l": factor * record["q_l"]})
    found = [repair.text for repair in orient(spoilt, joint, structure)[1] if repair.kind == "unit"]
    assert any("q_l or q_m" in text and "180/pi" in text for text in found) == given_away


def test_a_late_wave_is_not_taken_for_its_opposite(locked: Blind) -> None:
    _, joint, structure = locked
    t = 1e-3 * np.arange(600)
    wave = np.sin(2.0 * np.pi * 12.0 * t) * np.linspace(0.5, 1.0, 600)
    late = np.interp(t - 0.06, t, wave)
    units = {"i_cmd": "A", "i": "A", "q_m": "rad"}
    record = Record({"i_cmd": wave, "i": late, "q_m": 0.0 * t}, units, dt=1e-3)
    assert orient(record, joint, structure) == (record, ())
    broad = np.cumsum(np.random.default_rng(0).standard_normal(600))
    columns = {"i_cmd": broad, "i": -np.roll(broad, 5), "q_m": 0.0 * t}
    repairs = orient(Record(columns, units, dt=1e-3), joint, structure)[1]
    assert len(repairs) == 1, "one of them is turned"


def test_the_longest_piece_of_a_log_shows_the_signs_of_all(free: Blind) -> None:
    record, joint, structure = free
    wrong = turned(record, "i_cmd")
    rest = wrong.slice(0, 150)
    assert orient(rest, joint, structure)[0] is rest, "at rest nothing shows a sign"
    oriented, repairs = orient(rest, joint, structure, wrong)
    assert {repair.channel for repair in repairs} == {"i_cmd"}
    assert np.array_equal(oriented["i_cmd"], record["i_cmd"][:150])


@pytest.mark.parametrize(("inertia", "told"), [(0.0, True), (0.02, False)])
def test_a_current_that_the_speed_makes_need_not_have_the_wrong_sign(
    inertia: float, told: bool
) -> None:
    t = 2e-3 * np.arange(5000)
    speed = np.sin(3.0 * t) + 0.6 * np.sin(11.0 * t + 1.0)
    current = -0.2 * speed - inertia * np.gradient(speed, t)
    current += 0.005 * np.random.default_rng(0).standard_normal(len(t))
    columns = {"t": t, "i": current, "q_m": cumulative_trapezoid(speed, t, initial=0.0)}
    moved = Record(columns, {"t": "s", "i": "A", "q_m": "rad"}, structure="rigid")
    (repair,) = orient(moved, datasheet(1.0), get_structure("rigid"))[1]
    assert repair.text.startswith("q_m: sign turned")
    assert ("the speed makes the current" in repair.text) == told
