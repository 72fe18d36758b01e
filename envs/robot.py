"""The environment of robots whose joints are moved by compliant actuators, in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from cjt_gym.envs.core import make_base
from cjt_gym.envs.observation import CLIP, Row, divisors, observes
from cjt_gym.errors import ConfigurationError, check_range, unknown_name
from cjt_gym.joint import Joint, load_joint
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant import Law, Measurement
from cjt_gym.plant.randomization import Randomization
from cjt_gym.robots import CoupledRobot, get_robot, load_model
from cjt_gym.robots.models import mujoco

Observation = NDArray[np.float32]
ERROR_SCALE, SPEED_SCALE = 0.5, 5.0  # that of a large one [rad], [rad/s]
PERIODS = (1.0, 3.0)  # of the wanted sines, which legs and arms can follow [s]
SMOOTHNESS = 0.05  # weight in the reward, as in `TorqueTrackingEnv`


class Observed(NamedTuple):
    """What is observed of the actuators, in this order, each of shape (actuators,)."""

    q: Annotated[Floats, Row("measured load angle", "rad", math.pi)]
    error: Annotated[Floats, Row("wanted angle minus it", "rad", ERROR_SCALE)]
    rate: Annotated[Floats, Row("wanted velocity", "rad/s", SPEED_SCALE)]
    dq: Annotated[Floats, Row("measured load velocity", "rad/s", SPEED_SCALE)]
    tau: Annotated[Floats, Row("measured joint torque", "N m", "action_scale")]
    action: Annotated[Floats, Row("action before", "-")]


@observes(Observed)
class RobotEnv(gym.Env[Observation, NDArray[np.float32]]):
    """Make the actuated joints of a robot follow angles, through their springs.

    ## Description

    The bodies are MuJoCo's, the actuators `cjt_gym.robots.CoupledRobot`. `CJT/Arm-v0` is one link
    under gravity, `CJT/Leg-v0` a leg that squats on a vertical rail.

    ## Action space

    `Box(-1, 1, (actuators,), float32)`: motor torques divided by `action_scale` or, with a
    `base_controller`, the joint torques that it is asked for.

    ## Observation space

    `Box(-5, 5, (6 actuators,), float32)`, for each actuator in turn, divided by its scale and
    clipped:

    {observation}

    ## Reward

    -mean(abs(e)) / 0.5 rad - 0.05 mean((a - a before)^2), e the error of the true angles and a the
    action; 50 less if the episode terminates.

    ## Starting state

    At rest at the wanted angles, with relaxed springs. The wanted angles are sines between the
    robot's limits, with random periods of 1 to 3 s and random phases.

    ## Episode end

    Termination: the joint torque or the motor speed of an actuator exceeds its limits, or the
    trunk falls. Truncation: after `episode_steps`.

    ## Information

    Each step gives `q`, `q_wanted` [rad], `tau`, `tau_command` [N m], shape (actuators,).

    ## Arguments

    | Argument | Default | Meaning |
    |---|---|---|
    | `robot` | "arm" | "arm" or "leg" |
    | `joint` | "orange_80_6000" | name, path or `Joint` with a fixed output, for all actuators |
    | `effects` | None | as in `TorqueTrackingEnv` |
    | `randomization` | None | as for `CJT/TorqueTracking-v0` |
    | `base_controller` | None | name of a controller, gain file, or function (joint, dt) -> one |
    | `action_scale` | 60 | torque of an action of 1 [N m] |
    | `decimation` | 5 | time steps of 1 ms per action |
    | `episode_steps` | 600 | actions until truncation |
    | `render_mode` | None | "rgb_array" |

    ## Version history

    * v0: first version.

    Raises:
        UnknownNameError: A name is not known; the message suggests the nearest.
        ConfigurationError: A number is out of its range, or MuJoCo is not installed.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 200}  # noqa: RUF012

    def __init__(
        self,
        robot: str = "arm",
        joint: str | Joint = "orange_80_6000",
        effects: Any = None,
        randomization: Randomization = None,
        base_controller: str | Callable[[Joint, float], Law] | None = None,
        action_scale: float = 60.0,
        decimation: int = 5,
        episode_steps: int = 600,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise unknown_name("render mode", str(render_mode), ["rgb_array"])
        check_range("action_scale", action_scale, "N m", above=0.0)
        check_range("decimation", decimation, low=1)
        check_range("episode_steps", episode_steps, low=1)
        if not isinstance(joint, Joint):
            joint = load_joint(joint, "output_fixed_rigid_gearbox", effects=effects)
        self.robot = get_robot(robot)
        names = list(self.robot.posture)
        self.coupled = CoupledRobot(
            load_model(robot), dict.fromkeys(names, joint), randomization=randomization
        )
        if len(names) > 1 and isinstance(base_controller, Law):
            raise ConfigurationError(
                f"base_controller of a robot with {len(names)} actuators must be the name of a "
                "controller or a function (joint, dt) -> controller, which makes one for each, got "
                f"{base_controller!r}."
            )
        made = [make_base(base_controller, joint, self.coupled.dt) for _ in names]
        self.controllers = [controller for controller in made if controller is not None]
        self.action_scale, self.decimation = action_scale, decimation
        self.episode_steps, self.render_mode = episode_steps, render_mode
        self.action_space = spaces.Box(-1.0, 1.0, (len(names),), np.float32)
        self._divisors = divisors(Observed, self)
        size = len(names) * len(self._divisors)
        self.observation_space = spaces.Box(-CLIP, CLIP, (size,), np.float32)
        self._renderer: Any = None
        span = np.array(list(self.robot.posture.values()))
        self._middle, self._half = span.mean(axis=1), 0.5 * np.diff(span)[:, 0]
        self._omega, self._phase = np.zeros(len(names)), np.zeros(len(names))
        self._steps, self._before = 0, np.zeros(len(names))
        self._measured: list[Measurement] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; there are no options."""
        super().reset(seed=seed)
        if options:
            raise unknown_name("reset option", next(iter(options)), [])
        size = len(self._middle)
        self._omega = 2.0 * math.pi / self.np_random.uniform(*PERIODS, size)
        self._phase = self.np_random.uniform(0.0, 2.0 * math.pi, size)
        self._steps, self._before = 0, np.zeros(size)
        start = dict(zip(self.robot.posture, self._wanted()[0].tolist(), strict=True))
        drawn = int(self.np_random.integers(2**31))
        self._measured = self.coupled.reset({**self.robot.start, **start}, drawn)
        for controller in self.controllers:
            controller.reset()
        return self._observe(), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by `decimation` time steps.

        Raises:
            ConfigurationError: The action has the wrong shape or is not finite.
            SimulationError: A state ceased to be finite.
        """
        chosen = np.clip(checked_array("The action", action, self._before.shape), -1.0, 1.0)
        command = self.action_scale * chosen
        for _ in range(self.decimation):
            command = self._command(self.action_scale * chosen)
            self._measured = self.coupled.step(command)
        self._steps += 1
        ports = self.coupled.ports.values()
        q = np.array([float(port.plant.batch.arrays.state[0, 2]) for port in ports])
        tau = np.array([port.torque for port in ports])
        wanted = self._wanted()[0]
        reward = -float(np.mean(np.abs(wanted - q))) / ERROR_SCALE
        reward -= SMOOTHNESS * float(np.mean((chosen - self._before) ** 2))
        self._before = chosen
        terminated = self._failed(tau)
        truncated = self._steps >= self.episode_steps
        info = {"q": q, "q_wanted": wanted, "tau": tau, "tau_command": command}
        return self._observe(), reward - 50.0 * terminated, terminated, truncated, info

    def _command(self, asked: Floats) -> Floats:
        """Return the motor torques [N m] for what the action asks for."""
        if not self.controllers:
            return asked
        rows = zip(self.controllers, self._measured, asked, strict=True)
        return np.array([float(law.act(m, np.array([tau]))[0]) for law, m, tau in rows])

    def _wanted(self) -> tuple[Floats, Floats]:
        angle = self._omega * self._steps * self.decimation * self.coupled.dt + self._phase
        return (
            self._middle + self._half * np.sin(angle),
            self._half * self._omega * np.cos(angle),
        )

    def _failed(self, tau: Floats) -> bool:
        for port, torque in zip(self.coupled.ports.values(), tau.tolist(), strict=True):
            limits = port.plant.limits
            speed = abs(float(port.plant.batch.arrays.state[0, 3]))
            if abs(torque) > limits.tau_joint or speed > limits.dq_m:
                return True
        lowest = self.robot.lowest
        return lowest is not None and float(self.coupled.data.body("trunk").xpos[2]) < lowest

    def _observe(self) -> Observation:
        wanted, rate = self._wanted()
        m = self._measured
        q, dq = np.array([[float(k.q_l[0]), float(k.dq_l[0])] for k in m]).T
        tau = np.array([float(k.tau[0]) for k in m])
        seen = np.stack(Observed(q, wanted - q, rate, dq, tau, self._before), axis=1)
        return np.clip(seen / self._divisors, -CLIP, CLIP).ravel().astype(np.float32)

    def render(self) -> Any:
        """Return a picture, shape (640, 960, 3), for "rgb_array"."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            self._renderer = mujoco().Renderer(self.coupled.model, 640, 960)
        self._renderer.update_scene(self.coupled.data)
        return self._renderer.render()

    def close(self) -> None:
        """Release the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
