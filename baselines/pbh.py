"""Whether a linear system can be observed or stabilised, mode by mode.

References:
    Hautus (1969), Controllability and observability conditions of linear autonomous systems,
    Indagationes Mathematicae 31.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance

from cjt_gym.errors import ConfigurationError

Floats = NDArray[np.float64]
TOLERANCE = 1e-9


def unobservable_modes(a: Floats, c: Floats) -> list[complex]:
    """Return the eigenvalues of a continuous system that its outputs do not show.

    The states are balanced and time is scaled by the fastest mode first, so that the test does
    not hang on units.

    Args:
        a: System matrix, shape (order, order).
        c: Output matrix, shape (outputs, order).
    """
    balanced, transform = matrix_balance(a)
    rows = c @ transform
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    scaled = balanced / max(float(np.max(np.abs(np.linalg.eigvals(balanced)))), 1e-300)
    eye = np.eye(len(a))
    hidden = []
    for mode, true in zip(np.linalg.eigvals(scaled), np.linalg.eigvals(balanced), strict=True):
        tall = np.concatenate([mode * eye - scaled, rows])
        if np.linalg.svd(tall, compute_uv=False)[-1] < TOLERANCE:
            hidden.append(complex(true))
    return hidden


def check_observable(a: Floats, c: Floats, outputs: tuple[str, ...], what: str) -> None:
    """Check that outputs show every mode of a continuous system.

    Raises:
        ConfigurationError: They do not; the message names the modes.
    """
    hidden = unobservable_modes(a, c)
    if hidden:
        listing = ", ".join(f"{mode:.4g} 1/s" for mode in hidden)
        raise ConfigurationError(
            f"{what} is not observable from {', '.join(outputs)}: the modes {listing} do not show "
            "there. Measure more, or choose a structure without them."
        )


def check_stabilisable(a: Floats, b: Floats, what: str) -> None:
    """Check that an input moves every mode of a continuous system that is not stable.

    Raises:
        ConfigurationError: It does not; the message names the modes.
    """
    scale = float(np.max(np.abs(np.linalg.eigvals(a))))
    stuck = [mode for mode in unobservable_modes(a.T, b.T) if mode.real > -1e-9 * scale]
    if stuck:
        listing = ", ".join(f"{mode:.4g} 1/s" for mode in stuck)
        raise ConfigurationError(
            f"{what} is not stabilisable: the motor torque does not move the modes {listing}."
        )
