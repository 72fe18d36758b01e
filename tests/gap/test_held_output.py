"""Held outputs of which little was recorded: a command and a torque, unevenly and with gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_filter

from cjt_gym.gap import diagnose
from cjt_gym.gap.check import examine
from cjt_gym.gap.check.pieces import ORDER, smooth
from cjt_gym.gap.horizons.findings.held_output import held_alike
from cjt_gym.gap.horizons.findings.verdict import unexplained_of, verdict_of
from cjt_gym.gap.horizons.fitting.terms import candidates, scales_of
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.drive import fit_drive
from cjt_gym.gap.horizons.prediction.log import to_log
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.prediction.windows import Piece
from cjt_gym.gap.horizons.selection.judgement import Judgement, Row
from cjt_gym.joint import JointFile, get_structure, load_joint
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.joint import Joint
from cjt_gym.records import Record

HELD = "output_fixed_rigid_gearbox"
UNITS = {"t": "s", "i_cmd": "A", "i": "A", "tau": "N m"}
SPRING = {
    "I_m": 0.006, "I_g": 0.0, "I_l": 0.0, "k_b": 2400.0, "d_m": 0.0, "d_g": 0.0, "d_gl": 0.0,
    "n": 1.0, "k_t": 1.0,
}  # fmt: skip


def sheet(**values: float) -> JointFile:
    """Return a joint on a spring whose inertia is a guess."""
    bare = JointParameters.from_values("held", SPRING | values)
    guess = Quantity(bare.I_m, "kg m^2", "test", guess=True)
    stiff = Quantity(bare.k_b, "N m/rad", "test", 0.1)
    return JointFile(bare.replace(I_m=guess, k_b=stiff))


def held(columns: dict[str, np.ndarray]) -> Record:
    return Record(columns, {name: UNITS[name] for name in columns}, structure=HELD)


def slow_record(dt: float = 2e-3, seconds: float = 16.0) -> Record:
    """Return the torque of a held spring behind a drive with a lag of 30 ms, and nothing else."""
    t = dt * np.arange(round(seconds / dt))
    rng = np.random.default_rng(2)
    amps = (
        1.5 * np.sin(2.0 * np.pi * (0.2 + 0.6 * t) * t)
        + rng.uniform(-1.0, 1.0, 40)[(t / 0.4).astype(int)]
    )
    share, tau = np.exp(-dt / 0.03), np.zeros(len(t))
    for k in range(1, len(t)):
        tau[k] = share * tau[k - 1] + (1.0 - share) * amps[k - 1]
    tau += 0.05 * rng.standard_normal(len(t))
    return held({"t": t, "i_cmd": amps, "tau": tau})


@pytest.mark.slow
def test_a_slow_drive_is_not_called_damping_for_sure() -> None:
    """By the command alone a lag and an overdamped spring answer alike."""
    found = diagnose(slow_record(), sheet(), HELD)
    slow = [e for e in found.effects if e.name in ("damping", "current_lag", "command_delay")]
    assert slow
    assert all(e.status == "tentative" for e in slow)
    either = {slow[0].name, *slow[0].confusable_with}
    assert {"damping", "current_lag"} <= either


@pytest.mark.parametrize(
    ("damping", "drive", "alike"),
    [(60.0, "i_cmd", ("current_lag",)), (0.5, "i_cmd", ()), (60.0, "i", ())],
    ids=["overdamped", "swings", "current measured"],
)
def test_what_slows_a_held_joint(damping: float, drive: str, alike: tuple[str, ...]) -> None:
    file = sheet(d_m=damping)
    log = to_log(slow_record(), file, get_structure(HELD))
    joint = Joint(file, HELD, "current", {})
    assert held_alike("damping", joint, replace(log, drive=drive)) == alike  # type: ignore[arg-type]
    assert held_alike("coulomb", joint, log) == ()


def test_a_drive_behind_a_held_spring_may_be_slow() -> None:
    file, shape = sheet(), get_structure(HELD)
    case = make_case([slow_record()], [], file, shape)
    terms = candidates(case.joint, scales_of(case.joint, case.logs), case.logs)
    (lag,) = (t for t in terms if t.name == "current_lag")
    assert lag.numbers[0].low < 1.0 / (2.0 * np.pi * 0.03)


@pytest.mark.slow
def test_a_replay_that_is_far_off_is_not_explained() -> None:
    """Of a held output nothing adds up: a third of the torque left is no explanation."""
    whole = slow_record()
    rng = np.random.default_rng(7)
    shaken = whole["tau"] + 0.5 * np.std(whole["tau"]) * np.sign(
        np.sin(2.0 * np.pi * 3.1 * whole.t) + 0.2 * rng.standard_normal(len(whole))
    )
    record = held({"t": whole.t, "i_cmd": whole["i_cmd"], "tau": shaken})
    found = diagnose(record, sheet(), HELD)
    assert found.gap.after > 0.3
    assert found.verdict in ("partly_explained", "unexplained")


@pytest.mark.parametrize(("left", "verdict"), [(0.2, "unexplained"), (0.1, "no_gap")])
def test_a_fifth_of_a_whole_held_record_is_a_gap_though_nothing_is_named(
    left: float, verdict: str
) -> None:
    case = make_case([slow_record(seconds=4.0)], [], sheet(), get_structure(HELD))
    rows = (Row(0.0, "tau", left, None, left, None, None),)
    judged = Judgement(case, "datasheet", case.joint, rows)
    assert verdict_of(judged, (), suspected=False) == verdict
    assert ("does not drift" in unexplained_of(judged, verdict, ()).text) == (left > 0.15)


def test_a_dead_time_of_one_row_is_no_lag_where_rows_are_uneven() -> None:
    """Rows of 4 and 10 ms, each with the current that the command of the last row asked for."""
    rng = np.random.default_rng(3)
    steps = np.where(rng.random(6000) < 0.6, 4.2e-3, 10.1e-3)
    t = np.cumsum(steps)
    amps = np.convolve(rng.standard_normal(6000), np.ones(3) / 3.0, "same") * 3.0
    late = np.r_[amps[0], amps[:-1]] + 0.05 * rng.standard_normal(6000)
    columns = {"t": t, "i_cmd": amps, "i": late, "tau": 0.1 * late}
    record = held(columns)
    log = to_log(record, sheet(k_t=0.1), get_structure(HELD), measured=True)
    drive = fit_drive(log, [Piece(0, 0, len(log))])
    assert drive is not None
    assert drive.late
    assert not drive.lagging
    assert 4e-3 < drive.delay < 1e-2


def test_scraps_between_gaps_are_no_whole_records() -> None:
    whole = slow_record()
    kept = (whole.t < 8.0) | ((1000.0 * whole.t).astype(int) % 150 < 100)
    columns = {n: whole[n][kept] for n in ("t", "i_cmd", "tau")}
    case = make_case([held(columns)], [], sheet(), get_structure(HELD))
    lengths = [g.length for g in case.fit.groups if g.horizons == (WHOLE,)]
    assert min(lengths) * case.logs[0].dt > 0.2
    assert len(lengths) < 30


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("length", [11, 40, 400])
def test_short_stretches_are_smoothed_as_scipy_does(length: int, order: int) -> None:
    x = np.cumsum(np.random.default_rng(length).standard_normal(length))
    wanted = savgol_filter(x, 11, ORDER, deriv=order, delta=2e-3)
    assert smooth(x, 11, order, 2e-3) == pytest.approx(wanted, rel=1e-9, abs=1e-9 * 5e2**order)


def test_a_voltage_that_drives_the_joint_is_its_command() -> None:
    joint = load_joint("orange_80_6000", "rigid", drive="static")
    t = 1e-3 * np.arange(8000)
    volts = 8.0 * np.sign(np.sin(2.0 * np.pi * 0.7 * t)) + 3.0 * np.sin(2.0 * np.pi * 5.0 * t)
    made = quiet(joint).simulate(None, voltage=volts, dt=1e-3)
    units = {"t": "s", "v": "V", "q_m": "rad"}
    record = Record({"t": t, "v": volts, "q_m": made["true_q_m"]}, units, structure="rigid")
    found = examine(record, joint.file, joint.structure_row)
    assert "command_delay" in found.can_tell
    (why,) = (row.why for row in found.cannot_tell if row.name == "current_saturation")
    assert "voltage" in why


@pytest.mark.slow
def test_friction_of_a_wound_spring_is_told_from_its_deflection() -> None:
    """No torque was measured: a held spring's is known from the motor's angle."""
    found = diagnose(wound(0, 0.15), sheet(I_m=0.05, k_b=150.0), HELD, validate=wound(1, 0.15))
    assert "load_friction" in found.examination.can_tell
    (effect,) = (e for e in found.effects if e.name == "load_friction")
    mu = effect.parameters["mu_m"]
    assert mu.low < 0.15 < mu.high
    assert mu.value == pytest.approx(0.15, rel=0.2)


@pytest.mark.slow
def test_a_wound_spring_without_friction_names_none() -> None:
    found = diagnose(wound(0, 0.0), sheet(I_m=0.05, k_b=150.0), HELD, validate=wound(1, 0.0))
    assert [e.name for e in found.effects] == ["damping"]
    assert found.effects[0].parameters["d_m"].value == pytest.approx(1.0, rel=0.1)


def test_check_sees_whether_friction_of_a_wound_spring_would_show() -> None:
    """It takes deflections that grow and shrink in both directions of the torque."""
    file, shape = sheet(I_m=0.05, k_b=150.0), get_structure(HELD)
    assert "load_friction" in examine(wound(0, 0.0), file, shape).can_tell
    made = wound(0, 0.0)
    still = made.with_columns({"q_m": np.full(len(made), 0.1)})
    assert "load_friction" not in examine(still, file, shape).can_tell


def wound(seed: int, mu: float) -> Record:
    """Return a held spring wound slowly by a motor whose friction grows with the spring's torque.

    In plain NumPy, which shares no formula with the project.
    """
    rng, dt, fine, inertia, damping, k = np.random.default_rng(seed), 5e-3, 20, 0.05, 1.0, 150.0
    t = dt * np.arange(6000)
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    drive = 12.0 * np.sin(0.9 * t + phase[0]) + 6.0 * np.sin(2.3 * t + phase[1])
    drive += 2.0 * np.sin(7.1 * t + phase[2])
    q = v = 0.0
    angle, h = np.zeros(len(t)), dt / fine
    for i in range(len(t)):
        angle[i] = q
        ahead = drive[min(i + 1, len(t) - 1)]
        for j in range(fine):
            torque = drive[i] + (ahead - drive[i]) * j / fine
            free = v + h / inertia * (torque - k * q - damping * v)
            v = np.sign(free) * max(abs(free) - h / inertia * mu * abs(k * q), 0.0)
            q += h * v
    columns = {"t": t, "i": drive + 0.02 * rng.standard_normal(len(t)), "q_m": angle}
    columns["q_m"] = np.round(columns["q_m"] / 2e-5) * 2e-5
    return Record(columns, {"t": "s", "i": "A", "q_m": "rad"}, structure=HELD)


def test_offsets_of_sensor_and_motor_of_a_held_joint_look_alike() -> None:
    file, log = sheet(), to_log(slow_record(), sheet(), get_structure(HELD))
    joint = Joint(file, HELD, "current", {})
    assert held_alike("torque_offset", joint, log) == ("torque_bias",)
    assert held_alike("torque_bias", joint, log) == ("torque_offset",)
    unfelt = replace(log, measured={"q_m": log.measured["tau"]})
    assert held_alike("torque_offset", joint, unfelt) == ()
