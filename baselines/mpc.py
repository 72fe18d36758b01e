"""Model-predictive control of the joint torque within the limit of the command.

    min over u_0 .. u_{N-1} of  sum (c x_i - r)^2 + effort (u_i + d^ - u_r)^2 + V(x_N - x_r)
    x_{i+1} = a x_i + b (u_i + d^),   |u_i| <= limit

x_0 is the state at which the joint will be once the commands on their way have arrived, predicted
from the Kalman filter of `cjt_gym.baselines.lqg`, with the disturbance d^; x_r and u_r hold the
reference; V is the cost of going on without limits (Riccati). So where no limit acts the answer is
that of `lqg`, which is taken without solving anything; elsewhere OSQP solves the quadratic program
of each joint that a limit concerns.

References:
    Rawlings, Mayne, Diehl (2017), Model Predictive Control, Nob Hill, chapters 1 and 2; Stellato,
    Banjac, Goulart, Bemporad, Boyd (2020), OSQP: an operator splitting solver for quadratic
    programs, Mathematical Programming Computation 12.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.sparse import csc_matrix

from cjt_gym.baselines import lqg
from cjt_gym.baselines.controller import Controller, Floats, Mask, check, check_sampling
from cjt_gym.baselines.entry import FIXED, ControllerEntry, Gains
from cjt_gym.baselines.observers.kalman import kalman_filter
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement, limits_of

HORIZON = 20
"""Samples ahead, 20 ms at 1 kHz; more take time in every control step."""
PRECISION = 1e-7
"""Of the quadratic program, below what a sensor resolves; a coarser one shows as noise."""


@final
@dataclass(eq=False)
class ModelPredictive(Controller):
    """Model-predictive control; see the module."""

    model: SampledJoint
    effort: float  # weight of the command against the torque, > 0 [-]
    drift: float  # of the Kalman filter, see `lqg_law`, > 0 [-]
    torque_limit: float  # largest motor torque that is commanded [N m]
    dt: float = field(init=False)

    def __post_init__(self) -> None:
        self.dt = self.model.dt
        check_sampling(self)
        check(self, "effort", "", above=0.0)
        check(self, "drift", "", above=0.0)
        self.linear = lqg.lqg_law(self.model, self.effort, self.drift)
        step = self.drift * float(self.model.loop.scatter[0])
        self._observer = kalman_filter(self.model, step, step)
        self._sent = np.zeros((0, 0))
        self._solver: Any = None
        self._plan()

    def _plan(self) -> None:
        """Write down the program: its Hessian, its slope per error, the answer without limits."""
        plant, n = self.model.mechanics, HORIZON
        a, b, c = plant.a, plant.b, plant.row("tau")
        q = np.outer(c, c)
        p = solve_discrete_are(a, b[:, None], q, np.array([[self.effort]]))
        free = np.array([np.linalg.matrix_power(a, i) for i in range(n + 1)])
        forced = np.zeros((n + 1, len(b), n))
        for i in range(1, n + 1):
            forced[i, :, :i] = np.array([free[i - 1 - j] @ b for j in range(i)]).T
        weight = np.array([q] * n + [p])
        self._hessian = np.einsum("ixj,ixy,iyk->jk", forced, weight, forced)
        self._hessian += self.effort * np.eye(n)
        self._slope = np.einsum("ixj,ixy,iyz->jz", forced, weight, free)
        self._free_answer = -np.linalg.solve(self._hessian, self._slope)
        self._rest = np.linalg.solve(np.eye(len(b)) - a, b)
        self._hold = 1.0 / float(c @ self._rest)
        late = self.model.loop.delay
        self._ahead = free[late] if late <= n else np.linalg.matrix_power(a, late)
        powers = [np.linalg.matrix_power(a, i) @ b for i in range(late)]
        self._arriving = np.array(powers).reshape(late, len(b))

    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        late, order = self.model.loop.delay, len(self._rest)
        if len(self._sent) != len(fresh):
            self._sent = np.tile(measurement.tau[:, None], late + 1)
        self._sent = np.where(fresh[:, None], measurement.tau[:, None], self._sent)
        estimate = np.array(
            list(self._observer.step(measurement, self._sent[:, 0], fresh).values())
        )
        disturbance = estimate[order]
        arriving = (self._sent[:, :late] + disturbance[:, None]) @ self._arriving
        held = self._hold * reference
        error = estimate[:order].T @ self._ahead.T + arriving - held[:, None] * self._rest
        shift = held - disturbance
        planned = error @ self._free_answer.T + shift[:, None]
        for i in np.flatnonzero(np.abs(planned).max(axis=1) > self.torque_limit):
            planned[i, 0] = self._solve(error[i], float(shift[i])) + shift[i]
        limited = np.clip(planned[:, 0], -self.torque_limit, self.torque_limit)
        self._sent = np.column_stack([limited, self._sent[:, :-1]])
        return np.asarray(limited)

    def _solve(self, error: Floats, shift: float) -> float:
        """Return the first command of the limited program, counted from the shift [N m]."""
        slope = self._slope @ error
        low = np.full(HORIZON, -self.torque_limit - shift)
        high = np.full(HORIZON, self.torque_limit - shift)
        if self._solver is None:
            self._solver = _make_solver(self._hessian, slope, low, high)
        else:
            self._solver.update(q=slope, l=low, u=high)
        # The start is the same whatever was solved before, so that the answer is too.
        start = np.clip(self._free_answer @ error, low, high)
        self._solver.warm_start(x=start, y=np.zeros(HORIZON))
        answer = self._solver.solve(raise_error=False)
        return float(np.clip(answer.x[0], low[0], high[0]))


def _make_solver(hessian: Floats, slope: Floats, low: Floats, high: Floats) -> Any:
    import osqp

    solver = osqp.OSQP()
    upper, every = csc_matrix(np.triu(hessian)), csc_matrix(np.eye(len(slope)))
    options = {"verbose": False, "adaptive_rho": False, "polishing": True, "max_iter": 10_000}
    precision = {"eps_abs": PRECISION, "eps_rel": PRECISION}
    solver.setup(P=upper, q=slope, A=every, l=low, u=high, **options, **precision)
    return solver


def _build(joint: Joint, dt: float, gains: Gains) -> Controller:
    if importlib.util.find_spec("osqp") is None:
        raise ConfigurationError('Controller mpc needs osqp: pip install "cjt-gym[control]".')
    limit = limits_of(joint).tau
    return ModelPredictive(SampledJoint(joint, dt), gains["effort"], gains["drift"], limit)


ROW = ControllerEntry(
    name="mpc",
    summary="Model-predictive: linear-quadratic with a Kalman filter, within the command's limit.",
    source="Rawlings, Mayne, Diehl (2017), Model Predictive Control, Nob Hill; Stellato et al. "
    "(2020), OSQP, Mathematical Programming Computation 12",
    tunable=lqg.ROW.tunable,
    defaults=lqg.ROW.defaults,
    build=_build,
    structures=FIXED,
)
