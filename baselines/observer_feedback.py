"""State feedback by pole placement, on a Luenberger observer.

    u = n r - k [x^; commands on their way + d^] - d^

The joint's torsional mode, its two slowest poles, goes to a natural frequency and damping that are
asked for; a mode of the gearbox stays where it is. A Luenberger observer on the joint torque alone
estimates the states and the torque d that disturbs the motor, with its poles near one bandwidth.
"""

from __future__ import annotations

import numpy as np

from cjt_gym.baselines.entry import FIXED, Gain
from cjt_gym.baselines.linear_law import LinearLaw
from cjt_gym.baselines.linear_row import linear_row
from cjt_gym.baselines.lqg import observed_law
from cjt_gym.baselines.observers.extended_state import designed
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.state_feedback import placed_feedback


def observer_feedback_law(
    model: SampledJoint, bandwidth_hz: float, damping: float, observer_hz: float
) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    w = 2.0 * np.pi * bandwidth_hz
    mode = w * complex(-damping, np.sqrt(1.0 - damping**2))
    feedback = placed_feedback(model, [mode, mode.conjugate(), *_others(model)])
    return observed_law(feedback, designed(model, observer_hz))


def _others(model: SampledJoint) -> list[complex]:
    """Return the joint's poles without the torsional pair, or without the two slowest."""
    poles, mode = sorted(model.torque.poles, key=abs), model.torsion
    if mode.imag == 0.0:
        return poles[2:]
    near = 1e-6 * abs(mode)
    return [p for p in poles if min(abs(p - mode), abs(p - mode.conjugate())) > near]


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    mode = model.torsion
    own, ratio = abs(mode) / (2.0 * np.pi), min(max(-mode.real / abs(mode), 0.01), 0.9)
    rows = []
    for speed in (1.0, 1.15, 1.3, 1.6):
        for damping in (ratio, 0.1, 0.2, 0.3, 0.5, 0.7):
            for observer in (0.02, 0.1, 0.4, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0):
                estimate = min(observer * own, 0.2 / model.dt)
                row = {"bandwidth_hz": speed * own, "damping": damping, "observer_hz": estimate}
                rows.append(row)
    return rows


ROW = linear_row(
    name="observer_feedback",
    summary="State feedback by pole placement on a Luenberger observer, disturbance taken off.",
    source="Luenberger (1971), IEEE Transactions on Automatic Control 16(6); Astrom, Wittenmark "
    "(1997), Computer-Controlled Systems, chapter 4",
    tunable=(
        Gain("bandwidth_hz", "Hz", 0.5, 300.0, log=True),
        Gain("damping", "-", 0.01, 0.95),
        Gain("observer_hz", "Hz", 0.1, 250.0, log=True),
    ),
    law=observer_feedback_law,
    candidates=_candidates,
    structures=FIXED,
)
