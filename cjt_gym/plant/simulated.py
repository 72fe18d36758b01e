"""A batch of simulated joints that take torque commands and give measurements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.joint.batch import DELAYS, JointBatch
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.configure import FIELDS
from cjt_gym.joint.joint import DRIVE_SIGNALS
from cjt_gym.joint.kernel.arrays import CHANNELS, K_M, VOLTS, Batch, Floats, Setup
from cjt_gym.joint.kernel.compiled import compiled
from cjt_gym.joint.kernel.current_loop import with_current_loop
from cjt_gym.joint.kernel.discretize import SCRATCH, discretize
from cjt_gym.joint.kernel.heat import temper
from cjt_gym.joint.outside import is_told, tell_outside
from cjt_gym.plant.measurement import Limits, Measurement
from cjt_gym.plant.randomization import Randomization, resolve_randomization
from cjt_gym.plant.randomization.draw import LINEAR, NOTHING, Draws, Program, refresh, write
from cjt_gym.plant.randomization.program import Plan, compile_plan, exact_plan
from cjt_gym.plant.sampling import warn_of_fast_resonance

DT_CONTROL, DT_PHYSICS = 1e-3, 1e-4  # unless told otherwise [s]
DEFAULT_TORQUE = 1000.0
"""Limit of a joint whose file gives no peak current [N m]: more than any such joint can take."""


@compiled
def redraw_one(
    batch: Batch, setup: Setup, program: Program, draws: Draws, i: int, step: int, scratch: Floats
) -> bool:
    """Draw what is due of joint i, leaving its state alone; return whether anything was.

    `step` counts control steps since its episode began; 0 begins one.
    """
    found = refresh(program, draws, batch.rng, i, step)
    if found == NOTHING and step > 0:
        return False
    write(program, draws, i)
    if found == LINEAR or (step == 0 and program.is_linear):
        discretize(batch.p[i], setup.groups, setup.h, batch.a[i], batch.b[i], scratch)
    temper(batch.p[i], batch.memory[i])
    return True


@compiled
def redraw_some(
    batch: Batch, setup: Setup, program: Program, draws: Draws, mask: NDArray[np.bool_]
) -> None:
    """Draw the parameters of the joints in a mask as a new episode does."""
    scratch = np.empty(SCRATCH)
    for i in range(mask.shape[0]):
        if mask[i]:
            redraw_one(batch, setup, program, draws, i, 0, scratch)


@compiled
def redraw_within(batch: Batch, setup: Setup, program: Program, draws: Draws) -> None:
    """Draw what is due within the episodes, and note for which joints that was."""
    scratch = np.empty(SCRATCH)
    for i in range(draws.changed.shape[0]):
        k = batch.samples[i]
        draws.changed[i] = k > 0 and redraw_one(batch, setup, program, draws, i, k, scratch)


def limits_of(joint: Joint) -> Limits:
    """Return the limits of a joint.

    The motor torque is limited by the peak current; the speed by dq_p; the joint torque by
    twice the peak motor torque. Where the joint file gives no peak current or no peak speed
    they are 1000 N m and the speed is unlimited.
    """
    tau = joint.torque_limit if np.isfinite(joint.torque_limit) else DEFAULT_TORQUE
    return Limits(
        tau=float(tau), dq_m=joint.parameters.get("dq_p", np.inf), tau_joint=2.0 * float(tau)
    )


class SimulatedPlant:
    """`num` simulated joints that take torque commands and give measurements.

    Attributes:
        joint: The nominal joint, whose voltage drive has a current controller; see
            `with_current_loop`.
        num: How many.
        limits: What may be commanded and borne.
        randomization: Every variation, fully spelt out.
        batch: Arrays and compiled steps.
    """

    def __init__(
        self,
        joint: Joint,
        num: int = 1,
        dt: float = DT_CONTROL,
        dt_physics: float = DT_PHYSICS,
        randomization: Randomization = None,
    ) -> None:
        """Prepare `num` joints.

        Args:
            joint: The nominal joint.
            num: How many.
            dt: Control step [s].
            dt_physics: Substep [s]; dt is a whole multiple of it.
            randomization: What varies and how: the name of a preset, or a mapping of names to
                variations; see `resolve_randomization`.

        Raises:
            ConfigurationError: The steps do not fit, or a range is not valid.
            UnknownNameError: A randomised name is not known.

        Warns:
            CjtGymWarning: The joint resonates above the Nyquist frequency of the control step.
        """
        joint = with_current_loop(joint, dt_physics)
        warn_of_fast_resonance(joint, dt)
        self.joint, self.num = joint, num
        self.randomization = resolve_randomization(joint, randomization, dt)
        self._random = compile_plan(joint, self.randomization, dt)
        longest = sum(self._random.delays[name] for name in DELAYS)
        self.batch = JointBatch(joint, num, dt, dt_physics, longest_delay=longest)
        self._p = self._records()
        self._nominal = self._p[0].copy()
        self._random_draws = self._no_draws(self._random)
        self._plan, self._draws = self._random, self._random_draws
        self.limits = limits_of(joint)
        self._torque_per_ampere = joint.parameters.k_t * joint.parameters.n
        self._commands = np.zeros((num, 2))
        self._no_load = np.zeros(num)

    def __repr__(self) -> str:
        count = f"{self.num} joint{'s' * (self.num != 1)}"
        return f"<SimulatedPlant: {count}, dt = {self.dt:g} s, {self.joint!r}>"

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Draw into the records of the copied batch: a copy of a view is an array of its own."""
        self.__dict__.update(state)
        self._p = self._records()
        self._random_draws = self._random_draws._replace(p=self._p)
        self._draws = self._draws._replace(p=self._p)

    def _records(self) -> Floats:
        """Return the parameter records as plain numbers, shape (num, fields); a view."""
        records: Floats = self.batch.arrays.p.view(np.float64).reshape(self.num, -1)
        return records

    def _no_draws(self, plan: Plan) -> Draws:
        """Return the state of a plan before it has drawn anything."""
        rows = plan.program.rows.shape[0]
        values = np.zeros((self.num, rows))
        values[:, : len(plan.names)] = plan.nominal
        return Draws(
            p=self._p,
            nominal=self._nominal,
            scores=np.zeros((self.num, plan.program.sources.shape[0])),
            values=values,
            fresh=np.ones(self.num, dtype=np.bool_),
            changed=np.zeros(self.num, dtype=np.bool_),
        )

    @property
    def dt(self) -> float:
        """Control step [s]."""
        return float(self.batch.setup.dt)

    @property
    def varying(self) -> tuple[Program, Draws]:
        """What varies, for compiled code, and what has been drawn of it."""
        return self._plan.program, self._draws

    @property
    def changed(self) -> NDArray[np.bool_]:
        """Which joints drew parameters within the episode in the last control step, (num,)."""
        return self._draws.changed

    def seed(self, seed: int) -> None:
        """Give joint i the random stream of seed + i."""
        for i in range(self.num):
            self.seed_one(i, seed + i)

    def seed_one(self, i: int, seed: int) -> None:
        """Give joint i the random stream of a seed, and redraw what it draws only once."""
        self.batch.seed(i, seed)
        self._random_draws.fresh[i] = True

    def place(self, quantiles: Floats) -> None:
        """Say where in their ranges the joints lie, from the next reset, instead of drawing that.

        Seeding afterwards forgets it.

        Args:
            quantiles: Of every variation, in the order of `randomization`; in [0, 1], shape
                (num, variations).

        Raises:
            ConfigurationError: The shape or a number is wrong, or a variation is drawn at other
                times than "once", has a group, or is a choice of one value.
        """
        free = all(v.when == "once" and v.group is None for v in self.randomization.values())
        scores, given = self._random_draws.scores, np.asarray(quantiles, dtype=np.float64)
        if not free or scores.shape[1] != len(self.randomization):
            raise ConfigurationError(
                f"Joints of {self.joint.parameters.name} can be placed where every variation has "
                '"when" = "once", no group, and more than one value.'
            )
        if given.shape != scores.shape or not ((given >= 0.0) & (given <= 1.0)).all():
            raise ConfigurationError(
                f"quantiles must be numbers in [0, 1] of shape {scores.shape}, got shape "
                f"{given.shape}."
            )
        scores[:] = given
        self._random_draws.fresh[:] = False

    def fix(self, values: Mapping[str, float] | None) -> None:
        """Give all joints exact parameters instead of randomised ones, from the next reset.

        Args:
            values: Parameters such as "k_b" or "coulomb.d_cm", with their values; those that are
                not named are nominal. None goes back to the randomisation.

        Raises:
            UnknownNameError: A name is not a parameter of the joint or of an active effect.
            ConfigurationError: A value is out of its domain, or a delay too long to be kept.
        """
        if values is None:
            plan, draws = self._random, self._random_draws
        else:
            plan = exact_plan(self.joint, values, self.dt)
            draws = self._no_draws(plan)
        if plan is self._plan:
            return
        longest = (self.batch.arrays.commands.shape[1] - 2) * self.dt
        if plan.longest > longest + 1e-9 * self.dt:
            raise ConfigurationError(
                f"The delays of {self.joint.parameters.name} must be at most {longest:g} s together"
                f", the longest that was set or randomised at the start, got {plan.longest:g} s. "
                "Begin with a randomization that includes the delay."
            )
        self._plan, self._draws = plan, draws
        self._p[:] = self._nominal
        self.batch.discretize()

    def reset(
        self,
        seed: int | None = None,
        mask: NDArray[np.bool_] | None = None,
        start: Floats | None = None,
        load: Floats | None = None,
    ) -> Measurement:
        """Draw new parameters, start the joints in the mask, and measure.

        Args:
            seed: Seed of joint 0; joint i gets seed + i. None continues the streams.
            mask: Which joints, shape (num,); all if absent.
            start: Initial [q_m q_g q_l dq_m dq_g dq_l], shape (num, 6); zero if absent.
            load: Load input at the start, shape (num,); zero if absent.

        Raises:
            ConfigurationError: An array has the wrong shape, or `start` is not finite.
        """
        if seed is not None:
            self.seed(seed)
        if start is None:
            start = np.zeros((self.num, 6))
        else:
            start = checked_array("start", start, (self.num, 6))
        self.restart(self._mask(mask), start, self._load(load))
        return self.measurement()

    def _mask(self, mask: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
        if mask is None:
            return np.ones(self.num, dtype=np.bool_)
        return checked_array("mask", mask, (self.num,), np.bool_)

    def _load(self, load: Floats | None) -> Floats:
        """Return a load; one that is not finite ends in a SimulationError, like any such state."""
        if load is None:
            return self._no_load
        return checked_array("load", load, (self.num,), finite=False)

    def restart(self, mask: NDArray[np.bool_], start: Floats, load: Floats) -> None:
        """Do what `reset` does, without building a measurement."""
        if not is_told(self.joint.file):
            self._look(mask)
        self.redraw(mask)
        self.batch.arrays.state[mask] = start[mask]
        self.batch.restart(mask, load)

    def _look(self, mask: NDArray[np.bool_]) -> None:
        """Say if joints end an episode where the joint was not found."""
        arrays = self.batch.arrays
        ended = mask & (arrays.samples > 0)
        if ended.any():
            speed, torque = arrays.state[ended, 3], arrays.commands[ended, :, 0]
            torque = self._torque_per_ampere * torque
            met = {name: (x.min(), x.max()) for name, x in (("speed", speed), ("torque", torque))}
            tell_outside(self.joint.file, met)

    def redraw(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Draw new parameters for joints, without restarting them.

        Args:
            mask: Which joints, shape (num,); all if absent.

        Raises:
            ConfigurationError: The mask has the wrong shape.
        """
        mask = self._mask(mask)
        if self._plan.program.rows.shape[0] > 0:
            batch, program = self.batch, self._plan.program
            redraw_some(batch.arrays, batch.setup, program, self._draws, mask)
            batch.renew(mask)

    def step(self, command: Floats, load: Floats | None = None) -> Measurement:
        """Command motor torques for one control step; they are clipped to the limits.

        Args:
            command: Motor torque [N m], shape (num,).
            load: Load torque [N m] or load velocity [rad/s], shape (num,); zero if absent.

        Raises:
            ConfigurationError: An array has the wrong shape.
            SimulationError: A state ceased to be finite.
        """
        limit = self.limits.tau
        command = checked_array("command", command, (self.num,), finite=False)
        self.advance(np.clip(command, -limit, limit), self._load(load))
        return self.measurement()

    def advance(self, command: Floats, load: Floats) -> None:
        """Do what `step` does with commands that are within the limits already."""
        self.redraw_within()
        # The current command is computed with the nominal torque constant.
        self._commands[:, 0] = command / self._torque_per_ampere
        self.batch.step(self._commands, load)

    def redraw_within(self) -> None:
        """Draw the parameters that are due within the episodes."""
        if self._plan.within:
            program = self._plan.program
            redraw_within(self.batch.arrays, self.batch.setup, program, self._draws)
            self.batch.renew(self._draws.changed)

    def measurement(self) -> Measurement:
        """Return the latest measurement; its arrays are copies."""
        arrays = self.batch.arrays
        columns = {name: arrays.measured[:, j].copy() for j, name in enumerate(CHANNELS)}
        return Measurement(t=np.asarray(arrays.samples * self.dt, np.float64), **columns)

    def drive_signals(self) -> dict[str, Floats]:
        """Return what the drives do without sensor effects, each of shape (num,).

        That is i_d [A], v and v_d [V], and the motor's torque tau_m [N m]; the torque alone where
        the drive takes currents.
        """
        arrays = self.batch.arrays
        memory, currents = arrays.memory, arrays.currents
        torque = memory[:, K_M] * currents[:, 0]
        if self.joint.drive == "current":
            return {"tau_m": torque}
        columns = currents[:, 1], memory[:, VOLTS], memory[:, VOLTS + 1]
        values = [column.copy() for column in columns]
        return dict(zip(DRIVE_SIGNALS, (*values, torque), strict=True))

    def drawn(self) -> dict[str, Floats]:
        """Return the present values of what is randomised or fixed, by name, each of (num,)."""
        random, plan = self._random, self._plan
        values = {
            name: np.full(self.num, nominal)
            for name, nominal in zip(random.names, random.nominal, strict=True)
        }
        columns = self._draws.values.T
        return values | {n: columns[k].copy() for k, n in enumerate(plan.names)}

    def parameters(self, i: int) -> dict[str, float]:
        """Return the present kernel parameters of joint i, and what is randomised or fixed."""
        values = dict(zip(FIELDS, self._p[i].tolist(), strict=True))
        return values | {name: float(column[i]) for name, column in self.drawn().items()}

    def close(self) -> None:
        """Release nothing: a simulation holds no device."""
