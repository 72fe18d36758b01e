"""A policy as matrix products, in one compiled call."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError, check_name, check_range
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.kernel.compiled import inlined, reordered, threaded

Floats = NDArray[np.float32]
ACTIVATIONS: Final = ("none", "tanh", "relu", "elu")
NONE, TANH, RELU, ELU = range(4)
INPUTS, OUTPUTS, ACTIVATION, WEIGHT, BIAS = range(5)  # columns of a plan

SATURATED = 9.0  # beyond it a tanh is 1 in single precision
TOP = (
    *(1.0, 1159525191825 / 7905853580625, 41247931725 / 7905853580625),
    *(523783260 / 7905853580625, 2552550 / 7905853580625, 4095 / 7905853580625),
    1 / 7905853580625,
)
BOTTOM = (
    *(1.0, 3794809718700 / 7905853580625, 252070693875 / 7905853580625),
    *(5237832600 / 7905853580625, 41351310 / 7905853580625, 120120 / 7905853580625),
    91 / 7905853580625,
)


@reordered
def product(row: Floats, x: Floats) -> np.float32:
    """Return the scalar product of two vectors of equal length."""
    total = np.float32(0.0)
    for i in range(row.shape[0]):
        total += row[i] * x[i]
    return total


@reordered
def tanh(x: float) -> float:
    """Return the hyperbolic tangent to 4e-8: the 13th convergent of Lambert's continued fraction.

    Unlike that of the library it has no branches, so that a loop over it is done in vectors.
    """
    x = -SATURATED if x < -SATURATED else (SATURATED if x > SATURATED else x)
    z, (a, b) = x * x, (TOP, BOTTOM)
    top = a[0] + z * (a[1] + z * (a[2] + z * (a[3] + z * (a[4] + z * (a[5] + z * a[6])))))
    bottom = b[0] + z * (b[1] + z * (b[2] + z * (b[3] + z * (b[4] + z * (b[5] + z * b[6])))))
    return x * top / bottom


Packed = tuple[NDArray[np.int64], Floats, Floats, float]
"""A network for compiled code, in a plain tuple: a call with named ones takes three times as long.

Plan: per layer inputs, outputs, activation, where weights and biases begin; shape (layers, 5).
Numbers: means, scales, and of each layer weights and biases. Scratch as wide as the widest layer,
shape (2, width). What normalised observations are limited to.
"""


@inlined
def run_layers(network: Packed, observation: Floats) -> int:
    """Run a network; return in which row of its scratch the actions are, limited to [-1, 1].

    What is not a number stays so, and is not limited to one.
    """
    plan, numbers, work, clip = network
    size, now = observation.shape[0], 0
    for i in range(size):
        x = (observation[i] - numbers[i]) * numbers[size + i]
        work[0, i] = -clip if x < -clip else (clip if x > clip else x)
    for k in range(plan.shape[0]):
        inputs, outputs, activation = plan[k, INPUTS], plan[k, OUTPUTS], plan[k, ACTIVATION]
        source, target = work[now, :inputs], work[1 - now, :outputs]
        bias = numbers[plan[k, BIAS] : plan[k, BIAS] + outputs]
        for j in range(outputs):
            begin = plan[k, WEIGHT] + j * inputs
            target[j] = bias[j] + product(numbers[begin : begin + inputs], source)
        if activation == TANH:
            for j in range(outputs):
                target[j] = tanh(target[j])
        elif activation == RELU:
            for j in range(outputs):
                target[j] = 0.0 if target[j] < 0.0 else target[j]
        elif activation == ELU:
            for j in range(outputs):
                target[j] = math.expm1(target[j]) if target[j] < 0.0 else target[j]
        now = 1 - now
    for j in range(plan[-1, OUTPUTS]):
        x = work[now, j]
        work[now, j] = -1.0 if x < -1.0 else (1.0 if x > 1.0 else x)
    return now


@threaded
def run_network(network: Packed, observation: Floats) -> int:
    """Run a network; see `run_layers`."""
    return run_layers(network, observation)


@dataclass(frozen=True)
class Layer:
    """A linear layer and what follows it."""

    weight: Floats  # shape (outputs, inputs)
    bias: Floats  # shape (outputs,)
    activation: str  # one of `ACTIVATIONS`

    def __post_init__(self) -> None:
        weight = checked_array("weights of a layer", self.weight, (None, None), np.float32)
        bias = checked_array("biases of a layer", self.bias, weight.shape[:1], np.float32)
        check_name("activation", self.activation, ACTIVATIONS)
        object.__setattr__(self, "weight", weight)
        object.__setattr__(self, "bias", bias)


@dataclass(frozen=True)
class Network:
    """A deterministic policy: observations are normalised, pass the layers, are limited to 1."""

    layers: tuple[Layer, ...]  # first to last
    mean: Floats  # what observations are shifted by, shape (size,)
    scale: Floats  # what they are then multiplied with, shape (size,)
    clip: float  # what they are then limited to

    def __post_init__(self) -> None:
        if not self.layers:
            raise ConfigurationError("A policy must have at least one layer, got none.")
        size = self.layers[0].weight.shape[1]
        for name in ("mean", "scale"):
            what = f"{name} of the observations of a policy"
            array = checked_array(what, getattr(self, name), (size,), np.float32)
            object.__setattr__(self, name, array)
        check_range("clip of a policy", self.clip, above=0.0)
        for k, (one, other) in enumerate(pairwise(self.layers)):
            if other.weight.shape[1] != len(one.bias):
                raise ConfigurationError(
                    f"Layer {k + 1} of a policy must take the {len(one.bias)} outputs of layer "
                    f"{k}, got weights of shape {other.weight.shape}."
                )

    def with_end(self, end: Sequence[float]) -> Network:
        """Return the network of the other inputs where the last ones stay at these values."""
        count = len(self.mean) - len(end)
        fixed = (np.asarray(end, np.float32) - self.mean[count:]) * self.scale[count:]
        first, *others = self.layers
        bias = first.bias + first.weight[:, count:] @ np.clip(fixed, -self.clip, self.clip)
        layer = Layer(first.weight[:, :count], bias, first.activation)
        return Network((layer, *others), self.mean[:count], self.scale[:count], self.clip)

    @cached_property
    def packed(self) -> Packed:
        """The same for compiled code."""
        numbers, plan, at = [self.mean, self.scale], [], 2 * len(self.mean)
        for layer in self.layers:
            outputs, inputs = layer.weight.shape
            bias = at + inputs * outputs
            plan.append([inputs, outputs, ACTIVATIONS.index(layer.activation), at, bias])
            numbers += [layer.weight.ravel(), layer.bias]
            at = bias + outputs
        width = max(max(row[:2]) for row in plan)
        packed = np.concatenate(numbers).astype(np.float32)
        return np.array(plan), packed, np.zeros((2, width), np.float32), self.clip

    def act(self, observation: Floats) -> Floats:
        """Return the action, shape (1,), for an observation, shape (size,)."""
        if observation.shape != self.mean.shape or observation.dtype != np.float32:
            what, shape = "The observation of a policy", self.mean.shape
            observation = checked_array(what, observation, shape, np.float32, finite=False)
        plan, _, work, _ = self.packed
        found = run_network(self.packed, observation)
        return work[found, : plan[-1, OUTPUTS]].copy()
