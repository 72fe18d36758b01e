"""The torque-tracking environment on real joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import HardwareConfig, load_joints
from cjt_gym.canbus.emulated_arm import emulator_of
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.safety import Fault, HardwareFault, check_action
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.foreign import ForeignEpisode
from cjt_gym.envs.observe import Task
from cjt_gym.envs.torque_tracking import Action, Observation
from cjt_gym.errors import ConfigurationError
from cjt_gym.plant import Measurement

SIMULATED = ("joint", "structure", "drive", "effects", "parameters", "randomization")
NEEDED = ("q_m", "dq_m", "dq_l", "tau")
SPREAD = 1000
"""Between the seeds of two joints, so that their references differ."""


class HardwareEnv(gym.Env[Observation, Action]):
    """Make the torques of the real joints of a bus, one or several, follow a reference each.

    ## Description

    The same task as `TorqueTrackingEnv`, on a joint on a CAN bus: the same observation, action,
    reward and information, with measured values where the simulation knows true ones. Joints that
    a configuration lists run in step, with the same task and controller each, and a fault of one
    ends the episode of all.

    Nothing moves unless `arm` is true. Any fault takes the torque away within two control periods,
    switches the drive off and ends the episode with `terminated`; `info["fault"]` says why, and the
    environment cannot be reset afterwards. Use it as a context manager, so that an exception in the
    policy or Ctrl-C does the same at once.

    ## Action space

    `Box(-1, 1, (joints,), float32)`, in the order of the configuration, each as in
    `TorqueTrackingEnv`. An action outside of it is a fault.

    ## Observation space

    As in `TorqueTrackingEnv`; those of several joints one after the other.

    ## Reward

    As in `TorqueTrackingEnv`, from the measured torque; the mean over the joints.

    ## Starting state

    The joint as it is, at rest; `reset` during an episode takes the torque away softly first.

    ## Episode end

    Termination on any fault or safety limit. Truncation after `episode_steps` control steps.

    ## Information

    As in `TorqueTrackingEnv`, and `age` of the motor angle where it was used [s], `lateness` of the
    command behind its deadline [s], and `fault` {kind, text} where one ended the episode. Several
    joints have arrays of shape (joints,) instead of numbers, and `fault` names the `joint`, too.

    ## Arguments

    | Argument | Default | Meaning |
    |---|---|---|
    | `config` | - | path of the hardware configuration, or `HardwareConfig` |
    | `arm` | False | whether the joint may move |
    | `record` | None | file for the record of what happens |
    | `emulated` | False | an emulated joint in this process, in its own time, instead of the bus |
    | `plant` | None | a connected and armed `CanPlant` or `CanArm` instead of all of these |

    and of `TorqueTrackingEnv`: `base_controller`, `reference`, `torque_amplitude`,
    `velocity_scale`, `action_scale`, `preview`, `history`, `episode_steps`, `reward_weights`.
    Joint, structure and control step are those of the configuration; others are not used.

    ## Version history

    * v0: first version.

    Raises:
        ConfigurationError: An argument is not valid, or a channel of the observation is not
            measured.
        HardwareError: The joint does not answer, or cannot be armed.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        config: str | Path | HardwareConfig | None = None,
        arm: bool = False,
        record: str | Path | None = None,
        emulated: bool = False,
        plant: CanPlant | CanArm | None = None,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        if render_mode is not None:
            raise ConfigurationError(f"render_mode must be None, got {render_mode!r}.")
        if (config is None) == (plant is None):
            raise ConfigurationError("Give either config or plant to HardwareEnv.")
        self.render_mode = None
        self.plant = plant or _prepared(config, record, emulated)
        self._arm = self.plant.whole if isinstance(self.plant, CanPlant) else self.plant
        batches = [Episodes(1, **complete_for(arguments, each)) for each in self._arm.configs]
        high = np.concatenate([batch.observation_space.high for batch in batches])
        self.observation_space = spaces.Box(-high, high, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (len(batches),), np.float32)
        self.tasks = [ForeignEpisode(batch) for batch in batches]
        for task in self.tasks:
            task.rehearse()
        if plant is None:
            _connect(self.plant, arm)

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
        for k, task in enumerate(self.tasks):
            own = None if seed is None else seed + SPREAD * k
            task.episodes.seed(own, self.np_random if first else None)
        measured = self._arm.reset()
        for task, config, seen in zip(self.tasks, self._arm.configs, measured, strict=True):
            check_measured(seen, config)
            task.begin(seen)
        return self._observation(), {"parameters": {}}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one control step."""
        wanted = np.asarray(action, dtype=np.float64).reshape(len(self.tasks), 1)
        fault = None
        try:
            self._refuse(wanted)
            pairs = zip(self.tasks, wanted, strict=True)
            commands = np.array([task.choose(one[None])[0] for task, one in pairs])
            references = np.array([task.task.reference[0] for task in self.tasks])
            measured = self._arm.step(commands, references)
            for task, seen in zip(self.tasks, measured, strict=True):
                task.advance(seen)
        except HardwareFault as error:
            fault = error.fault
        for task, joint in zip(self.tasks, self._arm.joints, strict=True):
            task.conclude(joint.sent)
            if fault is not None:
                end_with_fault(task.task)
        told = [task.task for task in self.tasks]
        reward = float(np.mean([one.reward[0] for one in told]))
        ended = any(bool(one.terminated[0]) for one in told)
        timeout = any(bool(one.truncated[0]) for one in told) and not ended
        return self._observation(), reward, ended, timeout, self._info(fault)

    def _refuse(self, action: NDArray[np.float64]) -> None:
        """End the run where an action is out of its range."""
        for k, value in enumerate(action.ravel().tolist()):
            trouble = check_action(value)
            if trouble is not None:
                self._arm.fail(trouble.kind, trouble.text, k)

    def _observation(self) -> Observation:
        return np.concatenate([task.task.observation[0] for task in self.tasks])

    def _info(self, fault: Fault | None) -> dict[str, Any]:
        rows = [
            {**task.info(), "age": joint.age(), "lateness": joint.lateness}
            for task, joint in zip(self.tasks, self._arm.joints, strict=True)
        ]
        several = len(rows) > 1
        info: dict[str, Any] = {
            name: np.array([row[name] for row in rows]) if several else rows[0][name]
            for name in rows[0]
        }
        if fault is not None:
            info["fault"] = {"kind": fault.kind, "text": fault.text}
            if several and self._arm.fault is not None:
                info["fault"]["joint"] = self._arm.fault[0]
        return info

    def close(self) -> None:
        """End the run, at once while an exception is on its way, softly otherwise."""
        self.plant.close()


def end_with_fault(task: Task) -> None:
    """End the episode of a joint as a fault does."""
    task.terminated[:], task.truncated[:] = True, False
    task.reward[:] -= task.weights[-1]
    task.terms[0, -1] = -task.weights[-1]


def _prepared(
    config: str | Path | HardwareConfig | None, record: str | Path | None, emulated: bool
) -> CanPlant | CanArm:
    """Return what runs the joint, or the joints, that a configuration describes."""
    assert config is not None
    configs = [config] if isinstance(config, HardwareConfig) else load_joints(config)
    link = VirtualLink(emulator_of(configs)) if emulated else None
    if len(configs) > 1:
        return CanArm(configs, link, record)
    return CanPlant(configs[0], link, record)


def _connect(plant: CanPlant | CanArm, arm: bool) -> None:
    """Connect, and arm where that is asked for."""
    plant.connect()
    try:
        if arm:
            plant.arm()
    except BaseException:
        plant.close()
        raise


def check_measured(measured: Measurement, config: HardwareConfig) -> None:
    """Raise ConfigurationError if a joint does not measure what an observation needs."""
    missing = [name for name in NEEDED if not np.isfinite(getattr(measured, name)[0])]
    if missing:
        raise ConfigurationError(
            f"The observation needs {', '.join(missing)}, which no node of {config.origin} "
            "reports. Add a sensor."
        )


def complete_for(arguments: dict[str, Any], config: HardwareConfig) -> dict[str, Any]:
    """Return the arguments of the task on a joint."""
    given = {k: v for k, v in arguments.items() if k not in SIMULATED}
    given |= {"joint": config.joint, "structure": config.joint.structure}
    given |= {"dt_control": config.dt, "dt_physics": config.dt, "disturbance": None}
    return given
