"""Actuators in a MuJoCo model move it as the load of a joint, and no energy is lost."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.joint import Joint, load_joint
from cjt_gym.robots import CoupledRobot, load_model

mujoco = pytest.importorskip("mujoco")

FIXED = "output_fixed"
SECONDS = 0.3


def rotor(inertia: float, dt: float) -> Any:
    """Return a model with one hinge that has nothing but an inertia [kg m^2]."""
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{dt}" gravity="0 0 0"/><worldbody><body>'
        '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>'
        f'<joint name="j" axis="0 0 1" armature="{inertia}"/></body></worldbody></mujoco>'
    )


def joint(structure: str, **parameters: float) -> Joint:
    return load_joint("orange_80_6000", structure, effects=[], parameters=parameters)


def torque(dt: float) -> np.ndarray:
    found: np.ndarray = 30.0 * np.sin(4.0 * np.pi * dt * np.arange(round(SECONDS / dt)))
    return found


@cache
def coupled(inertia: float, dt: float, d_gl: float) -> tuple[np.ndarray, float, float]:
    """Return joint torque and load angle, shape (n, 2), and the work given and taken [J]."""
    robot = CoupledRobot(rotor(inertia, dt), {"j": joint(FIXED, I_l=0.0, d_gl=d_gl)})
    port, seen = robot.ports["j"], []
    for command in torque(dt):
        seen.append((port.torque, port.plant.batch.arrays.state[0, 2]))
        robot.step([command])
    return np.array(seen), port.given, port.taken


def error(inertia: float, dt: float, d_gl: float) -> np.ndarray:
    """Return the rms error of torque and load angle over their own rms, shape (2,)."""
    record = joint("full_dynamics", I_l=inertia, d_gl=d_gl).simulate(torque(dt), dt=dt)
    right = np.column_stack([record["true_tau"], record["true_q_l"]])
    miss = coupled(inertia, dt, d_gl)[0] - right
    found: np.ndarray = np.sqrt(np.mean(miss**2, axis=0) / np.mean(right**2, axis=0))
    return found


def test_a_coupled_body_moves_as_the_load_of_the_three_mass_joint() -> None:
    coarse, fine = error(0.3, 1e-3, 0.0), error(0.3, 5e-4, 0.0)
    assert (coarse < 2e-3).all()
    assert (fine < 0.3 * coarse).all()  # the order is two


def test_light_bodies_behind_stiff_dampers_are_stable() -> None:
    """An explicit exchange is unstable above h = 2 I / d_gl, here 0.17 ms."""
    assert error(0.003, 1e-3, 35.0)[1] < 0.01


def test_what_leaves_the_actuator_enters_the_body_to_the_order_of_the_step() -> None:
    gaps = []
    for dt in (1e-3, 5e-4):
        _, given, taken = coupled(0.3, dt, 0.0)
        gaps.append(abs(given - taken))
    assert gaps[0] < 1e-3 * abs(given)
    assert gaps[1] < 0.5 * gaps[0] + 1e-9


def test_work_at_the_port_is_the_energy_of_the_body() -> None:
    robot = CoupledRobot(load_model("arm"), {"elbow": joint(FIXED)})
    robot.reset({"elbow": 0.8})
    start = float(robot.data.energy.sum())
    for _ in range(200):
        robot.step([20.0])
    mujoco.mj_forward(robot.model, robot.data)
    port = robot.ports["elbow"]
    own = 0.5 * (port.inertia - port.plant.joint.parameters.I_l) * robot.data.qvel[0] ** 2
    gained = float(robot.data.energy.sum()) - own - start
    assert gained == pytest.approx(port.taken, abs=0.02)


def test_a_model_that_does_not_fit_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="did you mean|Did you mean 'elbow'"):
        CoupledRobot(load_model("arm"), {"elbo": joint(FIXED)})
    with pytest.raises(ConfigurationError, match="output_fixed"):
        CoupledRobot(load_model("arm"), {"elbow": joint("rigid_gearbox")})
    model = load_model("arm")
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    with pytest.raises(ConfigurationError, match="integrator"):
        CoupledRobot(model, {"elbow": joint(FIXED)})
    with pytest.raises(ConfigurationError, match="one motor torque"):
        CoupledRobot(load_model("arm"), {"elbow": joint(FIXED)}).step([1.0, 2.0])
