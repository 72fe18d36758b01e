"""Discrete linear systems, and their realisation from impulse responses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cjt_gym.joint.linear import frequency_response

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
TOLERANCES = (1e-9, 1e-7, 1e-5, 1e-3)
"""Of singular values, tried one after the other until the model is of a moderate order."""
LARGEST_ORDER = 40
"""Of a model that is still easy to handle."""


@dataclass(frozen=True)
class System:
    """A discrete linear system, x+ = a x + b u, y = c x + d u.

    Attributes:
        a: Shape (order, order).
        b: Shape (order, inputs).
        c: Shape (outputs, order).
        d: Shape (outputs, inputs).
        dt: Sample time [s].
    """

    a: Floats
    b: Floats
    c: Floats
    d: Floats
    dt: float

    def response(self, f: Floats) -> Complex:
        """Return the frequency response, shape (frequencies, outputs, inputs).

        Args:
            f: Frequencies [Hz], shape (frequencies,).
        """
        z = np.exp(2j * np.pi * np.asarray(f) * self.dt)
        return frequency_response(self.a, self.b, self.c, self.d, z)

    def step(self, samples: int) -> Floats:
        """Return the answer to a unit step of the first input, shape (samples, outputs)."""
        x, out = np.zeros(len(self.a)), np.empty((samples, len(self.c)))
        for k in range(samples):
            out[k] = self.c @ x + self.d[:, 0]
            x = self.a @ x + self.b[:, 0]
        return out

    def impulse(self, samples: int) -> Floats:
        """Return the impulse response, shape (samples, outputs, inputs)."""
        out, x = np.empty((samples, *self.d.shape)), self.b
        out[0] = self.d
        for k in range(1, samples):
            out[k], x = self.c @ x, self.a @ x
        return out


def realize(impulse: Floats, dt: float) -> tuple[System, float]:
    """Return the smallest system with an impulse response, and by how much it misses it.

    The first half goes into a Hankel matrix (the eigensystem realisation algorithm); the second
    is only compared. Order and accuracy follow from the smallest tolerance on singular values
    that leaves an order of at most 40.

    Args:
        impulse: Response of every output to a unit impulse at sample 0 of every input, shape
            (samples, outputs, inputs).
        dt: Sample time [s].

    Returns:
        The system, and the largest difference of the impulse responses, relative to the largest
        value of each pair of input and output.

    References:
        Juang, Pappa (1985), Journal of Guidance, Control, and Dynamics 8(5).
    """
    later = impulse[1:]
    rows = later.shape[0] // 4
    height = np.maximum(np.abs(later[: 2 * rows]).max(axis=(0, 2)), 1e-300)
    scaled = later / height[None, :, None]
    width = np.maximum(np.abs(scaled[: 2 * rows]).max(axis=(0, 1)), 1e-300)
    scaled = scaled / width[None, None, :]
    window = np.lib.stride_tricks.sliding_window_view(scaled, rows, axis=0)
    blocks = window[: rows + 1].transpose(0, 1, 3, 2)  # (rows + 1, outputs, rows, inputs)
    outputs, inputs = scaled.shape[1:]
    first = blocks[:-1].reshape(rows * outputs, rows * inputs)
    second = blocks[1:].reshape(rows * outputs, rows * inputs)
    with threadpool_limits(1):  # threads cost such small matrices more than they save
        u, s, vt = np.linalg.svd(first, full_matrices=False)
    found: tuple[System, float] | None = None
    for tolerance in TOLERANCES:
        order = int(np.sum(s > tolerance * s[0])) if s[0] > 0.0 else 0
        if order > LARGEST_ORDER and tolerance != TOLERANCES[-1]:
            continue
        order = min(order, LARGEST_ORDER)
        root = np.sqrt(s[:order])
        left, right = u[:, :order] * root, root[:, None] * vt[:order]
        a = (u[:, :order] / root).T @ second @ (vt[:order].T / root)
        system = System(
            a, right[:, :inputs] * width, left[:outputs] * height[:, None], impulse[0], dt
        )
        missed = _missed(system, impulse)
        if found is None or missed < found[1]:
            found = system, missed
        if missed < 1e-4:
            break
    assert found is not None
    return found


def _missed(system: System, impulse: Floats) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        difference = np.abs(system.impulse(len(impulse)) - impulse).max(axis=0)
    scale = np.abs(impulse).max(axis=0)
    present = scale > 1e-9 * scale.max(initial=0.0)
    worst = (difference[present] / scale[present]).max(initial=0.0)
    return float(worst) if np.isfinite(worst) else float("inf")
