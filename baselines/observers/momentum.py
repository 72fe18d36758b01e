"""The generalised-momentum observer of what acts on the motor beside its command.

    p = I_m dq_m + I_g dq_g,   d' = bandwidth (u - tau - d - p')

so that the estimate d is the torque that opposes the motor (friction at positive speed is
positive), seen through a first-order low pass; no acceleration is needed. In discrete time, with
w = 2 pi bandwidth and q = exp(-w dt), exact for a command held over a sample,

    s[k+1] = q s[k] + (1 - q) (u[k - delay] - tau[k] + w_q p[k]),   d[k] = s[k] - w_q p[k],
    w_q = (1 - q) / dt

Viscous friction counts as disturbance.

References:
    De Luca, Mattone (2003), Actuator failure detection and isolation using generalized momenta,
    ICRA; Le Tien, Albu-Schaeffer, De Luca, Hirzinger (2008), Friction observer and compensation
    for control of robots with joint torque measurement, IROS.
"""

from __future__ import annotations

import math

import numpy as np

from cjt_gym.baselines.linear_law import COMMAND, SIGNALS, signals
from cjt_gym.baselines.mechanics import with_commands
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError


def momentum_observer(model: SampledJoint, bandwidth_hz: float) -> LinearObserver:
    """Return the observer of "disturbance" [N m].

    Args:
        model: The joint; its delays are taken into account.
        bandwidth_hz: Of the estimate, > 0 and below the Nyquist frequency [Hz].

    Raises:
        ConfigurationError: The bandwidth is out of range.
    """
    dt = model.dt
    if not 0.0 < bandwidth_hz < 0.5 / dt:
        raise ConfigurationError(
            f"bandwidth_hz of the momentum observer must be in (0, {0.5 / dt:g}) Hz, got "
            f"{bandwidth_hz}."
        )
    p = model.joint.parameters
    momentum = signals(dq_m=p.I_m, dq_g=p.get("I_g", 0.0))
    keep = math.exp(-2.0 * math.pi * bandwidth_hz * dt)
    rate = (1.0 - keep) / dt
    late = model.loop.delay
    a, head = with_commands(np.array([[keep]]), np.array([1.0 - keep]), late)
    b = np.zeros((1 + late, len(SIGNALS)))
    b[0] = (1.0 - keep) * (rate * momentum - signals(tau=1.0))
    b[:, COMMAND] = head
    c = np.eye(1, 1 + late)
    return LinearObserver(a, b, c, -rate * momentum[None], ("disturbance",), dt)
