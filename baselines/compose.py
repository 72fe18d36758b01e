"""Controllers that are put together from parts, as "pid+reference+momentum_dob".

The command is the sum of what the parts of `cjt_gym.baselines.parts` add. What integrals keep while
a limit holds the command, and what observers know of it, is that of the whole sum. Gains are those
of the parts, and their defaults are chosen as for every law (`cjt_gym.baselines.robust`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import final

import numpy as np

from cjt_gym.baselines.controller import Controller, Floats, Mask, check_sampling
from cjt_gym.baselines.entry import ControllerEntry, Gains
from cjt_gym.baselines.friction_feedforward import KnownFriction
from cjt_gym.baselines.linear_law import (
    REFERENCE,
    Block,
    LawMemory,
    LinearController,
    assemble,
    integrator,
    total,
)
from cjt_gym.baselines.linear_row import grid
from cjt_gym.baselines.own import is_own
from cjt_gym.baselines.parts import OBSERVER, PARTS, Part, friction_of
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.robust import best_gains
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement, limits_of

JOINED = "+"


@final
@dataclass(eq=False)
class WithFriction(Controller):
    """A linear law and a friction that is fed forward beside it."""

    block: Block
    dt: float  # sample time [s]
    friction: KnownFriction  # what is added to its command
    torque_limit: float = math.inf  # largest motor torque that is commanded [N m]
    _memory: LawMemory = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_sampling(self)
        self.linear = assemble(self.dt, self.block)
        self._memory = LawMemory(self.linear)

    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        added = self.friction.step(measurement, reference, fresh)
        command = self._memory.propose(measurement, reference, fresh) + added
        applied = np.clip(command, -self.torque_limit, self.torque_limit)
        self._memory.commit(applied, self.block.g, added)
        return np.asarray(command)


def is_composed(word: str) -> bool:
    """Return whether a word names parts, one or several."""
    return not is_own(word) and (JOINED in word or word in PARTS)


@lru_cache(maxsize=256)
def composed(word: str) -> ControllerEntry:
    """Return the row of a controller that is put together from the parts that a word names."""
    parts = tuple(_part(name, word) for name in word.split(JOINED))
    _check(parts, word)

    def defaults(joint: Joint, dt: float) -> Gains:
        model = SampledJoint(joint, dt)
        usual = {gain.name: gain.usual for gain in tunable if gain.usual is not None}
        tries = {name: values for part in parts for name, values in part.tries(model).items()}
        rows = [usual | row for row in grid(**tries)]
        return best_gains(model, lambda gains: assemble(dt, _whole(parts, model, gains)), rows)

    def build(joint: Joint, dt: float, gains: Gains) -> Controller:
        model, limit = SampledJoint(joint, dt), limits_of(joint).tau
        block = _whole(parts, model, gains)
        if any(part.friction for part in parts):
            return WithFriction(block, dt, friction_of(model, gains), limit)
        return LinearController(assemble(dt, block), limit)

    tunable = tuple(gain for part in parts for gain in part.tunable)
    holds = [part for part in parts if part.refusal]
    return ControllerEntry(
        word,
        f"Put together: {'; '.join(part.summary for part in parts)}.",
        "cjt_gym.baselines.parts",
        tunable,
        defaults,
        build,
        (holds or parts)[0].structures,
        holds[0].refusal if holds else "",
    )


def _part(name: str, word: str) -> Part:
    check_name(f"part of the controller {word}", name, PARTS)
    return PARTS[name]


def _check(parts: Sequence[Part], word: str) -> None:
    observers = [part.name for part in parts if part.kind == OBSERVER]
    if len(observers) > 1:
        raise ConfigurationError(
            f"The controller {word} must have one disturbance observer at most, got "
            f"{', '.join(observers)}. Two of them would take the same torque off twice."
        )
    owners: dict[str, str] = {}
    for part in parts:
        shared = [gain.name for gain in part.tunable if gain.name in owners]
        if shared or [one.name for one in parts].count(part.name) > 1:
            other = owners[shared[0]] if shared else part.name
            raise ConfigurationError(
                f"The parts {other} and {part.name} of the controller {word} do the same. Leave "
                "one of them out."
            )
        owners |= {gain.name: part.name for gain in part.tunable}


def _whole(parts: Sequence[Part], model: SampledJoint, gains: Gains) -> Block:
    """Return the sum of parts as a block, with an integral of the error if there is a `ki`."""
    blocks = [
        part.block(model, {g.name: gains[g.name] for g in part.tunable if g.name in gains})
        for part in parts
    ]
    whole = total(blocks)
    if "ki" not in gains:
        return whole
    rest = np.linalg.solve(np.eye(len(whole.c)) - whole.a, whole.b[:, REFERENCE])
    direct = float(whole.c @ rest + whole.d[REFERENCE])
    integral = integrator(gains["ki"], model.dt, max(direct, 0.0), reference=1.0, tau=-1.0)
    return total([whole, integral])
