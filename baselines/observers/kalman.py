"""Kalman filters of a joint: the steady one, and the one whose gain follows its covariance.

    x^[k] = x-[k] + m[k] (y[k] - c x-[k]),   x-[k+1] = a x^[k] + b u[k - delay]
    m = p c' (c p c' + r)^-1,   p+ = a (1 - m c) p a' + q

(a, b) is the joint sampled with a zero-order hold. Process noise is a white motor torque, held
over a sample, and, where a disturbance is estimated, its random walk; q follows from them. r has
the variances of the outputs, each in its own unit.

References:
    Kalman (1960), A new approach to linear filtering and prediction problems, Journal of Basic
    Engineering 82(1); Lewis (1986), Optimal Estimation, Wiley, chapter 2.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_discrete_are

from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.baselines.linear_law import stack
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.observers.model import DesignModel, current_observer, design_model
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError
from cjt_gym.plant import Measurement

OUTPUTS = ("tau", "q_m")


def kalman_filter(
    model: SampledJoint,
    torque_noise: float,
    drift: float = 0.0,
    outputs: tuple[str, ...] = OUTPUTS,
) -> LinearObserver:
    """Return the steady Kalman filter.

    Args:
        model: The joint; its sensors' noise and its delays are taken into account.
        torque_noise: Standard deviation of the motor torque's noise, per sample, >= 0 [N m].
        drift: Standard deviation of the disturbance's step per sample, >= 0; 0 estimates no
            disturbance [N m].
        outputs: Measured signals; see `design_model`, and for their noise `output_noise`.

    Raises:
        ConfigurationError: The outputs do not show all states, or the noise is negative or all
            zero.
    """
    made, q, r = noise_model(model, torque_noise, drift, outputs)
    return current_observer(made, steady_gain(made, q, r))


def noise_model(
    sampled: SampledJoint, torque_noise: float, drift: float, outputs: tuple[str, ...]
) -> tuple[DesignModel, Floats, Floats]:
    """Return model, process covariance (order, order) and measurement covariance (outputs,)*2."""
    if not (torque_noise >= 0.0 and drift >= 0.0 and torque_noise + drift > 0.0):
        raise ConfigurationError(
            "torque_noise and drift of a Kalman filter must be >= 0 N m and one of them > 0, got "
            f"{torque_noise} and {drift}."
        )
    model = design_model(sampled, outputs, disturbance=drift > 0.0)
    q = torque_noise**2 * np.outer(model.b, model.b)
    if drift > 0.0:
        q[-1, -1] += drift**2
    return model, q, np.diag(model.noise**2)


def steady_gain(model: DesignModel, q: Floats, r: Floats) -> Floats:
    """Return the steady gain m, shape (order, outputs)."""
    unit = np.sqrt(np.diag(r))  # measured in units of their noise, the equation is well scaled
    c = model.c / unit[:, None]
    p = solve_discrete_are(model.a.T, c.T, q, np.eye(len(unit)))
    return np.asarray(np.linalg.solve(c @ p @ c.T + np.eye(len(unit)), c @ p).T / unit)


@dataclass(eq=False)
class TimeVaryingKalman:
    """The Kalman filter whose gain begins at an uncertain start and settles.

    All joints of a batch share noise and model; each has its own covariance, because each may
    begin at another time.

    Attributes:
        sampled: The joint.
        torque_noise: See `kalman_filter` [N m].
        drift: See `kalman_filter` [N m].
        start: Standard deviations of the states at the start, shape (order,); the noise-free
            states at the start are taken to be zero.
        outputs: Measured signals.
    """

    sampled: SampledJoint
    torque_noise: float
    drift: float
    start: Floats
    outputs: tuple[str, ...] = OUTPUTS
    model: DesignModel = field(init=False)

    def __post_init__(self) -> None:
        self.model, self._q, self._r = noise_model(
            self.sampled, self.torque_noise, self.drift, self.outputs
        )
        if self.start.shape != self.model.b.shape:
            raise ConfigurationError(
                f"start must have the shape {self.model.b.shape} of the states "
                f"{', '.join(self.model.states)}, got {self.start.shape}."
            )
        self._x = np.zeros((0, len(self.model.b)))
        self._p = np.zeros((0, *self._q.shape))
        self._sent = np.zeros((0, self.model.delay + 1))

    def step(self, measurement: Measurement, command: Floats, fresh: Mask) -> dict[str, Floats]:
        """Return the estimates at this sample, each of shape (n,)."""
        m, n = self.model, len(command)
        if len(self._x) != n:
            fresh = np.ones(n, dtype=np.bool_)
            self._x, self._sent = np.zeros((n, len(m.b))), np.zeros((n, m.delay + 1))
            self._p = np.zeros((n, *self._q.shape))
        self._sent = np.column_stack([command, self._sent[:, :-1]])
        predicted = self._x @ m.a.T + self._sent[:, -1:] * m.b
        spread = m.a @ self._p @ m.a.T + self._q
        self._sent[fresh] = 0.0
        predicted = np.where(fresh[:, None], 0.0, predicted)
        spread = np.where(fresh[:, None, None], np.diag(self.start**2), spread)
        y = m.rows @ stack(measurement, np.zeros(n))
        innovation = y.T - predicted @ m.c.T
        into = spread @ m.c.T
        total = m.c @ into + self._r
        gain = np.linalg.solve(total, np.swapaxes(into, 1, 2))
        self._x = predicted + np.einsum("nji,nj->ni", gain, innovation)
        self._p = spread - into @ gain
        self._p = 0.5 * (self._p + np.swapaxes(self._p, 1, 2))
        found = dict(zip(m.states, self._x.T, strict=True))
        return found | {f"innovation_{k}": v for k, v in zip(m.outputs, innovation.T, strict=True)}
