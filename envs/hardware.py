"""The torque-tracking environment on a real joint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from cjt_gym.canbus.config import HardwareConfig, load_hardware
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.safety import HardwareFault, State, check_action
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.foreign import advance_on, begin_on, conclude_on
from cjt_gym.envs.torque_tracking import Action, Observation, complete
from cjt_gym.errors import ConfigurationError
from cjt_gym.plant import Measurement

SIMULATED = ("joint", "structure", "drive", "effects", "parameters", "randomization")
NEEDED = ("q_m", "dq_m", "dq_l", "tau")


class HardwareEnv(gym.Env[Observation, Action]):
    """Make the torque of a real compliant joint follow a reference.

    ## Description

    The same task as `TorqueTrackingEnv`, on a joint on a CAN bus: the same observation, action,
    reward and information, with measured values where the simulation knows true ones.

    Nothing moves unless `arm` is true. Any fault takes the torque away within two control periods,
    switches the drive off and ends the episode with `terminated`; `info["fault"]` says why, and the
    environment cannot be reset afterwards. Use it as a context manager, so that an exception in the
    policy or Ctrl-C does the same at once.

    ## Action space

    `Box(-1, 1, (1,), float32)`, as in `TorqueTrackingEnv`. An action outside of it is a fault.

    ## Observation space

    As in `TorqueTrackingEnv`.

    ## Reward

    As in `TorqueTrackingEnv`, from the measured torque.

    ## Starting state

    The joint as it is, at rest; `reset` during an episode takes the torque away softly first.

    ## Episode end

    Termination on any fault or safety limit. Truncation after `episode_steps` control steps.

    ## Information

    As in `TorqueTrackingEnv`, and `age` of the motor angle where it was used [s], `lateness` of the
    command behind its deadline [s], and `fault` {kind, text} where one ended the episode.

    ## Arguments

    | Argument | Default | Meaning |
    |---|---|---|
    | `config` | - | path of the hardware configuration, or `HardwareConfig` |
    | `arm` | False | whether the joint may move |
    | `record` | None | file for the record of what happens |
    | `emulated` | False | an emulated joint in this process, in its own time, instead of the bus |
    | `plant` | None | a connected and armed `CanPlant` instead of all of these |

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
        plant: CanPlant | None = None,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        if render_mode is not None:
            raise ConfigurationError(f"render_mode must be None, got {render_mode!r}.")
        if (config is None) == (plant is None):
            raise ConfigurationError("Give either config or plant to HardwareEnv.")
        self.render_mode = None
        if plant is None:
            assert config is not None
            plant = _connected(config, arm, record, emulated)
        self.plant = plant
        self.episodes = Episodes(1, **complete_for(arguments, plant.config))
        self.observation_space = self.episodes.observation_space
        self.action_space = self.episodes.action_space
        self._rehearse()

    def _rehearse(self) -> None:
        """Do once what a step computes, so that nothing is compiled while the joint runs."""
        self.episodes.reset()
        command = self.episodes.choose(np.zeros((1, 1)))
        conclude_on(self.episodes, command)
        self.episodes.info()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; a seed draws the reference.

        Raises:
            HardwareError: The joint is not armed, or ended with a fault.
        """
        first = self._np_random is None
        super().reset(seed=seed)
        if options:
            raise ConfigurationError(f"The hardware environment has no options, got {options}.")
        episodes = self.episodes
        episodes.seed(seed, self.np_random if first else None)
        measured = self.plant.reset()
        check_measured(measured, self.plant.config)
        begin_on(episodes, measured)
        return episodes.task.observation[0].copy(), {"parameters": {}}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one control step."""
        episodes, task = self.episodes, self.episodes.task
        info: dict[str, Any] = {}
        wanted = float(np.asarray(action, dtype=np.float64).reshape(-1)[0])
        try:
            trouble = check_action(wanted)
            if trouble is not None:
                self.plant.fail(trouble.kind, trouble.text)
            command = episodes.choose(np.array([[wanted]]))
            measured = self.plant.step(command, float(task.reference[0]))
            advance_on(episodes, measured)
        except HardwareFault as error:
            info["fault"] = {"kind": error.fault.kind, "text": error.fault.text}
        conclude_on(episodes, np.array([self.plant.sent]))
        if "fault" in info:
            task.terminated[:], task.truncated[:] = True, False
            task.reward[:] -= task.weights[-1]
            task.terms[0, -1] = -task.weights[-1]
        told = {name: float(values[0]) for name, values in episodes.info().items()}
        info = told | {"age": self.plant.age(), "lateness": self.plant.lateness} | info
        reward = float(task.reward[0])
        ended = bool(task.terminated[0])
        return task.observation[0].copy(), reward, ended, bool(task.truncated[0]), info

    def close(self) -> None:
        """End the run, at once while an exception is on its way, softly otherwise."""
        self.plant.close()


def _connected(
    config: str | Path | HardwareConfig, arm: bool, record: str | Path | None, emulated: bool
) -> CanPlant:
    """Return a connected plant, armed where that is asked for."""
    if not isinstance(config, HardwareConfig):
        config = load_hardware(config)
    link = VirtualLink(Emulator(config)) if emulated else None
    plant = CanPlant(config, link, record)
    plant.connect()
    try:
        if arm:
            plant.arm()
    except BaseException:
        plant.close()
        raise
    assert plant.state in (State.IDLE, State.ARMED)
    return plant


def check_measured(measured: Measurement, config: HardwareConfig) -> None:
    """Check that a joint measures what an observation needs.

    Raises:
        ConfigurationError: It does not.
    """
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
    return complete(given)
