"""A series-elastic joint whose first datasheet lacks four effects, simulated in plain NumPy."""

from __future__ import annotations

from dataclasses import replace
from math import copysign, exp, sin
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.recorded.tolerances import common_deviation
from cjt_gym.joint import JointFile, Quantity, load_joint, to_toml
from cjt_gym.joint.files.diagnosed import covariance_of
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.plant.randomization.together import found_together
from cjt_gym.records import Record

MOTOR, LOAD, BAR, K_T, N = 0.92, 0.6, 1500.0, 0.068, 100.0
"""Inertias of motor and load [kg m^2], stiffness [N m/rad], torque constant [N m/A], gear ratio."""
DRY, RISE, SLOW, DRAG, PLAY, WEIGHT = 3.0, 1.2, 0.05, 2.0, 0.002, 12.0
"""What the datasheet lacks: dry friction and its rise [N m] below a speed [rad/s], damping
[N m s/rad], play [rad] and a weight [N m]."""
STEP, SUBSTEPS, SECONDS = 1e-3, 20, 16.0
GRAIN = 2.0 * np.pi / 16_384 / N
"""Step of the motor's angle [rad]."""


def joint_record(seed: int, size: float) -> Record:
    """Return a run under a torque controller that follows a chirp and steps of a given size [N m].

    Args:
        seed: Of steps and noise.
        size: Amplitude of the torque wanted.
    """
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(round(SECONDS / STEP))
    wanted = size * np.sin(2.0 * np.pi * (0.3 * t + 1.6 * t**2))
    levels = rng.uniform(-1.2 * size, 1.2 * size, 40)
    late = t > 0.5 * SECONDS
    wanted[late] = levels[(t[late] / 0.4).astype(int) % 40]
    q = dq = load = speed = flow = before = slope = 0.0
    h, rows = STEP / SUBSTEPS, []
    for k in range(t.size):
        play = max(abs(q - load) - 0.5 * PLAY, 0.0)
        torque = copysign(BAR * play, q - load) + (dq - speed) * (play > 0.0)
        seen = torque + 0.03 * rng.standard_normal()
        error = wanted[k] - seen
        slope += 0.2 * ((error - before) / STEP - slope)
        before = error
        asked = float(np.clip((wanted[k] + error + 0.02 * slope) / (K_T * N), -15.0, 15.0))
        rows.append((asked, flow + 0.02 * rng.standard_normal(), q, load, seen))
        for _ in range(SUBSTEPS):
            flow += h * 3000.0 * (asked - flow)
            play = max(abs(q - load) - 0.5 * PLAY, 0.0)
            torque = copysign(BAR * play, q - load) + (dq - speed) * (play > 0.0)
            free = dq + h / MOTOR * (K_T * N * flow - torque - DRAG * dq)
            drag = h / MOTOR * (DRY + RISE * exp(-((dq / SLOW) ** 2)))
            dq = copysign(max(abs(free) - drag, 0.0), free)
            q += h * dq
            speed += h / LOAD * (torque - WEIGHT * sin(load))
            load += h * speed
    asked, i, q_m, q_l, tau = np.array(rows).T
    columns = {
        "t": t, "i_cmd": asked, "i": i, "tau": tau,
        "q_m": GRAIN * np.round(q_m / GRAIN), "q_l": q_l,
    }  # fmt: skip
    units = {"t": "s", "i_cmd": "A", "i": "A", "q_m": "rad", "q_l": "rad", "tau": "N m"}
    return Record(columns, units, structure="rigid_gearbox")


def datasheet(*, noise: bool, weight: Quantity | None = None) -> JointFile:
    """Return the joint's datasheet.

    Args:
        noise: Whether it states the noise of the measured current.
        weight: The weight that it lists, if it does.
    """
    values = {
        "n": (N, "-", None), "k_t": (K_T, "N m/A", 0.03), "I_m": (0.9, "kg m^2", 0.1),
        "I_g": (0.02, "kg m^2", 0.3), "I_l": (LOAD, "kg m^2", 0.1), "k_b": (BAR, "N m/rad", 0.03),
    }  # fmt: skip
    known = {s: Quantity(x, unit, "test", tolerance=t) for s, (x, unit, t) in values.items()}
    sensors = {
        "q_m": {"resolution": Quantity(GRAIN, "rad", "test")},
        "tau": {"noise": Quantity(0.03, "N m", "test")},
        "i": {"noise": Quantity(0.02, "A", "test")},
    }
    given = {name: row for name, row in sensors.items() if noise or name != "i"}
    listed = {} if weight is None else {"gravity": {"torque": weight}}
    return JointFile(JointParameters("arm", "test", known), listed, sensors=given, drive="current")


@pytest.fixture(scope="module")
def told() -> Diagnosis:
    return diagnose(joint_record(1, 5.0), datasheet(noise=True))


@pytest.mark.slow
def test_all_four_effects_that_are_missing_are_found(told: Diagnosis) -> None:
    named = {e.name: e.parameters for e in told.effects}
    assert told.verdict == "explained"
    assert named.keys() == {"gravity", "stribeck", "backlash", "damping"}
    assert named["gravity"]["torque"].value == pytest.approx(WEIGHT, rel=0.03)
    assert named["backlash"]["gap"].value == pytest.approx(PLAY, rel=0.03)
    assert named["damping"]["d_m"].value == pytest.approx(DRAG, rel=0.05)
    assert named["stribeck"]["d_cm"].value == pytest.approx(DRY, rel=0.05)


@pytest.mark.slow
def test_noise_that_is_not_stated_swallows_no_effect() -> None:
    found = diagnose(joint_record(1, 5.0), datasheet(noise=False))
    named = {e.name: e.parameters for e in found.effects}
    assert named.keys() >= {"gravity", "backlash", "damping"}
    assert named["damping"]["d_m"].value == pytest.approx(DRAG, rel=0.2)
    ahead = [row for row in found.horizons if row.channel == "q_m" and row.seconds == 0.5]
    assert all(row.found < 0.05 < row.datasheet for row in ahead)


@pytest.mark.slow
def test_a_second_record_makes_them_no_worse() -> None:
    found = diagnose(joint_record(1, 5.0), datasheet(noise=True), validate=joint_record(2, 8.0))
    named = {e.name: e.parameters for e in found.effects}
    assert named.keys() == {"gravity", "stribeck", "backlash", "damping"}
    assert named["stribeck"]["v_s"].value == pytest.approx(SLOW, rel=0.1)
    assert named["stribeck"]["d_sm"].value == pytest.approx(RISE, rel=0.1)
    assert named["damping"]["d_m"].value == pytest.approx(DRAG, rel=0.05)


@pytest.mark.slow
def test_a_load_that_no_stage_judges_is_searched_for() -> None:
    records = [joint_record(seed, size) for seed, size in ((1, 5.0), (2, 6.0))]
    unseen = [
        replace(one, columns={k: x for k, x in one.columns.items() if k != "q_l"}, units={
            k: x for k, x in one.units.items() if k != "q_l"
        })
        for one in records
    ]  # fmt: skip
    found = diagnose(unseen[0], datasheet(noise=True), validate=unseen[1])
    assert "gravity" in {e.name for e in found.effects}
    ahead = {(row.channel, row.seconds): row.found for row in found.horizons}
    assert ahead["q_m", 0.5] < 0.1
    assert ahead["tau", 0.5] < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.15, None])
def test_a_listed_weight_is_as_free_as_its_tolerance_says(tolerance: float | None) -> None:
    """Held at a wrong size, it would make the torque sensor and all else seem off by a factor."""
    weight = Quantity(0.88 * WEIGHT, "N m", "drawing", tolerance, guess=tolerance is None)
    found = diagnose(joint_record(1, 5.0), datasheet(noise=True, weight=weight))
    named = {e.name: e.parameters for e in found.effects}
    assert named.keys() == {"stribeck", "backlash", "damping"}
    listed = found.joint.effects["gravity"]["torque"]
    assert isinstance(listed, Quantity)
    assert listed.number == pytest.approx(WEIGHT, rel=0.01)
    assert not listed.guess
    assert ("guess of the weight" in found.unexplained.text) == weight.guess
    assert f"{weight.number:.6g}" in listed.source
    for name, symbol, true in (("damping", "d_m", DRAG), ("stribeck", "d_cm", DRY)):
        assert named[name][symbol].low < true < named[name][symbol].high


@pytest.mark.slow
def test_all_torques_are_drawn_with_one_scale(told: Diagnosis, tmp_path: Path) -> None:
    """What the torque sensor's scale leaves open is one factor of friction and inertia."""
    known = covariance_of(told.joint)
    assert known is not None
    deviation = np.sqrt(np.diag(known.matrix))
    one, two = (known.names.index(name) for name in ("k_t", "stribeck.d_cm"))
    share = known.matrix[one, two] / (deviation[one] * deviation[two])
    least = common_deviation(datasheet(noise=True), cut=True)
    assert 0.5 < share < 1.0
    assert (deviation[[one, two]] / known.values[[one, two]] > least).all()
    file = tmp_path / "joint.toml"
    file.write_text(to_toml(told.joint))
    assert found_together(load_joint(file)).keys() >= {"k_t", "stribeck.d_cm"}
