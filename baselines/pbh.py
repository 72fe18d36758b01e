"""Whether a linear system can be observed or stabilised, mode by mode.

References:
    Hautus (1969), Controllability and observability conditions of linear autonomous systems,
    Indagationes Mathematicae 31.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import matrix_balance, svdvals

from cjt_gym.baselines.controller import Floats
from cjt_gym.errors import ConfigurationError

TOLERANCE = 1e-13
"""Least singular value, relative, that is not zero: some hundred times the rounding of a double."""
SMALL = 1e-6
"""Modes nearer to each other than this, over the fastest, are one; shares less than this none."""


@dataclass(frozen=True)
class Mode:
    """A mode of a system."""

    # its eigenvalue [1/s]; of a conjugate pair, that with the positive imaginary part
    pole: complex
    states: tuple[int, ...]  # indices of the states that take part in it

    def text(self, names: Sequence[str] = ()) -> str:
        """Return it in words, with the names of its states where those of all are given."""
        part = f" (of {', '.join(names[i] for i in self.states)})" if names else ""
        return f"{root_text(self.pole)}{part}"


def root_text(root: complex) -> str:
    """Return a pole or a zero in words; one with an imaginary part stands for its pair."""
    pair = f"±{abs(root.imag):.4g}j" if root.imag else ""
    return f"{root.real:.4g}{pair} 1/s"


def unobservable_modes(a: Floats, c: Floats) -> list[Mode]:
    """Return the modes of a continuous system that its outputs do not show.

    The states are balanced and time is scaled by the fastest mode first, so that the test does
    not hang on units. A singular system is tried at zero itself, where rounding splits poles.

    Args:
        a: System matrix, shape (order, order).
        c: Output matrix, shape (outputs, order).
    """
    balanced, transform = matrix_balance(a)
    rows = c @ transform
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    poles = np.linalg.eigvals(balanced).astype(np.complex128)
    scale = max(float(np.max(np.abs(poles))), 1e-300)
    scaled, hidden = balanced / scale, list[Mode]()
    if svdvals(scaled)[-1] < TOLERANCE:
        poles = np.concatenate([[0.0 + 0.0j], poles])
    for pole in poles[poles.imag >= 0.0]:
        tall = np.concatenate([pole / scale * np.eye(len(a)) - scaled, rows])
        _, values, axes = np.linalg.svd(tall)
        known = any(abs(pole - mode.pole) < SMALL * scale for mode in hidden)
        if values[-1] < TOLERANCE and not known:
            share = np.abs(transform @ axes[-1]) / np.abs(transform).max(axis=1)
            taking_part = np.flatnonzero(share > SMALL * share.max())
            hidden.append(Mode(complex(pole), tuple(taking_part.tolist())))
    return hidden


def check_observable(
    a: Floats, c: Floats, outputs: tuple[str, ...], what: str, states: Sequence[str] = ()
) -> None:
    """Check that outputs show every mode of a continuous system."""
    hidden = unobservable_modes(a, c)
    if hidden:
        raise ConfigurationError(
            f"{what} is not observable from {', '.join(outputs)}: {_listing(hidden, states)} "
            f"{'does' if len(hidden) == 1 else 'do'} not show there. Measure more, or choose a "
            "structure without that."
        )


def check_stabilisable(a: Floats, b: Floats, what: str) -> None:
    """Check that an input moves every mode of a continuous system that is not stable."""
    scale = float(np.max(np.abs(np.linalg.eigvals(a))))
    stuck = [mode for mode in unobservable_modes(a.T, b.T) if mode.pole.real > -1e-9 * scale]
    if stuck:
        raise ConfigurationError(
            f"{what} is not stabilisable: the motor torque does not move {_listing(stuck)}."
        )


def _listing(modes: Sequence[Mode], names: Sequence[str] = ()) -> str:
    word = "the mode" if len(modes) == 1 else "the modes"
    return f"{word} {', '.join(mode.text(names) for mode in modes)}"
