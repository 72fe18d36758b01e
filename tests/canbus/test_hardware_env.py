"""The environment of a real joint has the spaces of the simulated one, and its safety."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
import pytest

import cjt_gym
from cjt_gym.baselines import make_controller
from cjt_gym.canbus.safety import HardwareFault, State
from cjt_gym.disk import to_toml
from cjt_gym.envs.hardware import HardwareEnv
from cjt_gym.errors import ConfigurationError, HardwareError
from cjt_gym.records import read_record
from tests.canbus.bench import config, document
from tests.canbus.test_bus_load import joints, listed

assert cjt_gym.__version__
SENSORS = {"torque": {"protocol": "dbc", "file": "torque_sensor"}}


def test_is_registered_with_the_spaces_of_the_simulation(tmp_path: Path) -> None:
    path = tmp_path / "joint.toml"
    path.write_text(to_toml(document()))
    env = gymnasium.make("CJT/Hardware-v0", config=path, arm=True, emulated=True)
    simulated = gymnasium.make("CJT/OutputFixedRigidGearbox-v0")
    assert env.observation_space == simulated.observation_space
    assert env.action_space == simulated.action_space
    observation, _ = env.reset(seed=1)
    wanted, _ = simulated.reset(seed=1)
    assert observation[0] == wanted[0]  # the same seed draws the same reference
    for _ in range(10):
        observation, reward, terminated, truncated, info = env.step(np.zeros(1, np.float32))
        assert env.observation_space.contains(observation)
        assert not terminated
        assert not truncated
    _, _, _, _, told = simulated.step(np.zeros(1, np.float32))
    assert set(told) <= set(info)
    terms = sum(value for name, value in info.items() if name.startswith("reward/"))
    assert reward == pytest.approx(terms)
    env.close()


def test_controller_under_it_tracks_as_in_simulation() -> None:
    def base(joint: object, dt: float) -> object:
        return make_controller("pd_feedforward", joint, dt)  # type: ignore[arg-type]

    given = config(sensors=SENSORS, control={"rate_hz": 1000})
    arguments = {"base_controller": base, "reference": "smooth", "episode_steps": 400}
    real = HardwareEnv(given, arm=True, emulated=True, **arguments)
    simulated = gymnasium.make("CJT/TorqueTracking-v0", effects=["noise"], **arguments)
    errors = []
    for env in (real, simulated):
        env.reset(seed=3)
        squares = []
        for k in range(400):
            _, _, terminated, truncated, info = env.step(np.zeros(1, np.float32))
            if k >= 150:  # behind the soft start
                squares.append((info["tau_reference"] - info["tau"]) ** 2)
            assert not terminated
        assert truncated
        errors.append(np.sqrt(np.mean(squares)))
        env.close()
    assert errors[0] == pytest.approx(errors[1], rel=0.5)


def test_fault_ends_the_episode_and_stays() -> None:
    env = HardwareEnv(config(), arm=True, emulated=True)
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.zeros(1, np.float32))
    _, reward, terminated, truncated, info = env.step(np.array([1.5], np.float32))
    assert terminated
    assert not truncated
    assert info["fault"]["kind"] == "command"
    assert reward < -40.0
    assert info["tau_command"] == 0.0
    assert env.plant.state is State.FAULT
    with pytest.raises(HardwareError, match="must be armed"):
        env.reset()
    env.close()


def test_exception_within_takes_the_torque_away(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    env = HardwareEnv(config(), arm=True, emulated=True, record=path)
    wrapped = gymnasium.wrappers.TimeLimit(env, 1000)

    def run() -> None:
        with wrapped:
            wrapped.reset(seed=0)
            for k in range(20):
                wrapped.step(np.array([0.5 / (10 - k)], np.float32))

    with pytest.raises(ZeroDivisionError):
        run()
    assert env.plant.joint.guard.fault is not None
    assert env.plant.joint.guard.fault.kind == "exception"
    record = read_record(path)
    assert record.provenance["fault"]["kind"] == "exception"
    assert len(record) == 11
    assert record["tau_cmd"][-1] == 0.0


def test_unarmed_and_wrong_arguments() -> None:
    env = HardwareEnv(config(), emulated=True)
    with pytest.raises(HardwareError, match="must be armed"):
        env.reset()
    env.close()
    with pytest.raises(ConfigurationError, match="either config or plant"):
        HardwareEnv()
    with pytest.raises(ConfigurationError, match="argument"):
        HardwareEnv(config(), emulated=True, episode_step=5)
    free = config(joint={"structure": "full_dynamics"}, sensors=SENSORS)
    env = HardwareEnv(free, arm=True, emulated=True)
    with pytest.raises(ConfigurationError, match="observation needs dq_l"):
        env.reset()
    env.close()
    assert issubclass(HardwareFault, HardwareError)


def test_joints_of_a_list_are_one_environment_with_an_action_each(tmp_path: Path) -> None:
    path, out = tmp_path / "arm.toml", tmp_path / "run.csv"
    path.write_text(listed(joints("cia402", "moteus", "cia402")))
    make = {"config": path, "arm": True, "emulated": True, "record": out, "reference": "smooth"}

    def base(joint: object, dt: float) -> object:
        return make_controller("open_loop", joint, dt)  # type: ignore[arg-type]

    with gymnasium.make("CJT/Hardware-v0", base_controller=base, **make) as env:
        assert env.action_space.shape == (3,)
        observation, _ = env.reset(seed=4)
        assert env.observation_space.contains(observation)
        for _ in range(100):
            observation, reward, terminated, _, info = env.step(np.zeros(3, np.float32))
            assert env.observation_space.contains(observation)
            assert not terminated
        assert np.isfinite(reward)
        assert info["tau_reference"].shape == (3,)
        assert len(set(info["tau_reference"].tolist())) == 3
        _, _, terminated, truncated, info = env.step(np.array([0.0, 1.5, 0.0]))
        assert terminated
        assert not truncated
        assert (info["fault"]["kind"], info["fault"]["joint"]) == ("command", "joint_1")
        assert info["tau_command"].tolist() == [0.0] * 3
    record = read_record(out)
    assert len(record) > 100
    assert record.provenance["fault"]["kind"] == "command"
