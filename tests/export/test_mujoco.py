"""Exported models behave in MuJoCo as the joint does here."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from cjt_gym.errors import ConfigurationError
from cjt_gym.export import to_mujoco
from cjt_gym.export.mujoco import SUPPORT
from cjt_gym.joint import EFFECTS, Joint, load_joint

mujoco = pytest.importorskip("mujoco", minversion="4.0")

DT, STEP, SAMPLES = 1e-3, 1e-4, 400
FIXED = "output_fixed_rigid_gearbox"
Effects = dict[str, dict[str, Any]]


def torque() -> np.ndarray:
    t = np.arange(SAMPLES) * DT
    return 25.0 * np.sin(2.0 * np.pi * (3.0 + 25.0 * t) * t) + 8.0 * np.sin(2.0 * np.pi * 2.0 * t)


def here(joint: Joint, dt_physics: float = 1e-4) -> np.ndarray:
    record = joint.simulate(torque(), dt=DT, dt_physics=dt_physics)
    return np.stack([record["true_q_m"], record["true_tau"]])


def there(joint: Joint) -> np.ndarray:
    """Return motor angle and joint torque that MuJoCo gives for the same command, shape (2, n)."""
    model = mujoco.MjModel.from_xml_string(to_mujoco(joint, STEP).text)
    data = mujoco.MjData(model)
    p = joint.parameters
    found = np.zeros((2, SAMPLES))
    for k, command in enumerate(torque()):
        mujoco.mj_forward(model, data)
        twist = data.sensor("deflection").data[0]
        half = 0.5 * joint.effects.get("backlash", {}).get("gap", 0.0)
        deflection = twist - np.clip(twist, -half, half)
        rate = data.sensor("deflection_rate").data[0]
        k_3 = joint.effects.get("hardening", {}).get("k_3", 0.0)
        tau = p.k_b * deflection + k_3 * deflection**3 + p.get("d_gl", 0.0) * rate
        found[:, k] = data.sensor("q_m").data[0], tau
        data.actuator("drive").ctrl[0] = command
        for _ in range(round(DT / STEP)):
            mujoco.mj_step(model, data)
    return found


def apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the rms of the difference over that of the second, per channel, shape (2,)."""
    rms: np.ndarray = np.sqrt(np.mean((one - other) ** 2, axis=1) / np.mean(other**2, axis=1))
    return rms


@pytest.mark.parametrize("structure", ["full_dynamics", "rigid_gearbox", "output_fixed", FIXED])
def test_the_linear_joint_moves_as_it_does_here(structure: str) -> None:
    joint = load_joint("orange_80_6000", structure, parameters={"I_l": 0.8, "d_gl": 1.5})
    assert apart(there(joint), here(joint)).max() < 0.01  # first order in the step of MuJoCo


CASES: list[tuple[Effects, str, float]] = [
    ({"torque_constant": {"k_t": 0.09}}, FIXED, 0.01),
    ({"torque_offset": {"torque": 5.0}}, FIXED, 0.01),
    ({"inertia": {"I_m": 0.3}}, FIXED, 0.01),
    ({"damping": {"d_m": 12.0}}, FIXED, 0.01),
    ({"current_saturation": {"i_p": 2.0}}, FIXED, 0.01),
    ({"current_lag": {"bandwidth": 40.0}}, FIXED, 0.01),
    ({"command_delay": {"delay": 4e-3}}, FIXED, 0.02),
    ({"cogging": {"f": (480.0,), "a": (2.0,), "b": (1.0,)}}, FIXED, 0.02),
    ({"hardening": {"k_3": 5e7}}, FIXED, 0.02),
    ({"gear_stiffness": {"k_g": 9000.0}}, "output_fixed", 0.01),
    ({"coulomb": {"d_cm": 4.0, "dq_0": 0.0}}, FIXED, 0.05),
    ({"stribeck": {"d_cm": 4.0, "d_sm": 3.0, "v_s": 0.05, "dq_0": 0.0}}, FIXED, 0.05),
    ({"presliding": {"d_cm": 4.0, "sigma_m": 4000.0}}, FIXED, 0.05),
    ({"backlash": {"gap": 2e-3}}, FIXED, 0.1),
]


@pytest.mark.parametrize(("effects", "structure", "tolerance"), CASES, ids=lambda v: str(v)[:24])
def test_an_effect_that_is_expressed_acts_as_it_does_here(
    effects: Effects, structure: str, tolerance: float
) -> None:
    joint = load_joint("orange_80_6000", structure, effects=effects)
    plain = load_joint("orange_80_6000", structure, effects={})
    found = to_mujoco(joint)
    assert not found.missing
    truth = here(joint)
    signature = apart(here(plain), truth)[1]
    error = apart(there(joint), truth)[1]
    assert error < tolerance
    assert error < 0.35 * signature  # what is exported is the effect, not just the joint


def test_a_voltage_drive_becomes_a_dcmotor_that_its_supply_limits() -> None:
    weak = load_joint("orange_80_6000", FIXED, drive="rl", parameters={"v_0": 2.0})
    text = to_mujoco(weak).text
    assert 'input="ff"' in text
    assert apart(there(weak), here(weak))[1] < 0.03
    strong = load_joint("orange_80_6000", FIXED)
    assert apart(there(weak), here(strong))[1] > 0.1


@pytest.mark.parametrize("dcmotor", [True, False])
@pytest.mark.parametrize("structure", ["full_dynamics", "rigid", FIXED])
def test_a_joint_with_everything_loads(structure: str, dcmotor: bool) -> None:
    joint = load_joint("orange_80_6000", structure, effects="all")
    found = to_mujoco(joint, dcmotor=dcmotor)
    model = mujoco.MjModel.from_xml_string(found.text)
    assert model.njnt == max(joint.structure_row.groups) + 1
    assert ("dcmotor name" in found.text) == dcmotor
    named = {*found.exact, *found.nearly, *found.missing}
    assert named == set(joint.effects)


def test_what_is_left_out_is_said_in_the_file() -> None:
    joint = load_joint("orange_80_6000", FIXED, effects={"load_friction": {"mu_m": 0.1}})
    found = to_mujoco(joint)
    assert list(found.missing) == ["load_friction"]
    comment = re.search(r"<!--(.*?)-->", found.text, re.DOTALL)
    assert comment is not None
    assert "load_friction" in comment[1]


def test_the_table_names_rows_of_the_effect_table() -> None:
    assert set(SUPPORT) <= set(EFFECTS)
    assert all(how in ("exact", "nearly", "missing") for how, _ in SUPPORT.values())


@pytest.mark.parametrize("timestep", [0.0, -1.0, float("nan")])
def test_a_time_step_that_is_none_is_refused(timestep: float) -> None:
    with pytest.raises(ConfigurationError, match="timestep of the export must be finite and > 0 s"):
        to_mujoco(load_joint("orange_80_6000", FIXED), timestep)


def test_a_prismatic_axis_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="prismatic"):
        to_mujoco(load_joint("emps", "rigid"))
