"""Linear-quadratic control of the joint torque with integral action, all states measured.

    u = n r - k [x; commands on their way] - k_i z,   z[k+1] = z[k] + dt (tau - r)

with the gains that minimise the sum of (tau - r)^2 + reset^2 z^2 + effort (u - r)^2 for the joint
sampled with a zero-order hold and its delay. The states x are deflections and velocities against
the load's, as measured. The load's own position is no state: the motor could not move it.
"""

from __future__ import annotations

import numpy as np

from cjt_gym.baselines.entry import FIXED, Gain
from cjt_gym.baselines.linear_law import LinearLaw, assemble, integrator, static
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.state_feedback import (
    measured_states,
    quadratic_feedback,
    reference_and_commands,
)


def lqi_law(model: SampledJoint, effort: float, reset: float) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    feedback = quadratic_feedback(model, effort, reset)
    states = static()
    states.d[:] = -feedback.states @ measured_states(model)
    direct = feedback.reference_gain
    integral = integrator(feedback.integral, model.dt, direct, reference=1.0, tau=-1.0)
    return assemble(model.dt, *reference_and_commands(feedback), states, integral)


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    effort = np.geomspace(0.03, 1e4, 18).tolist()
    return grid(effort=effort, reset=(0.5, 2.0, 6.0, 15.0, 30.0, 60.0, 120.0))


ROW = linear_row(
    name="lqi",
    summary="Linear-quadratic with integral, from measured deflections and velocities.",
    source="Franklin, Powell, Workman (1998), Digital Control of Dynamic Systems, chapter 9",
    tunable=(
        Gain("effort", "-", 1e-3, 1e6, log=True),
        Gain("reset", "1/s", 0.01, 1e3, log=True),
    ),
    law=lqi_law,
    candidates=_candidates,
    structures=FIXED,
)
