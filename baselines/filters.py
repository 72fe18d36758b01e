"""Discrete filters over batches."""

from __future__ import annotations

import math

import numpy as np

from cjt_gym.baselines.controller import Floats, Mask


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
