"""PID control of the joint torque, the block that several laws share, and its derivative."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.baselines.entry import Gain
from cjt_gym.baselines.linear_law import Block, integrator, static, through, total
from cjt_gym.baselines.plant_model import SampledJoint

CUTOFF_HZ = 200.0
"""Of the derivative's low pass, as in the toolbox: ten times what the tasks ask for."""
KP, KD = Gain("kp", "-", 0.0, 10.0), Gain("kd", "s", 0.0, 0.1)
KI = Gain("ki", "1/s", 0.01, 300.0, log=True, off=True)
LEAD = Gain("lead", "-", 0.0, 1.0, asked=True, usual=1.0)
LATE = Gain("lead", "-", 0.0, 1.0, asked=True, usual=0.0)
DOB_HZ = Gain("dob_hz", "Hz", 0.1, 200.0, log=True)
"""Gains that several laws share. With a lead of at least 0.5 the derivative is that of the error,
below that of the measurement; LEAD and LATE differ in which is usual."""
INTEGRALS = (0.5, 2.0, 5.0, 10.0, 20.0, 40.0, 60.0, 90.0)
"""Candidates for integral gains [1/s], about an octave apart."""


class FilteredDerivative:
    """The derivative of a batch of signals, low-pass filtered.

        F(s) = w s / (s + w),  w = 2 pi cutoff

    discretised by the bilinear (Tustin) rule:

        y[k] = a y[k-1] + b (x[k] - x[k-1]),  a = (2 - w dt) / (2 + w dt),  b = 2 w / (2 + w dt)

    References:
        Franklin, Powell, Workman (1998), Digital Control of Dynamic Systems, section 6.1.

    Example:
        >>> ramp = FilteredDerivative(cutoff_hz=200.0, dt=1e-3)
        >>> nobody, everybody = np.array([False]), np.array([True])
        >>> _ = ramp.step(np.array([0.0]), everybody)
        >>> slopes = [float(ramp.step(np.array([2e-3 * k]), nobody)[0]) for k in range(1, 30)]
        >>> round(slopes[-1], 9)
        2.0
    """

    def __init__(self, cutoff_hz: float, dt: float) -> None:
        w = 2.0 * math.pi * cutoff_hz
        self.a = (2.0 - w * dt) / (2.0 + w * dt)
        self.b = 2.0 * w / (2.0 + w * dt)
        self._x = np.zeros(0)
        self._y = np.zeros(0)

    def step(self, x: Floats, fresh: Mask) -> Floats:
        """Return the derivative at this sample, shape (n,).

        Fresh signals have no past: they are taken to have been constant, so that it is zero.
        """
        if self._x.shape != x.shape:
            self._x, self._y = x.copy(), np.zeros_like(x)
        before = np.where(fresh, x, self._x)
        self._y = np.where(fresh, 0.0, self.a * self._y + self.b * (x - before))
        self._x = x.copy()
        return self._y


def usual_cutoff(dt: float) -> float:
    """Return 200 Hz, or four fifths of the Nyquist frequency where samples are slow."""
    return min(CUTOFF_HZ, 0.4 / dt)


def derivative(dt: float, cutoff_hz: float | None = None) -> tuple[Floats, Floats, Floats, float]:
    """Return `FilteredDerivative` as a state space (a, b, c, d), with the usual cut-off if None."""
    f = FilteredDerivative(usual_cutoff(dt) if cutoff_hz is None else cutoff_hz, dt)
    return np.array([[f.a]]), np.array([f.b * (f.a - 1.0)]), np.ones(1), f.b


def pid(
    kp: float,
    ki: float,
    kd: float,
    dt: float,
    lead: float = 1.0,
    forward: float = 0.0,
    cutoff_hz: float | None = None,
) -> Block:
    """Return kp e + ki integral of e + kd F e_d, e = r - tau, with e_d = e or, see `lead`, -tau.

    The integral is forward Euler, and is held back where the command is limited.

    Gains are kp and forward, that of the reference which is added to it [-], ki [1/s] and kd [s];
    with a `lead` of at least 0.5 the reference is differentiated too. For the cut-off see
    `derivative`.

    References:
        Readman (1994), Flexible Joint Robots, CRC Press; Astrom, Hagglund (2006), Advanced PID
        Control, ISA, sections 3.4 and 3.5.
    """
    error = {"reference": 1.0, "tau": -1.0}
    late = error if lead >= 0.5 else {"tau": -1.0}
    proportional = static(reference=forward + kp, tau=-kp)
    late_error = static() if kd == 0.0 else through(derivative(dt, cutoff_hz), kd, **late)
    return total([proportional, late_error, integrator(ki, dt, forward + kp, **error)])


def damping_gains(model: SampledJoint, ratios: Sequence[float]) -> list[float]:
    """Return the derivative gains that give a mass on the joint's spring damping ratios [s]."""
    unit = 2.0 * math.sqrt(model.inertia / model.joint.parameters.k_b)
    return [ratio * unit for ratio in ratios]


def damper(model: SampledJoint, ratios: Sequence[float]) -> list[float]:
    """Return dampers that give the motor on the spring damping ratios [N m s/rad]."""
    return [model.joint.parameters.k_b * gain for gain in damping_gains(model, ratios)]
