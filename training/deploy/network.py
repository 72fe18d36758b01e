"""A policy as matrix products."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


def _relu(x: Floats) -> Floats:
    return np.maximum(x, np.float32(0.0))


def _elu(x: Floats) -> Floats:
    return np.where(x > 0.0, x, np.expm1(np.minimum(x, np.float32(0.0))))


ACTIVATIONS: Final[dict[str, Callable[[Floats], Floats]]] = {
    "tanh": np.tanh,
    "relu": _relu,
    "elu": _elu,
    "none": lambda x: x,
}


@dataclass(frozen=True)
class Layer:
    """A linear layer and what follows it.

    Attributes:
        weight: Shape (outputs, inputs).
        bias: Shape (outputs,).
        activation: One of `ACTIVATIONS`.
    """

    weight: Floats
    bias: Floats
    activation: str


@dataclass(frozen=True)
class Network:
    """A deterministic policy: observations are normalised, pass the layers, and are limited to 1.

    Attributes:
        layers: First to last.
        mean: What observations are shifted by, shape (size,).
        scale: What they are then multiplied with, shape (size,).
        clip: What they are then limited to.
    """

    layers: tuple[Layer, ...]
    mean: Floats
    scale: Floats
    clip: float

    def act(self, observation: Floats) -> Floats:
        """Return the action, shape (1,), for an observation, shape (size,)."""
        clip = np.float32(self.clip)
        x = np.minimum(np.maximum((observation - self.mean) * self.scale, -clip), clip)
        for layer in self.layers:
            x = ACTIVATIONS[layer.activation](layer.weight @ x + layer.bias)
        limited: Floats = np.minimum(np.maximum(x, np.float32(-1.0)), np.float32(1.0))
        return limited
