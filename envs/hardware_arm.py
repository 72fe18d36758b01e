"""The torque-tracking environment on several real joints of one bus."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import load_joints
from cjt_gym.canbus.emulated_arm import EmulatedArm
from cjt_gym.canbus.safety import HardwareFault, check_action
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.foreign import advance_on, begin_on, conclude_on
from cjt_gym.envs.hardware import HardwareEnv, check_measured, complete_for
from cjt_gym.envs.torque_tracking import Action, Observation
from cjt_gym.errors import ConfigurationError

SPREAD = 1000
"""Between the seeds of two joints, so that their references differ."""


def make_hardware(config: Any = None, **arguments: Any) -> gym.Env[Observation, Action]:
    """Return the environment of the joint, or of the joints, that a configuration describes.

    Args:
        config: Path of the hardware configuration, or a `HardwareConfig`.
        **arguments: Those of `HardwareEnv`.
    """
    if isinstance(config, str | Path) and len(load_joints(config)) > 1:
        return HardwareArmEnv(config, **arguments)
    return HardwareEnv(config, **arguments)


class HardwareArmEnv(gym.Env[Observation, Action]):
    """Make the torques of several real joints follow a reference each.

    ## Description

    As `HardwareEnv`, for a configuration that lists joints: they run in step, and a fault of one
    ends the episode of all.

    ## Action space

    `Box(-1, 1, (joints,), float32)`, in the order of the configuration.

    ## Observation space

    The observations of the joints one after the other.

    ## Reward

    The mean of the joints' rewards.

    ## Information

    That of `HardwareEnv`, with an array of shape (joints,) where it has a number; `fault` names the
    `joint`, too.

    ## Arguments

    Those of `HardwareEnv` but `plant`; tasks and controllers are the same for all joints.

    ## Version history

    * v0: first version.

    Raises:
        ConfigurationError: An argument is not valid, or a channel of the observation is not
            measured.
        HardwareError: A joint does not answer, or cannot be armed.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        config: str | Path,
        arm: bool = False,
        record: str | Path | None = None,
        emulated: bool = False,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        if render_mode is not None:
            raise ConfigurationError(f"render_mode must be None, got {render_mode!r}.")
        self.render_mode = None
        configs = load_joints(config)
        self.tasks = [Episodes(1, **complete_for(arguments, each)) for each in configs]
        sizes = [task.observation_space.shape[0] for task in self.tasks]
        low = np.concatenate([task.observation_space.low for task in self.tasks])
        self.observation_space = spaces.Box(low, -low, (sum(sizes),), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (len(configs),), np.float32)
        self.arm = CanArm(configs, VirtualLink(EmulatedArm(configs)) if emulated else None, record)
        for task in self.tasks:  # what is compiled on first use is compiled now
            task.reset()
            conclude_on(task, task.choose(np.zeros((1, 1))))
            task.info()
        self.arm.connect()
        try:
            if arm:
                self.arm.arm()
        except BaseException:
            self.arm.close()
            raise

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; a seed draws the references.

        Raises:
            HardwareError: A joint is not armed, or ended with a fault.
        """
        first = self._np_random is None
        super().reset(seed=seed)
        if options:
            raise ConfigurationError(f"The hardware environment has no options, got {options}.")
        measured = self.arm.reset()
        for k, (task, seen) in enumerate(zip(self.tasks, measured, strict=True)):
            check_measured(seen, self.arm.configs[k])
            task.seed(
                None if seed is None else seed + SPREAD * k, self.np_random if first else None
            )
            begin_on(task, seen)
        return self._observation(), {"parameters": {}}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one control step."""
        wanted = np.asarray(action, dtype=np.float64).reshape(len(self.tasks))
        fault: dict[str, str] | None = None
        try:
            for value in wanted.tolist():
                trouble = check_action(value)
                if trouble is not None:
                    self.arm.fail(trouble.kind, trouble.text)
            pairs = list(zip(self.tasks, wanted.tolist(), strict=True))
            commands = [float(task.choose(np.array([[value]]))[0]) for task, value in pairs]
            references = np.array([float(task.task.reference[0]) for task in self.tasks])
            for task, seen in zip(
                self.tasks, self.arm.step(np.array(commands), references), strict=True
            ):
                advance_on(task, seen)
        except HardwareFault as error:
            name = self.arm.fault[0] if self.arm.fault else ""
            fault = {"joint": name, "kind": error.fault.kind, "text": error.fault.text}
        for task, joint in zip(self.tasks, self.arm.joints, strict=True):
            conclude_on(task, np.array([joint.sent]))
            if fault is not None:
                task.task.terminated[:], task.task.truncated[:] = True, False
                task.task.reward[:] -= task.task.weights[-1]
                task.task.terms[0, -1] = -task.task.weights[-1]
        return self._observation(), *self._ended(), self._info(fault)

    def _ended(self) -> tuple[float, bool, bool]:
        """Return reward, and whether any joint's episode is terminated or truncated."""
        tasks = [task.task for task in self.tasks]
        reward = float(np.mean([task.reward[0] for task in tasks]))
        ended = any(bool(task.terminated[0]) for task in tasks)
        return reward, ended, any(bool(task.truncated[0]) for task in tasks) and not ended

    def _info(self, fault: dict[str, str] | None) -> dict[str, Any]:
        told = [task.info() for task in self.tasks]
        info: dict[str, Any] = {
            name: np.array([float(one[name][0]) for one in told]) for name in told[0]
        }
        info["age"] = np.array([joint.age() for joint in self.arm.joints])
        info["lateness"] = np.array([joint.lateness for joint in self.arm.joints])
        return info if fault is None else info | {"fault": fault}

    def _observation(self) -> Observation:
        return np.concatenate([task.task.observation[0] for task in self.tasks])

    def close(self) -> None:
        """End the run, at once while an exception is on its way, softly otherwise."""
        self.arm.close()
