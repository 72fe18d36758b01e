"""The controller that a residual policy adds to, as numbers that an exported file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines import default_gains
from cjt_gym.baselines.linear_law import COMMAND, REFERENCE, SIGNALS, TAU, LinearLaw
from cjt_gym.errors import ConfigurationError
from cjt_gym.export.c_additions import NOTHING
from cjt_gym.export.c_law import CLaw, law_of
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.compiled import threaded
from cjt_gym.training.learning.config import TrainConfig, base_of

if TYPE_CHECKING:
    from cjt_gym.envs.settings import Settings

Floats = NDArray[np.float64]
ARRAYS = ("a", "b", "c", "d")


@dataclass(frozen=True)
class BaseLaw:
    """A base controller.

    Attributes:
        name: Its name.
        gains: Its gains.
        law: What it does.
    """

    name: str
    gains: Mapping[str, float]
    law: CLaw

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
    """Return the base controller of a training, None where it has none.

    Raises:
        ConfigurationError: It learns series, solves programs, or is code of one's own.
    """
    choice = base_of(config.env)
    if choice is None:
        return None
    gains = choice.entry.complete(choice.gains)
    if len(gains) < len(choice.entry.tunable):
        gains = default_gains(choice.controller, settings.joint, settings.dt) | dict(choice.gains)
    made = replace(choice, gains=gains).make(settings.joint, settings.dt)
    return BaseLaw(choice.name, gains, law_of(made, choice.name))


def read_base(facts: Mapping[str, Any] | None, arrays: Mapping[str, Any]) -> BaseLaw | None:
    """Return what `BaseLaw.facts` and `BaseLaw.arrays` gave, None where a file has no such law.

    Raises:
        ConfigurationError: An array has the wrong shape or type.
    """
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


@threaded
def run_law(
    a: Floats,
    b: Floats,
    c: Floats,
    d: Floats,
    rest: Floats,
    x: Floats,
    w: Floats,
    limit: float,
    follows: bool,
    begun: bool,
) -> float:
    """Return the command of a linear law, and go on with its state; see `LinearLaw`.

    Args:
        a: Matrix of the law, shape (order, order).
        b: Likewise, shape (order, 9).
        c: Likewise, shape (order,).
        d: Likewise, shape (9,).
        rest: From signals that stand still to the state, shape (order, 9).
        x: The state, and scratch, shape (2, order).
        w: The signals, shape (9,); the last one is overwritten with the command.
        limit: Largest command [N m].
        follows: See `CLaw`.
        begun: Whether there was a step before.
    """
    order, count = c.shape[0], d.shape[0]
    if not begun:
        for i in range(order):
            x[0, i] = 0.0
            for j in range(count):
                still = w[TAU] if j == COMMAND or (j == REFERENCE and not follows) else w[j]
                x[0, i] += rest[i, j] * still
    w[COMMAND] = 0.0
    command = 0.0
    for i in range(order):
        command += c[i] * x[0, i]
    for j in range(count):
        command += d[j] * w[j]
    command = min(max(command, -limit), limit)
    w[COMMAND] = command
    for i in range(order):
        x[1, i] = 0.0
        for j in range(order):
            x[1, i] += a[i, j] * x[0, j]
        for j in range(count):
            x[1, i] += b[i, j] * w[j]
    for i in range(order):
        x[0, i] = x[1, i]
    return command
