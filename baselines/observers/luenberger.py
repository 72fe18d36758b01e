"""The Luenberger observer of a joint, designed in discrete time.

    x^[k] = x-[k] + m (y[k] - c x-[k]),   x-[k+1] = a x^[k] + b u[k - delay]

(a, b) is the joint sampled with a zero-order hold, m places the poles of a (1 - m c), which are
those of the estimation error, at exp(s dt) for the poles s that are asked for. From one output the
gain is unique. From several it is not: outputs are weighed by the noise of their sensors, those
that say the same are taken as one, and the least sensitive of all gains is sought. Poles that are
asked for at one place are set a little apart.

References:
    Luenberger (1971), An introduction to observers, IEEE Transactions on Automatic Control 16(6);
    Franklin, Powell, Workman (1998), Digital Control of Dynamic Systems, section 8.2; Tits, Yang
    (1996), Globally convergent algorithms for robust pole assignment by state feedback, IEEE
    Transactions on Automatic Control 41(10).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from scipy.linalg import matrix_balance
from scipy.optimize import linear_sum_assignment

from cjt_gym.baselines.controller import Floats
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.observers.model import DesignModel, current_observer, design_model
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint.kernel.arrays import Complex

SPREAD = 0.05
"""Relative distance of poles that are asked for at one place: their placement needs them apart."""
SAME = 1e-6
"""Relative distance of poles that count as at one place, and share of an output that is its own."""
MISSED = 0.05
"""How far a pole may come out from where it was asked for, relative to its distance from 1."""


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
        ConfigurationError: The outputs do not show all states; or the poles are not as many as
            the states, not stable, not in conjugate pairs, or cannot be placed with the precision
            of a computer.
    """
    return place_observer(design_model(model, outputs, disturbance), poles)


def place_observer(model: DesignModel, poles: Sequence[complex]) -> LinearObserver:
    """Return the observer of a model with poles in the s plane [rad/s]; see the module."""
    wanted = np.asarray(poles, dtype=np.complex128)
    if len(wanted) != len(model.b) or not np.all(wanted.real < 0.0):
        raise ConfigurationError(
            f"poles of the Luenberger observer must be {len(model.b)} with a negative real part "
            f"(states {', '.join(model.states)}), got {list(poles)}."
        )
    if np.abs(np.sort_complex(wanted) - np.sort_complex(wanted.conj())).max() > SAME * np.abs(
        wanted
    ).max(initial=0.0):
        raise ConfigurationError(f"poles must come in conjugate pairs, got {list(poles)}.")
    return current_observer(model, _gain(model, np.exp(apart(wanted) * model.dt)))


def _gain(model: DesignModel, wanted: Complex) -> Floats:
    """Return the gain m, shape (order, outputs), for poles in the z plane."""
    from scipy.signal import place_poles  # takes long to import

    _, (scale, _) = matrix_balance(model.a, permute=False, separate=True)
    a, c = model.a * scale / scale[:, None], model.c * scale / model.noise[:, None]
    axes, sizes, _ = np.linalg.svd(c, full_matrices=False)
    axes = axes[:, sizes > SAME * sizes[0]]  # outputs that say something of their own
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # whether it has converged is seen in the poles
        try:
            placed = place_poles(a.T, (axes.T @ c).T, wanted).gain_matrix
            gain = np.linalg.solve(a, placed.T) @ axes.T
        except ValueError as error:  # of NumPy, too, where a mode dies within a sample
            raise ConfigurationError(
                f"Poles of the Luenberger observer cannot be placed at {_told(wanted, model)}: "
                f"{error}. Leave fast modes of the joint where they are, or take a Kalman filter."
            ) from error
    found = np.linalg.eigvals(a @ (np.eye(len(a)) - gain @ c))
    distance = np.abs(found[:, None] - wanted) / np.abs(1.0 - wanted)
    if distance[linear_sum_assignment(distance)].max() > MISSED:
        raise ConfigurationError(
            f"Poles of the Luenberger observer that are asked for at {_told(wanted, model)} come "
            f"out at {_told(found, model)}: measure more, set them farther apart or nearer to "
            "those of the joint, or take a Kalman filter."
        )
    return np.asarray(gain * scale[:, None] / model.noise)


def _told(poles: Complex, model: DesignModel) -> str:
    """Return poles of the z plane as text, in the s plane."""
    found = np.log(poles.astype(np.complex128)) / model.dt
    words = [f"{z.real:.4g}" + (f"{z.imag:+.4g}j" if z.imag else "") for z in found]
    return f"{', '.join(words)} rad/s"


def apart(poles: Complex) -> Complex:
    """Return poles with those at one place set apart around it, conjugate pairs alike."""
    moved = poles.copy()
    for pole in poles:
        (same,) = np.nonzero(np.abs(poles - pole) <= SAME * np.abs(pole))
        steps = np.arange(len(same)) - 0.5 * (len(same) - 1)
        moved[same] = poles[same] * (1.0 + SPREAD * steps)
    return moved


def spread_observer(model: DesignModel, bandwidth_hz: float) -> LinearObserver:
    """Return the observer of a model with real poles around a bandwidth, a little apart."""
    poles = apart(np.full(len(model.b), -2.0 * np.pi * bandwidth_hz + 0j)).real
    return place_observer(model, poles.tolist())
