"""A batch of simulated joints behind the Plant contract."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint import Joint
from cjt_gym.joint.arrays import CHANNELS, WORK_ROWS, WORK_WIDTH, Batch, Setup
from cjt_gym.joint.batch import DELAYS, JointBatch
from cjt_gym.joint.compiled import compiled
from cjt_gym.joint.configure import FIELDS
from cjt_gym.joint.discretize import discretize
from cjt_gym.joint.kernel import restart
from cjt_gym.plant.measurement import Limits, Measurement
from cjt_gym.plant.randomization import compile_draws, fields_of, redraw

Floats = NDArray[np.float64]
DT_CONTROL, DT_PHYSICS = 1e-3, 1e-4
DEFAULT_TORQUE = 1000.0


@compiled
def renew(
    batch: Batch,
    setup: Setup,
    p: Floats,
    nominal: Floats,
    rows: Floats,
    mask: NDArray[np.bool_],
    start: Floats,
    load: Floats,
) -> None:
    """Redraw, rediscretise and restart the joints in a mask."""
    work = np.zeros((WORK_ROWS, WORK_WIDTH))
    for i in range(mask.shape[0]):
        if mask[i]:
            if rows.shape[0] > 0:
                redraw(p, nominal, rows, batch.rng, i)
                discretize(batch.p[i], setup.groups, setup.h, batch.a[i], batch.b[i])
            batch.state[i] = start[i]
            restart(batch, setup, i, load[i], work)


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
        joint: The nominal joint.
        num: How many.
        batch: Arrays and compiled steps.
    """

    def __init__(
        self,
        joint: Joint,
        num: int = 1,
        dt: float = DT_CONTROL,
        dt_physics: float = DT_PHYSICS,
        randomization: Mapping[str, Any] | None = None,
    ) -> None:
        """Prepare `num` joints.

        Args:
            joint: The nominal joint.
            num: How many.
            dt: Control step [s].
            dt_physics: Substep [s]; dt is a whole multiple of it.
            randomization: What each reset draws anew, see `Variation`.

        Raises:
            ConfigurationError: The steps do not fit, or a range is not valid.
            UnknownNameError: A randomised name is not known.
        """
        self.joint, self.num = joint, num
        self.rows = compile_draws(joint, randomization)
        self.batch = JointBatch(
            joint, num, dt, dt_physics, longest_delay=self._longest_delay(joint)
        )
        self._p = self.batch.arrays.p.view(np.float64).reshape(num, -1)
        self._nominal = self._p[0].copy()
        self._limits = limits_of(joint)
        self._torque_per_ampere = joint.parameters.k_t * joint.parameters.n
        self._commands = np.zeros((num, 2))
        self._no_load = np.zeros(num)
        self._randomization = dict(randomization or {})

    def _longest_delay(self, joint: Joint) -> float:
        record, _ = joint.packed()
        total = 0.0
        for name in DELAYS:
            value = float(record[name][0])
            for row in self.rows:
                if FIELDS[int(row[0])] == name:
                    value = (row[2], value * row[2], value + row[2])[int(row[4])]
            total += value
        return total

    @property
    def dt(self) -> float:
        """Control step [s]."""
        return float(self.batch.setup.dt)

    @property
    def limits(self) -> Limits:
        """What may be commanded and borne."""
        return self._limits

    def seed(self, seed: int) -> None:
        """Give joint i the random stream of seed + i."""
        for i in range(self.num):
            self.batch.seed(i, seed + i)

    def set_nominal(self, values: Mapping[str, float]) -> None:
        """Fix exact parameters for all joints; randomised ones vary around them.

        Args:
            values: Parameters such as "k_b" or "coulomb.d_cm", with their values.

        Raises:
            UnknownNameError: A name is not a parameter of the joint or of an active effect.
        """
        record, _ = self.joint.packed()
        for name, value in values.items():
            fields, relative_to = fields_of(self.joint, name)
            offset = float(record[relative_to][0]) if relative_to else 0.0
            for field in fields:
                self._nominal[FIELDS.index(field)] = float(value) - offset
        self._p[:] = self._nominal
        self.batch.discretize()

    def reset(
        self,
        seed: int | None = None,
        mask: NDArray[np.bool_] | None = None,
        start: Floats | None = None,
        load: Floats | None = None,
    ) -> Measurement:
        """Draw parameters anew, start the joints in the mask, and measure.

        Args:
            seed: Seed of joint 0; joint i gets seed + i. None goes on with the streams.
            mask: Which joints, shape (num,); all if absent.
            start: Initial [q_m q_g q_l dq_m dq_g dq_l], shape (num, 6); zero if absent.
            load: Load input at the start, shape (num,); zero if absent.
        """
        if seed is not None:
            self.seed(seed)
        mask = np.ones(self.num, dtype=np.bool_) if mask is None else mask
        start = np.zeros((self.num, 6)) if start is None else start
        self.restart(mask, start, self._no_load if load is None else load)
        return self.measurement()

    def restart(self, mask: NDArray[np.bool_], start: Floats, load: Floats) -> None:
        """Do what `reset` does, without building a measurement."""
        batch = self.batch
        renew(batch.arrays, batch.setup, self._p, self._nominal, self.rows, mask, start, load)

    def step(self, command: Floats, load: Floats | None = None) -> Measurement:
        """Command motor torques for one control step; they are clipped to the limits.

        Args:
            command: Motor torque [N m], shape (num,).
            load: Load torque [N m] or load velocity [rad/s], shape (num,); zero if absent.

        Raises:
            SimulationError: A state ceased to be finite.
        """
        limit = self._limits.tau
        self.advance(np.clip(command, -limit, limit), self._no_load if load is None else load)
        return self.measurement()

    def advance(self, command: Floats, load: Floats) -> None:
        """Do what `step` does with commands that are within the limits already."""
        # The drive is told a current by someone who knows the nominal torque constant.
        self._commands[:, 0] = command / self._torque_per_ampere
        self.batch.step(self._commands, load)

    def measurement(self) -> Measurement:
        """Return the latest measurement; its arrays are copies."""
        arrays = self.batch.arrays
        columns = {name: arrays.measured[:, j].copy() for j, name in enumerate(CHANNELS)}
        return Measurement(t=np.asarray(arrays.samples * self.dt, np.float64), **columns)

    def parameters(self, i: int) -> dict[str, float]:
        """Return the present parameters of joint i by their names."""
        values = dict(zip(FIELDS, self._p[i].tolist(), strict=True))
        drawn = {name: values[name] for name in FIELDS}
        for name in self._randomization:
            fields, relative_to = fields_of(self.joint, name)
            drawn[name] = values[fields[0]] + (values[relative_to] if relative_to else 0.0)
        return drawn

    def close(self) -> None:
        """Release nothing: a simulation holds no device."""
