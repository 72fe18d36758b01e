"""Linear-quadratic-Gaussian control: quadratic feedback of what a Kalman filter estimates.

    u = n r - k [x^; commands on their way + d^] - d^

The Kalman filter estimates the states and, as a random walk, the torque d that disturbs the
motor; taking d^ off the command is the integral action. It measures the joint torque and the
motor's angle against the load's.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cjt_gym.baselines.entry import FIXED, Gain
from cjt_gym.baselines.linear_law import LinearLaw, assemble
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.observers.kalman import kalman_filter
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.state_feedback import Feedback, quadratic_feedback, reference_and_commands


def observed_law(feedback: Feedback, observer: LinearObserver) -> LinearLaw:
    """Return the law of the module; the observer's first estimates are the states x^.

    The disturbance adds to the commands on their way too, whose gains are those of `feedback`.
    """
    states = dict(zip(observer.names, -feedback.states, strict=False))
    gain = -1.0 - float(np.sum(feedback.commands))
    estimate = observer.block(**states, disturbance=gain)
    return assemble(observer.dt, *reference_and_commands(feedback), estimate)


def lqg_law(model: SampledJoint, effort: float, drift: float) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    feedback = quadratic_feedback(model, effort, 0.0)
    step = drift * float(model.loop.scatter[0])
    return observed_law(feedback, _observer(model, step))


@lru_cache(maxsize=64)
def _observer(model: SampledJoint, step: float) -> LinearObserver:
    return kalman_filter(model, step, step)


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    effort = np.geomspace(0.03, 1e3, 14).tolist()
    return grid(effort=effort, drift=np.geomspace(0.003, 30.0, 12).tolist())


ROW = linear_row(
    name="lqg",
    summary="Linear-quadratic feedback of a Kalman filter's states, disturbance taken off.",
    source="Lewis (1986), Optimal Estimation, Wiley; Franklin, Powell, Workman (1998), Digital "
    "Control of Dynamic Systems, chapter 9",
    tunable=(
        Gain("effort", "-", 1e-3, 1e6, log=True),
        Gain("drift", "-", 1e-4, 1e3, log=True),
    ),
    law=lqg_law,
    candidates=_candidates,
    structures=FIXED,
)
