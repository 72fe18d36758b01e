"""The batch of episodes behind every form of the environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from cjt_gym.envs.arguments import TaskArguments, complete
from cjt_gym.envs.handover import table_of
from cjt_gym.envs.observation import CLIP
from cjt_gym.envs.observe import REPORT, TERMS, Task, draw_episodes, make_control
from cjt_gym.envs.settings import ControllerOrFactory, Settings, make_settings
from cjt_gym.envs.step import BAD_ACTION, begin_some, command_all, step_blocks, tell_some
from cjt_gym.envs.threads import side_by_side, threads_for
from cjt_gym.errors import ConfigurationError, unknown_name
from cjt_gym.joint import Joint
from cjt_gym.joint.border import REAL, checked_array
from cjt_gym.joint.kernel.arrays import TAU, Floats
from cjt_gym.plant import Law, Measurement, SimulatedPlant
from cjt_gym.signals import Signal


class Episodes:
    """`num` episodes that advance together; a single environment is a batch of one."""

    def __init__(self, num: int, **arguments: Any) -> None:
        """Prepare the episodes; arguments are those of `TaskArguments`."""
        given = TaskArguments(**complete(arguments))
        self.settings = s = make_settings(given)
        if given.reward is not None and not callable(given.reward):
            raise ConfigurationError(
                f"reward must be a function of what a step reports, got {given.reward!r}."
            )
        self.num, self.reward = num, given.reward
        self.plant = SimulatedPlant(s.joint, num, s.layout.dt, s.dt_physics, s.randomization)
        self.controller = make_base(given.base_controller, s.joint, s.layout.dt)
        self.task = _make_task(s, num, self.plant)
        size = self.task.observation.shape[1]
        self.observation_space = spaces.Box(-CLIP, CLIP, (size,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        limit, per_ampere = self.plant.limits.tau, s.joint.parameters.k_t * s.joint.parameters.n
        self.control = make_control(num, s.layout.action, limit, per_ampere)
        # of the last step, shape (num,) [N m]
        self.base, self.residual = self.control.base, self.control.residual
        self.plant.batch.use_blocks(s.joint, threads_for(num))
        self._connect()
        self._all = np.ones(num, dtype=np.bool_)

    def _connect(self) -> None:
        """Note where the arrays lie, for the compiled step."""
        batch = self.plant.batch
        self._shares: list[tuple[int, ...]] | None = None
        if batch.blocks is not None and batch.kind is not None:
            parts = batch.arrays, batch.setup, batch.kind, batch.blocks, self.task, self.control
            self._table = table_of(*parts)
            count, threads = batch.blocks.rows.shape[0], batch.blocks.scratch.shape[0]
            ends = [round(k * count / threads) for k in range(threads + 1)]
            address = self._table.ctypes.data
            self._shares = [(address, ends[k], ends[k + 1], k) for k in range(threads)]

    def __getstate__(self) -> dict[str, Any]:
        """Leave out where the arrays lie: those of a copy lie elsewhere."""
        return {name: x for name, x in self.__dict__.items() if name not in ("_table", "_shares")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._connect()

    def seed(self, seed: int | None, first: np.random.Generator | None) -> None:
        """Seed episode i with seed + i; without a seed, only the first time, from a generator."""
        if seed is not None:
            self.plant.seed(seed)
        elif first is not None:
            self.plant.seed(int(first.integers(2**62)))

    def reset(self, options: Mapping[str, Any] | None = None) -> None:
        """Restart all episodes.

        The options {"parameters": {name: value}} fix exact parameters, without any randomisation,
        until the next call.
        """
        given = dict(options or {})
        fixed = given.pop("parameters", None)
        if given:
            raise unknown_name("reset option", next(iter(given)), ["parameters"])
        self.plant.fix(fixed)
        self.begin(self._all)

    def begin(self, mask: NDArray[np.bool_]) -> None:
        """Restart the episodes in a mask."""
        draw_episodes(self.plant.batch.arrays.rng, self.task, mask)
        self.plant.restart(mask, self.task.start, self.task.load)
        begin_some(self.plant.batch.arrays, self.task, mask)
        if self.controller is not None:
            self.controller.reset(mask)

    def step(self, action: NDArray[np.floating[Any]]) -> None:
        """Advance all episodes by one control step.

        Actions, shape (num, 1), are clipped to [-1, 1].
        """
        action = np.asarray(action)
        if action.shape != (self.num, 1) or action.dtype.kind not in REAL:
            raise self._bad_action(action)
        self.control.action[:] = action[:, 0]
        self._step()

    def step_or_begin(self, action: NDArray[np.floating[Any]], ended: NDArray[np.bool_]) -> None:
        """Advance by one control step, but restart the episodes that ended in the step before.

        These, `ended` of shape (num,), take no action, and have no reward in this step.
        """
        if not ended.any():
            self.step(action)
            return
        # The kernel steps all; what it draws for those that ended is given back.
        arrays, task = self.plant.batch.arrays, self.task
        streams = arrays.rng[ended].copy()
        arrays.samples[ended] = 0
        self.step(np.where(ended[:, None], 0.0, action))
        arrays.rng[ended] = streams
        self.begin(ended)
        for values in (task.reward, task.terms, self.base, self.residual):
            values[ended] = 0.0
        task.terminated[ended] = task.truncated[ended] = False

    def step_one(self, action: float) -> None:
        """Do what `step` does for a single episode."""
        self.control.action[0] = action
        self._step()

    def _step(self) -> None:
        """Take the actions in `control`."""
        self._before()
        shares = self._shares
        if shares is not None and len(shares) == 1:
            left = step_blocks(*shares[0])
        elif not command_all(self.control):
            left = BAD_ACTION
        else:
            left = self.num if shares is None else side_by_side(step_blocks, shares)
        if left != 0:
            self._rest(left)
        self.take_own_reward()

    def take_own_reward(self, told: Mapping[str, NDArray[Any]] | None = None) -> None:
        """Put the reward of the function that was given, if any, where that of the task stands."""
        if self.reward is None:
            return
        told = self.info() if told is None else told
        given = self.reward({**told, "terminated": self.task.terminated.copy()})
        self.task.reward[:] = checked_array(
            "the return value of the reward function", given, (self.num,)
        )

    def _before(self) -> None:
        """Do what precedes a control step: base controller and parameters that drift."""
        if self.controller is not None:
            reference = self.task.reference.copy()
            self.control.base[:] = self.controller.act(self.plant.measurement(), reference)
        self.plant.redraw_within()

    def _rest(self, left: int) -> None:
        """Step with the general kernel those joints that are left."""
        batch, control = self.plant.batch, self.control
        if left == BAD_ACTION:
            raise self._bad_action(control.action[:, None])
        mask = self._all if batch.blocks is None else batch.blocks.left
        batch.step_some(control.commands, self.task.load, mask)
        tell_some(batch.arrays, self.task, control, mask)

    def _bad_action(self, action: NDArray[np.floating[Any]]) -> ConfigurationError:
        wanted = f"The action must hold {self.num} finite numbers, shape ({self.num}, 1)"
        if action.dtype.kind not in REAL:
            return ConfigurationError(f"{wanted}, got {action.tolist()!r}.")
        odd = "" if np.isfinite(action).all() else " with NaN or inf"
        return ConfigurationError(f"{wanted}, got shape {action.shape}{odd}.")

    def choose(self, action: NDArray[np.floating[Any]], measured: Measurement) -> Floats:
        """Return the motor torques that an action and the base controller command, (num,) [N m].

        The base controller goes by what is measured; actions, shape (num, 1), are clipped to [-1,
        1].
        """
        action = np.asarray(action, dtype=np.float64)
        if action.shape != (self.num, 1) or not np.isfinite(action).all():
            raise self._bad_action(action)
        self.residual[:] = np.clip(action[:, 0], -1.0, 1.0) * self.settings.layout.action
        if self.controller is not None:
            self.base[:] = self.controller.act(measured, self.task.reference.copy())
        limit = self.plant.limits.tau
        return np.clip(self.base + self.residual, -limit, limit)

    def info(self) -> dict[str, Floats]:
        """Return what a step reports, each of shape (num,)."""
        arrays = self.plant.batch.arrays
        return report_of(self, arrays.tau, arrays.measured[:, TAU])


def report_of(episodes: Episodes, tau: Floats, tau_measured: Floats) -> dict[str, Floats]:
    """Return what a step reports with these torques of the joints, each a copy of shape (num,)."""
    task = episodes.task
    reported = (tau, tau_measured, task.reference, task.command, episodes.base, episodes.residual)
    return {name: x.copy() for name, x in zip(REPORT, (*reported, *task.terms.T), strict=True)}


def make_base(given: ControllerOrFactory | None, joint: Joint, dt: float) -> Law | None:
    """Return the controller that actions are added to, None for none."""
    if given is None:
        return None
    if isinstance(given, str):
        from cjt_gym.baselines import make_controller  # laws take long to import

        return make_controller(given, joint, dt)
    made, what = given, "base_controller"
    if callable(given) and not isinstance(given, (type, Law)):
        made, what = given(joint, dt), "The function that is the base_controller"
    if isinstance(made, Law) and not isinstance(made, type):
        return made
    text = f"the class {made.__name__} itself" if isinstance(made, type) else repr(made)
    raise ConfigurationError(
        f"{what} must {'be' if made is given else 'return'} a controller, got {text}. Give an "
        "instance, the name of a controller such as 'pd_feedforward', or a function (joint, dt) -> "
        "controller."
    )


def _make_task(s: Settings, num: int, plant: SimulatedPlant) -> Task:
    layout, limits, size = s.layout, plant.limits, s.layout.size
    observation = np.zeros((num, size + len(layout.joint_numbers)), dtype=np.float32)
    observation[:, size:] = np.clip(layout.joint_numbers, -CLIP, CLIP)  # no step touches these
    reference_tables, reference_spans = _stack(s.references)
    disturbance_tables, disturbance_spans = _stack(s.disturbances)
    return Task(
        reference_rows=np.array([signal.row() for signal in s.references]),
        disturbance_rows=np.array([signal.row() for signal in s.disturbances]),
        reference_tables=reference_tables,
        disturbance_tables=disturbance_tables,
        reference_spans=reference_spans,
        disturbance_spans=disturbance_spans,
        reference_row=np.zeros((num, 6)),
        disturbance_row=np.zeros((num, 6)),
        picks=np.zeros((num, 2), dtype=np.int64),
        keys=np.zeros((num, 2), dtype=np.uint64),
        start=np.zeros((num, 6)),
        load=np.zeros(num),
        reference=np.zeros(num),
        command=np.zeros(num),
        observation=observation,
        reward=np.zeros(num),
        terms=np.zeros((num, len(TERMS))),
        terminated=np.zeros(num, dtype=np.bool_),
        truncated=np.zeros(num, dtype=np.bool_),
        weights=np.array([s.reward_weights[name] for name in TERMS]),
        divisors=layout.divisors,
        amplitude=layout.torque,
        most_speed=limits.dq_m,
        most_torque=limits.tau_joint,
        dt=layout.dt,
        n=layout.n,
        size=size,
        episode_steps=s.episode_steps,
        preview=layout.preview,
    )


def _stack(signals: tuple[Signal, ...]) -> tuple[Floats, NDArray[np.int64]]:
    """Put the tables of all signals below each other; return them and their first and last rows."""
    ends = np.cumsum([len(signal.table) for signal in signals])
    starts = np.concatenate([[0], ends[:-1]])
    return np.concatenate([s.table for s in signals]), np.column_stack([starts, ends])
