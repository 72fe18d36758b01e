"""What a joint reports, what it can take, and what commands it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.arrays import Floats


@dataclass(frozen=True)
class Measurement:
    """One sample of every measured channel of a batch of joints, each of shape (num,).

    Attributes:
        t: Time since the reset [s].
        i: Motor current [A].
        q_m: Motor angle, rotor angle / n [rad].
        q_g: Gear angle [rad].
        q_l: Load angle [rad].
        dq_m: Motor velocity [rad/s].
        dq_g: Gear velocity [rad/s].
        dq_l: Load velocity [rad/s].
        tau: Joint torque [N m].
    """

    t: Floats
    i: Floats
    q_m: Floats
    q_g: Floats
    q_l: Floats
    dq_m: Floats
    dq_g: Floats
    dq_l: Floats
    tau: Floats


@dataclass(frozen=True)
class Limits:
    """What a joint may be asked for, and where a run ends for safety.

    Attributes:
        tau: Largest motor torque that is commanded [N m].
        dq_m: Largest motor speed [rad/s].
        tau_joint: Largest joint torque [N m].
    """

    tau: float
    dq_m: float
    tau_joint: float


@runtime_checkable
class Law(Protocol):
    """What commands a plant: a controller, or whatever acts as one."""

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the past of the joints in the mask, or of all."""

    def act(self, measurement: Measurement, reference: Floats) -> Floats:
        """Return the motor torque for a wanted joint torque [N m], shape (num,)."""
        ...
