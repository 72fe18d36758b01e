"""A linear law with what is added to its command and is no linear law: friction, or what is learnt.

What learns from the command learns from the one that was applied.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol, final

import numpy as np

from cjt_gym.baselines.controller import Controller, Floats, Mask, check_sampling
from cjt_gym.baselines.linear_law import Block, LawMemory, assemble
from cjt_gym.plant import Measurement


class Addition(Protocol):
    """What is added to the command of a linear law."""

    def step(
        self, measurement: Measurement, reference: Floats, applied: Floats, fresh: Mask
    ) -> Floats:
        """Return what is added to the command [N m], shape (n,).

        `applied` is the motor torque since the sample before; of a fresh joint its joint torque.
        """
        ...


@final
@dataclass(eq=False)
class WithAddition(Controller):
    """A linear law and an addition, for which no limit has to answer."""

    block: Block
    dt: float  # sample time [s]
    addition: Addition
    torque_limit: float = math.inf  # largest motor torque that is commanded [N m]
    _memory: LawMemory = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_sampling(self)
        self.linear = assemble(self.dt, self.block)
        self._memory = LawMemory(self.linear)
        self._applied = np.zeros(0)

    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        if len(self._applied) != len(fresh):
            self._applied = measurement.tau.copy()
        self._applied = np.where(fresh, measurement.tau, self._applied)
        added = self.addition.step(measurement, reference, self._applied, fresh)
        command = self._memory.propose(measurement, reference, fresh) + added
        self._applied = np.clip(command, -self.torque_limit, self.torque_limit)
        self._memory.commit(self._applied, self.block.g, added)
        return np.asarray(command)
