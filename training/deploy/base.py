"""The controller that a residual policy adds to, as numbers that an exported file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cjt_gym.baselines.linear_law import COMMAND, REFERENCE, SIGNALS, TAU, LinearLaw
from cjt_gym.errors import ConfigurationError
from cjt_gym.export.c_law import NOTHING, CLaw, law_of
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.compiled import inlined
from cjt_gym.training.learning.config import TrainConfig, base_of

if TYPE_CHECKING:
    from cjt_gym.envs.settings import Settings

ARRAYS = ("a", "b", "c", "d")


@dataclass(frozen=True)
class BaseLaw:
    """A base controller."""

    name: str
    gains: Mapping[str, float]
    law: CLaw  # what it does

    @property
    def is_linear(self) -> bool:
        """Whether its linear law within a limit is all that it does; other laws go to C alone."""
        law = self.law
        return law.addition is NOTHING and law.stiffness == 0.0 and law.damping == 0.0

    @property
    def uses(self) -> frozenset[str]:
        """Names of the signals that it needs."""
        if not self.is_linear:
            return frozenset(SIGNALS[:COMMAND])
        linear = self.law.linear
        needed = (linear.d != 0.0) | (linear.b != 0.0).any(axis=0)
        return frozenset(np.array(SIGNALS)[needed].tolist()) - {SIGNALS[COMMAND]}

    def arrays(self) -> dict[str, Floats]:
        """Return its numbers by the names that they have in a file."""
        return {f"base_{name}": getattr(self.law.linear, name) for name in ARRAYS}

    def facts(self) -> dict[str, Any]:
        """Return the rest as plain data."""
        linear = self.law.linear
        told = {"controller": self.name, "gains": dict(self.gains), "dt": linear.dt}
        limit = self.law.limit if np.isfinite(self.law.limit) else None
        return told | {"limit": limit, "follows": self.law.follows, "linear": self.is_linear}


def base_law(config: TrainConfig, settings: Settings) -> BaseLaw | None:
    """Return the base controller of a training, None where it has none."""
    choice = base_of(config.env)
    if choice is None:
        return None
    joint, dt = settings.joint, settings.layout.dt
    choice = choice.spelt_out(joint, dt)
    return BaseLaw(choice.name, choice.gains, law_of(choice.make(joint, dt), choice.name))


def read_base(facts: Mapping[str, Any] | None, arrays: Mapping[str, Any]) -> BaseLaw | None:
    """Return what `BaseLaw.facts` and `BaseLaw.arrays` gave, None where a file has no such law."""
    if facts is None or not facts["linear"]:
        return None
    order, count = len(arrays["base_c"]), len(SIGNALS)
    shapes = {"a": (order, order), "b": (order, count), "c": (order,), "d": (count,)}
    a, b, c, d = (
        checked_array(f"{name} of the base controller", arrays[f"base_{name}"], shape)
        for name, shape in shapes.items()
    )
    if d[COMMAND] != 0.0:
        raise ConfigurationError("The base controller must not use its own present command.")
    limit = np.inf if facts["limit"] is None else float(facts["limit"])
    law = CLaw(LinearLaw(a, b, c, d, float(facts["dt"])), limit, bool(facts["follows"]))
    gains = {str(name): float(value) for name, value in facts["gains"].items()}
    return BaseLaw(str(facts["controller"]), gains, law)


Running = tuple[Floats, Floats, Floats, float, bool]
"""A law for compiled code, with its state.

Matrix [a b; c d] of a `LinearLaw`, shape (order + 1, order + 9). From signals that stand still to
the state, shape (order, 9). State and signals, and scratch, shape (2, order + 9). Largest command
[N m]. `follows` of a `CLaw`.
"""


def running(law: CLaw) -> Running:
    """Return the linear part of a law within its limit, ready to begin."""
    one = law.linear
    matrix, z = np.block([[one.a, one.b], [one.c, one.d]]), np.zeros((2, len(one.c) + len(one.d)))
    return matrix, one.at_rest(), z, law.limit, law.follows


@inlined
def run_law(law: Running, begun: bool) -> float:
    """Return the command for the signals, the last of which it becomes; go on with the state."""
    matrix, rest, z, limit, follows = law
    order, count = rest.shape
    w = z[0, order:]
    if not begun:
        for i in range(order):
            z[0, i] = 0.0
            for j in range(count):
                still = w[TAU] if j == COMMAND or (j == REFERENCE and not follows) else w[j]
                z[0, i] += rest[i, j] * still
    w[COMMAND] = 0.0
    command = 0.0
    for j in range(order + count):
        command += matrix[order, j] * z[0, j]
    command = min(max(command, -limit), limit)
    w[COMMAND] = command
    for i in range(order):
        z[1, i] = 0.0
        for j in range(order + count):
            z[1, i] += matrix[i, j] * z[0, j]
    for i in range(order):
        z[0, i] = z[1, i]
    return command
