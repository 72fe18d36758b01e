"""Joint files without the damping of their spring, and torques computed from its deflection.

The records are those of a linear joint, solved exactly by a matrix exponential.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete

from cjt_gym.gap import diagnose
from cjt_gym.gap.check import examine
from cjt_gym.gap.recorded.spring_damping import unstated_damping, with_spring_damping
from cjt_gym.gap.recorded.usable import measured_only, unmeasured
from cjt_gym.joint import JointFile, get_structure, load_joint_file
from cjt_gym.records import Record, default_units
from tests.gap.bench import STRUCTURE

SHEET = """
name = "arm"
source = "datasheets of motor and spring"

[parameters]
n = { value = 1, unit = "-" }
k_t = { value = 1.0, unit = "N m/A", tolerance = 0.03 }
I_m = { value = 0.1, unit = "kg m^2", tolerance = 0.1 }
I_g = { value = 0.001, unit = "kg m^2", tolerance = 0.3 }
I_l = { value = 0.3, unit = "kg m^2", tolerance = 0.1 }
k_b = { value = 300, unit = "N m/rad", tolerance = 0.02 }
d_m = { value = 0.2, unit = "N m s/rad", guess = true }

[sensors.q_m]
resolution = { value = 1e-4, unit = "rad" }
[sensors.q_l]
resolution = { value = 1e-4, unit = "rad" }
"""
STATED, TRUE, DAMPING = 300.0, 255.0, 0.3
FIXED = "output_fixed_rigid_gearbox"
STEP, DT, SAMPLES = 1e-4, 1e-3, 8000


def sheet(folder: Path, more: str = "") -> JointFile:
    path = folder / "arm.toml"
    path.write_text(SHEET.replace("\n[sensors.q_m]", f"{more}\n\n[sensors.q_m]"))
    return load_joint_file(str(path))


def log(structure: str, torque: str) -> Record:
    """Return a log whose torque is measured, computed from the deflection, or missing."""
    held, rng, t = structure == FIXED, np.random.default_rng(1), DT * np.arange(SAMPLES)
    i = sum(
        6.0 / (1.0 + 0.2 * f) * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.28))
        for f in (0.3, 0.7, 1.3, 2.1, 3.7, 5.3, 8.0)
    )
    k, c, inertia, load = TRUE, DAMPING, 0.101, 0.3
    a = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-k / inertia, -(c + 0.2) / inertia, k / inertia, c / inertia],
            [0.0, 0.0, 0.0, 1.0],
            [k / load, c / load, -k / load, -c / load],
        ]
    )
    if held:
        a[3] = 0.0
    b = np.array([[0.0], [1.0 / inertia], [0.0], [0.0]])
    step, drive, *_ = cont2discrete((a, b, np.eye(4), np.zeros((4, 1))), DT)
    x = np.zeros((SAMPLES, 4))
    for n in range(SAMPLES - 1):
        x[n + 1] = step @ x[n] + drive[:, 0] * i[n]
    angles = np.round(x[:, [0, 2]] / STEP) * STEP
    columns = {"t": t, "i": i, "q_m": angles[:, 0]}
    if not held:
        columns["q_l"] = angles[:, 1]
    if torque == "measured":
        columns["tau"] = k * (x[:, 0] - x[:, 2]) + c * (x[:, 1] - x[:, 3])
        columns["tau"] += 0.05 * rng.standard_normal(SAMPLES)
    elif torque == "computed":
        columns["tau"] = STATED * (angles[:, 0] - angles[:, 1])
    return Record(columns, default_units(tuple(columns)), structure=structure)


@pytest.mark.parametrize("structure", [STRUCTURE, FIXED])
def test_a_stiffness_is_named_where_no_damping_is_stated(tmp_path: Path, structure: str) -> None:
    """Held at none, the damping of the spring kept its stage unexplained, and its stiffness too."""
    found = diagnose(log(structure, "measured"), sheet(tmp_path))
    assert found.verdict == "explained"
    (stiffness,) = found.effects
    assert (stiffness.name, stiffness.status) == ("stiffness", "confirmed")
    known = stiffness.parameters["k_b"]
    assert known.low < TRUE < known.high < 0.95 * STATED
    assert known.value == pytest.approx(TRUE, rel=0.01)
    assert found.joint.parameters.d_gl == pytest.approx(DAMPING, rel=0.2)
    assert "states no damping d_gl" in found.unexplained.text
    entry = found.joint.parameters.quantities["d_gl"]
    assert entry.source.startswith("not stated, identified from")


def test_a_torque_computed_from_the_deflection_is_no_measurement(tmp_path: Path) -> None:
    """Taken for one, it passed for a torque sensor of another scale that is late as well."""
    made = log(STRUCTURE, "computed")
    assert unmeasured(made)["tau"] == (
        "the deflection",
        "is 300 N m/rad times the deflection, with each step of an encoder",
    )
    exam = examine(made, sheet(tmp_path), STRUCTURE)
    assert exam.faults[0].startswith("tau is 300 N m/rad times the deflection")
    assert "torque_gain" not in exam.can_tell
    found = diagnose(made, sheet(tmp_path))
    assert found.unexplained.text.startswith("tau is 300 N m/rad times the deflection")
    (stiffness,) = found.effects
    assert (stiffness.name, stiffness.status) == ("stiffness", "tentative")
    assert "torque_constant" in stiffness.confusable_with
    known = stiffness.parameters["k_b"]
    assert known.low < TRUE < known.high


@pytest.mark.parametrize("structure", [STRUCTURE, FIXED])
def test_only_a_computed_torque_follows_the_steps_of_the_encoders(structure: str) -> None:
    sensed, computed = (log(structure, how) for how in ("measured", "computed"))
    if structure == FIXED:
        held = np.round(computed["q_m"] / STEP) * STEP
        computed = computed.with_columns({"tau": STATED * held + 0.4})
    assert "tau" not in unmeasured(sensed)
    assert "tau" not in measured_only([computed])[0]
    if structure == FIXED:  # its encoder may rest within one step
        resting = computed.with_columns({"q_l": np.full(SAMPLES, 0.3)}, {"q_l": "rad"})
        assert "tau" not in measured_only([resting])[0]
    other = sensed["q_l"] if structure == STRUCTURE else np.zeros(SAMPLES)
    smooth = TRUE * (sensed["q_m"] - other)
    smooth = np.convolve(smooth, np.ones(5) / 5.0, "same")  # no sensor has less noise
    assert "tau" not in unmeasured(sensed.with_columns({"tau": smooth}))


def test_exchanged_encoders_are_told(tmp_path: Path) -> None:
    for torque in ("measured", "computed", "missing"):
        made = log(STRUCTURE, torque)
        wrong = made.with_columns({"q_m": made["q_l"], "q_l": made["q_m"]})
        for record, told in ((made, False), (wrong, True)):
            faults = examine(record, sheet(tmp_path), STRUCTURE).faults
            assert any("seem to be exchanged" in fault for fault in faults) == told


def test_a_command_with_the_wrong_sign_is_no_exchange_of_encoders(tmp_path: Path) -> None:
    made = log(STRUCTURE, "missing")
    faults = examine(made.with_columns({"i": -made["i"]}), sheet(tmp_path), STRUCTURE).faults
    assert not any("exchanged" in fault for fault in faults)


def test_a_load_tells_exchanged_encoders_where_the_torque_does_not(tmp_path: Path) -> None:
    made = log(STRUCTURE, "missing")
    scattered = np.random.default_rng(2).standard_normal(SAMPLES)
    idle = made.with_columns({"i": scattered})
    swapped = {"q_m": idle["q_l"], "q_l": idle["q_m"]}
    for record, told in ((idle, False), (idle.with_columns(swapped), True)):
        faults = examine(record, sheet(tmp_path), STRUCTURE).faults
        assert any("seem to be exchanged" in fault for fault in faults) == told
    twice = examine(made.with_columns({"q_l": made["q_m"]}), sheet(tmp_path), STRUCTURE).faults
    assert any("mapped twice" in fault for fault in twice)


@pytest.mark.slow
def test_beside_exchanged_encoders_nothing_is_confirmed(tmp_path: Path) -> None:
    made = log(STRUCTURE, "missing")
    found = diagnose(made.with_columns({"q_m": made["q_l"], "q_l": made["q_m"]}), sheet(tmp_path))
    assert not [e.name for e in found.effects if e.status == "confirmed"]


def test_a_stated_damping_stays(tmp_path: Path) -> None:
    shape = get_structure(STRUCTURE)
    for more in ('d_gl = { value = 0.4, unit = "N m s/rad" }',
                 'd_gl = { value = 0.0, unit = "N m s/rad" }'):  # fmt: skip
        file = sheet(tmp_path, more)
        assert with_spring_damping(file, shape) is file
        assert unstated_damping(file, file) == []
    bare = sheet(tmp_path)
    assert with_spring_damping(bare, get_structure("rigid")) is bare
    open_ = with_spring_damping(bare, shape)
    assert open_.parameters.quantities["d_gl"].guess
    assert open_.parameters.get("d_gl", 1.0) == 0.0  # the datasheet's joint is as it is stated


def test_damping_of_a_held_motor_is_not_called_that_of_its_spring(tmp_path: Path) -> None:
    damped = sheet(tmp_path, 'd_gl = { value = 0.4, unit = "N m s/rad" }')
    bare = sheet(tmp_path)
    (plain,), (both,) = (unstated_damping(bare, damped, alone=alone) for alone in (False, True))
    assert "d_m" not in plain
    assert "does not tell it from the motor's own damping d_m" in both
