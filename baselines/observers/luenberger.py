"""The Luenberger observer of a joint, designed in discrete time.

    x^[k] = x-[k] + m (y[k] - c x-[k]),   x-[k+1] = a x^[k] + b u[k - delay]

(a, b) is the joint sampled with a zero-order hold, m places the poles of a (1 - m c), which are
those of the estimation error, at exp(s dt) for the poles s that are asked for. From the joint
torque alone the gain is unique.

References:
    Luenberger (1971), An introduction to observers, IEEE Transactions on Automatic Control 16(6);
    Franklin, Powell, Workman (1998), Digital Control of Dynamic Systems, section 8.2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import place_poles

from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.observers.model import DesignModel, current_observer, design_model
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError

SPREAD = 0.05
"""Relative distance of poles that are asked for at one place: their placement needs them apart."""


def luenberger_observer(
    model: SampledJoint,
    poles: Sequence[complex],
    outputs: tuple[str, ...] = ("tau",),
    disturbance: bool = True,
) -> LinearObserver:
    """Return the observer of the joint's states and, if asked, of a constant motor disturbance.

    Args:
        model: The joint; its delays are taken into account.
        poles: Poles of the estimation error in the s plane [rad/s], one per state.
        outputs: Measured signals; see `design_model`.
        disturbance: Whether to estimate a disturbance.

    Raises:
        ConfigurationError: The outputs do not show all states, or the poles are not as many as
            the states, not stable, or not in conjugate pairs.
    """
    return place_observer(design_model(model, outputs, disturbance), poles)


def place_observer(model: DesignModel, poles: Sequence[complex]) -> LinearObserver:
    """Return the observer of a model with poles in the s plane [rad/s]; see the module."""
    wanted = np.asarray(poles, dtype=np.complex128)
    if len(wanted) != len(model.b) or np.any(wanted.real >= 0.0):
        raise ConfigurationError(
            f"poles of the Luenberger observer must be {len(model.b)} with a negative real part "
            f"(states {', '.join(model.states)}), got {list(poles)}."
        )
    if abs(np.sum(wanted.imag)) > 1e-9 * np.sum(np.abs(wanted)):
        raise ConfigurationError(f"poles must come in conjugate pairs, got {list(poles)}.")
    placed = place_poles(model.a.T, model.c.T, np.exp(wanted * model.dt))
    return current_observer(model, np.linalg.solve(model.a, placed.gain_matrix.T))


def spread_poles(bandwidth_hz: float, number: int) -> NDArray[np.float64]:
    """Return real poles around a bandwidth, a little apart [rad/s], shape (number,)."""
    steps = np.arange(number) - 0.5 * (number - 1)
    return np.asarray(-2.0 * np.pi * bandwidth_hz * (1.0 + SPREAD * steps))
