"""The innermost loop as an environment: make the motor's torque follow by commanding voltages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.observation import Row, divisors, observes
from cjt_gym.envs.settings import sampled
from cjt_gym.envs.strip_chart import RENDER_MODES, StripChart
from cjt_gym.errors import ConfigurationError, check_range, unknown_name
from cjt_gym.joint import Joint, load_joint
from cjt_gym.joint.batch import JointBatch
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.configure import EffectSpec
from cjt_gym.joint.kernel.arrays import VOLTS
from cjt_gym.signals import Signal, make_signals

Observation = NDArray[np.float32]
Action = NDArray[np.float32]
SPEED_SHARE, LEVEL_SHARE, HOLD = 0.5, 0.7, 0.01  # the defaults that the class tells
HEAVY = 1e9  # inertia of the load, so that no torque changes the speed [kg m^2]
LABELS = ("reference", "motor torque")
AT_LIMIT = 1.0 - 1e-9  # of the largest current, which the drive itself holds it to


class Observed(NamedTuple):
    """What is observed, in this order."""

    dq_m: Annotated[float, Row("motor velocity", "rad/s", "speed")]
    i_q: Annotated[float, Row("current i_q", "A", "i_p")]
    i_d: Annotated[float, Row("current i_d", "A", "i_p")]
    v_q: Annotated[float, Row("voltage v_q of the last step", "V", "v_0")]
    v_d: Annotated[float, Row("voltage v_d of the last step", "V", "v_0")]
    tau_reference: Annotated[float, Row("reference of the motor's torque", "N m", "peak")]


@observes(Observed)
class CurrentControlEnv(gym.Env[Observation, Action]):
    """Make the torque of a motor follow a reference by commanding its voltages.

    ## Description

    A permanent-magnet machine whose shaft is held at a constant speed by another machine. This is
    the torque control of current-loop benchmarks such as gym-electric-motor's `Cont-TC-PMSM-v0`,
    with the same sample time, reward and end, but with d-q voltages in place of three phases.

    ## Action space

    `Box(-1, 1, (2,), float32)`: the voltages v_q and v_d, divided by the supply v_0. The inverter
    shortens a vector longer than v_0. With drive "rl" there is no d axis; v_d does nothing.

    ## Observation space

    `Box(-2, 2, (6,), float32)`, each number divided by its limit, clipped; `peak` is k_t n i_p.

    {observation}

    ## Reward

    1 - abs(reference - torque) / (2 k_t n i_p), and 0 for the step in which the current reaches its
    limit. This is gym-electric-motor's `WeightedSumOfErrors` with `bias="positive"`: no reward is
    negative, so that no discount makes it worthwhile to end an episode.

    ## Starting state

    No current; a speed drawn between -`speed` and `speed`, and a new reference.

    ## Episode end

    Termination where the current reaches i_p. Truncation after `episode_steps` control steps.

    ## Information

    `tau` and `tau_reference` of the motor [N m], `i_q`, `i_d` [A], `v_q`, `v_d` [V] and `dq_m`
    [rad/s], all on the link side.

    ## Arguments

    | Argument | Default | Meaning |
    |---|---|---|
    | `joint` | "orange_80_6000" | name, path or `Joint` |
    | `drive` | "dq" | "dq" or "rl" |
    | `effects` | () | names or {name: values} |
    | `parameters` | None | parameters that replace those of the joint file |
    | `reference` | random levels | as in `TorqueTrackingEnv`, of the motor's torque |
    | `speed` | half of the no-load speed | largest speed on the link side [rad/s] |
    | `episode_steps` | 1000 | control steps until truncation |
    | `dt_control` | 0.0001 | control step [s] |
    | `dt_physics` | 0.000025 | substep [s], a whole fraction of it |
    | `render_mode` | None | "human" or "rgb_array": a strip chart |

    Without `reference`, levels of at most 70 % of the peak torque are held for 10 ms.

    ## Training

    Full voltage takes the current to its limit within two steps or so, and the windings settle
    within ten. Begin with little exploration and look ahead about as far: PPO of Stable-Baselines3
    with `gamma=0.9`, `gae_lambda=0.9` and `policy_kwargs={"log_std_init": -1.5}`.

    ## Version history

    * v0: first version.

    Raises:
        UnknownNameError: A name is not known; the message suggests the nearest.
        ConfigurationError: A number is out of its range.
        ParameterError: The joint lacks what is asked of it.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 20}  # noqa: RUF012

    def __init__(
        self,
        joint: str | Joint = "orange_80_6000",
        drive: str = "dq",
        effects: EffectSpec = (),
        parameters: Mapping[str, float] | None = None,
        reference: Any = None,
        speed: float | None = None,
        episode_steps: int = 1000,
        dt_control: float = 1e-4,
        dt_physics: float = 2.5e-5,
        render_mode: str | None = None,
    ) -> None:
        if not isinstance(joint, Joint):
            held = {**(parameters or {}), "I_l": HEAVY}
            joint = load_joint(joint, "rigid", drive, effects, held)
        if joint.drive not in ("rl", "dq") or joint.structure != "rigid":
            raise ConfigurationError(
                f"drive of CurrentControlEnv must be 'dq' or 'rl' and structure 'rigid', got "
                f"{joint.drive!r} and {joint.structure!r}."
            )
        check_range("episode_steps", episode_steps, low=1)
        p = joint.parameters
        emf = p.k_t * p.n * (2.0 / 3.0 if joint.drive == "dq" else 1.0)
        self.joint, self.episode_steps, self.render_mode = joint, episode_steps, render_mode
        self._chart = StripChart(render_mode, dt_control, LABELS)
        self.peak = joint.torque_limit
        if not np.isfinite(self.peak):
            raise ConfigurationError(f"i_p [A] of {p.origin} is needed: the limit of the current.")
        self.speed = SPEED_SHARE * p.v_0 / emf if speed is None else float(speed)
        check_range("speed", self.speed, "rad/s", above=0.0)
        self.i_p, self.v_0 = float(p.i_p), float(p.v_0)
        self._divisors = divisors(Observed, self)
        usual = Signal("step", amplitude=LEVEL_SHARE * self.peak, period=HOLD)
        given = sampled(usual if reference is None else reference, episode_steps + 1, dt_control)
        self.references = make_signals(given, usual.amplitude)
        self.batch = JointBatch(joint, 1, dt_control, dt_physics, voltage=True)
        self.observation_space = gym.spaces.Box(-2.0, 2.0, (6,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.reference, self._k = self.references[0], 0

    @property
    def dt(self) -> float:
        """Control step [s]."""
        return float(self.batch.setup.dt)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; there are no options."""
        super().reset(seed=seed)
        for name in options or {}:
            raise unknown_name("reset option", name, ["none"])
        rng, arrays = self.np_random, self.batch.arrays
        self.reference = self.references[int(rng.integers(len(self.references)))].reset(rng)
        arrays.state[0] = [0.0, 0.0, 0.0, *[rng.uniform(-self.speed, self.speed)] * 3]
        self.batch.seed(0, int(rng.integers(2**62)))
        self.batch.restart(np.ones(1, dtype=np.bool_), np.zeros(1))
        self._k = 0
        self._chart.clear()
        return self._observe(), self._info()

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply voltages for one control step.

        Raises:
            ConfigurationError: The action has the wrong shape or is not finite.
            SimulationError: The state ceased to be finite.
        """
        volts = np.clip(checked_array("The action", action, (2,)), -1.0, 1.0) * self.v_0
        self.batch.step(volts[None], np.zeros(1))
        self._k += 1
        info = self._info()
        terminated = bool(np.hypot(info["i_q"], info["i_d"]) >= AT_LIMIT * self.i_p)
        error = abs(info["tau_reference"] - info["tau"]) / (2.0 * self.peak)
        reward = 0.0 if terminated else 1.0 - error
        self._chart.add(info["tau_reference"], info["tau"])
        truncated = self._k >= self.episode_steps and not terminated
        return self._observe(), float(reward), terminated, truncated, info

    def render(self) -> Any:
        """Return the strip chart as an image, shape (height, width, 3), for "rgb_array"."""
        return self._chart.render()

    def close(self) -> None:
        """Close the strip chart."""
        self._chart.close()

    def _info(self) -> dict[str, Any]:
        arrays, p = self.batch.arrays, self.joint.parameters
        i_q, i_d = arrays.currents[0].tolist()
        v_q, v_d = arrays.memory[0, VOLTS : VOLTS + 2].tolist()
        return {
            "tau": p.k_t * p.n * i_q,
            "tau_reference": float(self.reference.torque(self._k * self.dt)),
            "i_q": i_q,
            "i_d": i_d,
            "v_q": v_q,
            "v_d": v_d,
            "dq_m": float(arrays.state[0, 3]),
        }

    def _observe(self) -> Observation:
        info = self._info()
        scaled = np.array([info[name] for name in Observed._fields]) / self._divisors
        return np.clip(scaled, -2.0, 2.0).astype(np.float32)
