"""Run an agent over a batch of episodes and keep what happened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines import Controller
from cjt_gym.baselines.gains import Choice, choose
from cjt_gym.envs.core import Episodes
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import DQ_L, Q_L, TAU, Floats
from cjt_gym.records import Record
from cjt_gym.signals import Signal
from cjt_gym.training.evaluation.conditions import Conditions
from cjt_gym.training.evaluation.tasks import Rendering, Setting, get_task

STILL = 3
"""Episodes with a still output for one in which it is moved."""


@dataclass(frozen=True)
class Traces:
    """What a batch of episodes did; each array has the shape (episodes, steps).

    Sample k is what holds at the end of control step k.
    """

    reference: Floats  # wanted joint torque [N m]
    tau: Floats  # joint torque without sensor effects [N m]
    tau_measured: Floats  # measured joint torque [N m]
    command: Floats  # motor torque commanded during the step [N m]
    terminated: NDArray[np.bool_]  # whether the episode passed a safety limit at that step
    dt: float  # control step [s]

    @classmethod
    def of_record(cls, record: Record, command: Floats) -> Traces:
        """Return a record as an episode, with its commanded motor torque [N m]."""
        wanted, tau = record["tau_ref"][None, 1:], record["tau"][None, 1:]
        ended = np.zeros(tau.shape, dtype=np.bool_)
        return cls(wanted, tau, tau, command[None, :-1], ended, record.dt)

    @property
    def t(self) -> Floats:
        """Time at the end of each step [s], shape (steps,)."""
        return self.dt * np.arange(1, self.tau.shape[1] + 1)

    @property
    def error(self) -> Floats:
        """Reference minus torque [N m], shape (episodes, steps)."""
        return self.reference - self.tau


class Agent(Protocol):
    """Whatever drives a joint: a controller of the table or a trained policy."""

    @property
    def name(self) -> str:
        """Its name in tables."""
        ...

    @property
    def kind(self) -> str:
        """One of "classical", "learned", "residual"."""
        ...

    @property
    def renders(self) -> bool:
        """Whether it renders a spring and a damper of its own, instead of following a torque."""
        ...

    @property
    def trained_on(self) -> tuple[str, str] | None:
        """Joint and structure that it was trained on; None if it was not trained."""
        ...

    def arguments(self, conditions: Conditions) -> dict[str, Any]:
        """Return the environment's arguments under which it runs."""
        ...

    def begin(self) -> None:
        """Begin a batch of episodes: forget the past, where any is remembered."""
        ...

    def act(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Return the actions for observations, shape (episodes, 1)."""
        ...


@dataclass(frozen=True)
class ControllerAgent:
    """A controller of the table with its default gains, or one from a gain file."""

    word: str | Choice  # what `choose` takes, or a `Choice`
    _made: dict[str, Controller] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.word, Choice):
            object.__setattr__(self, "word", choose(self.word))

    @property
    def choice(self) -> Choice:
        """The controller and its gains."""
        assert isinstance(self.word, Choice)
        return self.word

    @property
    def name(self) -> str:
        """Name of the controller, or of the gain file without its ending."""
        return self.choice.name

    @property
    def kind(self) -> str:
        """What the table says."""
        return self.choice.entry.kind

    @property
    def renders(self) -> bool:
        """What the table says."""
        return self.choice.entry.renders

    @property
    def trained_on(self) -> None:
        """None: it was not trained."""
        return None

    def rendering(self, rendering: Rendering) -> ControllerAgent:
        """Return a copy whose gains are the spring and the damper that it has to render."""
        asked = {"stiffness": rendering.stiffness, "damping": rendering.damping}
        return ControllerAgent(replace(self.choice, gains={**self.choice.gains, **asked}))

    def arguments(self, conditions: Conditions) -> dict[str, Any]:
        """Return the conditions with the controller as base."""
        return conditions.arguments | self.base()

    def base(self) -> dict[str, Any]:
        """Return the argument that makes the controller the base of an environment."""
        return {"base_controller": self._make}

    def _make(self, joint: Joint, dt: float) -> Controller:
        """Return the controller; the last one, reset, where it is for the same joint again.

        Some designs take seconds, and an evaluation runs the same joint many times in a row.
        """
        key = f"{joint.file.hash_hex()} {joint.structure} {joint.drive} {joint.effects} {dt}"
        if key not in self._made:
            self._made.clear()
            self._made[key] = self.choice.make(joint, dt)
        self._made[key].reset()
        return self._made[key]

    def begin(self) -> None:
        """Nothing is remembered here; the environment resets its controller."""

    def act(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Return zeros: the controller acts alone."""
        return np.zeros((observation.shape[0], 1))


def rollout(
    agent: Agent, conditions: Conditions, reference: Signal, steps: int, num: int, seed: int
) -> Traces:
    """Run an agent over `num` episodes of `steps` control steps, the same for every agent.

    Joint i draws its parameters, its reference and its noise from seed + i, whatever controls it.
    """
    arguments = agent.arguments(conditions) | {"reference": reference, "episode_steps": steps}
    return run_episodes(agent, arguments, num, seed)


def joint_of(conditions: Conditions) -> Joint:
    """Return the joint of the conditions, with the load that environments give it."""
    return Episodes(1, **conditions.arguments).settings.joint


def run_task(agent: Agent, setting: Setting, num: int, seed: int) -> Traces:
    """Run an agent over `num` episodes of a task of the benchmark."""
    steps = round(setting.duration / setting.conditions.dt_control)
    if agent.renders and setting.rendering is not None:
        assert isinstance(agent, ControllerAgent)
        agent = agent.rendering(setting.rendering)
    arguments = agent.arguments(setting.conditions)
    arguments |= {"reference": setting.reference, "episode_steps": steps}
    if setting.load is not None:
        arguments["disturbance"] = setting.load
    more = setting.from_zero, setting.rendering, setting.of_motor
    return run_episodes(agent, arguments, num, seed, *more)


def run_mixed(
    agent: Agent,
    conditions: Conditions,
    joint: Joint,
    tasks: Sequence[str],
    steps: int,
    num: int,
    seed: int,
) -> tuple[Traces, NDArray[np.int64]]:
    """Run an agent over `num` episodes of `steps` control steps that each draw one of the tasks.

    If `load_motion` is the last of them, one episode of four is one of its kind. So all run side by
    side, in as many control steps as one does.

    Returns:
        What happened, and the index of the task of every episode, shape (num,).
    """
    settings = [get_task(task).setting(conditions, joint) for task in tasks]
    references = [setting.reference for setting in settings if setting.load is None]
    arguments = agent.arguments(conditions) | {"reference": references, "episode_steps": steps}
    if len(references) < len(tasks):
        arguments["disturbance"] = ["zero"] * STILL + [settings[-1].load]
    episodes = Episodes(num, **arguments)
    episodes.plant.seed(seed)
    traces = drive(agent, episodes)
    reference, load = episodes.task.picks.T
    return traces, np.where(load < STILL, reference, len(references))


def run_episodes(
    agent: Agent,
    arguments: Mapping[str, Any],
    num: int,
    seed: int,
    from_zero: bool = False,
    rendering: Rendering | None = None,
    of_motor: bool = False,
) -> Traces:
    """Run an agent over `num` episodes of the environment with these arguments, to their end.

    An episode that passes a safety limit continues, so that all have the same length; `terminated`
    marks it.

    Episode i has seed + i. With `from_zero` all bodies start at an angle of zero. A `rendering` is
    a spring and damper that replace the reference: the agent is asked for their torque by the
    measured motion, unless it renders them by itself; what counts is their torque by the true
    motion. With `of_motor` the motor's torque is kept instead of the joint's.
    """
    episodes = Episodes(num, **arguments)
    episodes.plant.seed(seed)
    return drive(agent, episodes, from_zero, rendering, of_motor)


def drive(
    agent: Agent,
    episodes: Episodes,
    from_zero: bool = False,
    rendering: Rendering | None = None,
    of_motor: bool = False,
) -> Traces:
    """Begin seeded episodes and run an agent over them, to their end; see `run_episodes`."""
    num = episodes.num
    episodes.reset()
    agent.begin()
    task, arrays = episodes.task, episodes.plant.batch.arrays
    if from_zero:
        task.start[:] = 0.0
        episodes.plant.restart(np.ones(num, dtype=np.bool_), task.start, task.load)
    shape = (num, episodes.settings.episode_steps)
    wanted, tau, measured, command = (np.zeros(shape) for _ in range(4))
    ended = np.zeros(shape, dtype=np.bool_)
    rest = arrays.state[:, 2].copy()
    for k in range(shape[1]):
        if rendering is not None and not agent.renders:
            angle, rate = arrays.measured[:, Q_L] - rest, arrays.measured[:, DQ_L]
            task.reference[:] = -rendering.stiffness * angle - rendering.damping * rate
        episodes.step(agent.act(task.observation.copy()))
        wanted[:, k], tau[:, k] = task.reference, arrays.tau
        if rendering is not None:
            angle, rate = arrays.state[:, 2] - rest, arrays.state[:, 5]
            wanted[:, k] = -rendering.stiffness * angle - rendering.damping * rate
        measured[:, k] = arrays.measured[:, TAU]
        if of_motor:
            tau[:, k] = measured[:, k] = episodes.plant.drive_signals()["tau_m"]
        command[:, k], ended[:, k] = task.command, task.terminated
    return Traces(wanted, tau, measured, command, ended, episodes.settings.layout.dt)
