"""The current controller inside an electrical drive, for whoever commands voltages.

    v = k_t n dq_m + kp e + ki z,   z[k+1] = z[k] + dt (e + (v_applied - v) / (kp + r)),
    e = i_ref - i,   kp = w l_a,  ki = w r

Internal-model control: the controller's zero takes the place of the winding's pole r / l_a, so
that the current follows as a first-order lag with the bandwidth w. The back-EMF k_t n dq_m (speed
on the link side) is added, so that it need not be integrated up; in
d-q axes it is two thirds of that. The integral counts in seconds
and is held back by what the supply cuts off. Without inductance (`static`) only the integral acts.

The inverter holds the voltage over a sample, so w dt should stay well below 1.

References:
    Harnefors, Nee (1998), Model-based current control of AC machines using the internal model
    control method, IEEE Transactions on Industry Applications 34(1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np

from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint

FASTEST = 0.5
"""Largest bandwidth relative to the sample rate, w dt."""


@final
@dataclass(eq=False)
class CurrentController:
    """Gives the voltage that makes the current follow; see the module.

    Attributes:
        joint: A joint with one of the voltage drives.
        dt: Sample time [s].
        bandwidth_hz: Of the current loop, w / (2 pi), with w dt <= 0.5 [Hz].

    Raises:
        ConfigurationError: The drive takes no voltage, or a number is out of range.
    """

    joint: Joint
    dt: float
    bandwidth_hz: float

    def __post_init__(self) -> None:
        if self.joint.drive == "current":
            raise ConfigurationError(
                "A current controller needs a voltage drive, got drive 'current' for "
                f"{self.joint.parameters.name}. Load the joint with drive='static', 'rl' or 'dq'."
            )
        highest = FASTEST / (2.0 * math.pi * self.dt) if self.dt > 0.0 else math.nan
        if not 0.0 < self.bandwidth_hz <= highest:
            raise ConfigurationError(
                f"bandwidth_hz of CurrentController must be in (0, {highest:g}] Hz at dt = "
                f"{self.dt:g} s, got {self.bandwidth_hz}. Sample faster or ask for less."
            )
        p, w = self.joint.parameters, 2.0 * math.pi * self.bandwidth_hz
        self.kp = w * p.get("l_a", 0.0) if self.joint.drive != "static" else 0.0
        self.ki, self.resistance, self.supply = w * p.r, p.r, p.v_0
        share = 2.0 / 3.0 if self.joint.drive == "dq" else 1.0  # amplitude-invariant d-q axes
        self.emf, self.poles = share * p.k_t * p.n, p.get("p", 0.0)
        self._z = np.zeros(0)

    def act(self, wanted: Floats, current: Floats, dq_m: Floats, fresh: Mask) -> Floats:
        """Return the voltage until the next sample, within +- v_0 [V], shape (n,).

        Args:
            wanted: Current that is wanted [A], shape (n,).
            current: Measured current [A], shape (n,).
            dq_m: Motor velocity on the link side [rad/s], shape (n,).
            fresh: Joints without a past, shape (n,): their integral begins at zero.

        Raises:
            ConfigurationError: The shapes differ.
        """
        if not wanted.shape == current.shape == dq_m.shape == fresh.shape:
            raise ConfigurationError(
                "wanted, current, dq_m and fresh must have one shape, got "
                f"{wanted.shape}, {current.shape}, {dq_m.shape} and {fresh.shape}."
            )
        self._z = np.zeros_like(wanted) if self._z.shape != wanted.shape else self._z
        self._z = np.where(fresh, 0.0, self._z)
        error = wanted - current
        voltage = self.emf * dq_m + self.kp * error + self.ki * self._z
        limited = np.clip(voltage, -self.supply, self.supply)
        real = error + (limited - voltage) / (self.kp + self.resistance)
        self._z = self._z + self.dt * real
        return np.asarray(limited)

    def direct(self, current: Floats, dq_m: Floats) -> Floats:
        """Return the voltage on the d axis that keeps the current there at zero [V], shape (n,).

        Args:
            current: Measured current on the q axis [A], shape (n,).
            dq_m: Motor velocity on the link side [rad/s], shape (n,).
        """
        p = self.joint.parameters
        cross = -self.poles * p.n * dq_m * p.get("l_a", 0.0) * current
        return np.asarray(np.clip(cross, -self.supply, self.supply))
