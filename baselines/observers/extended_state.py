"""The extended-state observer of a joint, with one number to tune.

The states of the joint and what disturbs the motor are estimated together, with all poles of the
error near one bandwidth: the disturbance, friction and load motion and whatever the model lacks,
is one more state that is taken to be constant.

References:
    Han (2009), From PID to active disturbance rejection control, IEEE Transactions on Industrial
    Electronics 56(3); Gao (2003), Scaling and bandwidth-parameterization based controller tuning,
    American Control Conference.
"""

from __future__ import annotations

from functools import lru_cache

from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.observers.luenberger import spread_observer
from cjt_gym.baselines.observers.model import design_model
from cjt_gym.baselines.plant_model import SampledJoint


def extended_state_observer(model: SampledJoint, bandwidth_hz: float) -> LinearObserver:
    """Return the observer of the states, "tau" and "disturbance" from the joint torque.

    Args:
        model: The joint; its delays are taken into account.
        bandwidth_hz: Where the poles of the error are [Hz].

    Raises:
        ConfigurationError: The joint torque does not show all states, as with a free load.
    """
    return spread_observer(design_model(model, ("tau",), disturbance=True), bandwidth_hz)


@lru_cache(maxsize=64)
def designed(model: SampledJoint, bandwidth_hz: float) -> LinearObserver:
    """Return the observer for its blocks only: laws that try gains share one, with its memory."""
    return extended_state_observer(model, bandwidth_hz)
