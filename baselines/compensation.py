"""Feed-forward and PD with a compensation that is no linear law: what several laws share.

    u = r + kp e + kd F e_d + c,   e = r - tau,   e_d = -tau or, with lead, e

Each law says what c is. What learns from the command learns from the one that was applied.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from cjt_gym.baselines.controller import Controller, Floats, Mask, check, check_sampling
from cjt_gym.baselines.entry import SPRUNG, ControllerEntry, Gain, Gains
from cjt_gym.baselines.feedforward import pd_defaults, pd_law
from cjt_gym.baselines.linear_law import LawMemory
from cjt_gym.baselines.pid import KD, KP, LATE
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement, limits_of


@dataclass(eq=False)
class CompensatedPd(Controller):
    """Feed-forward, PD and a compensation; see the module.

    Attributes:
        model: The joint.
        kp: Proportional gain, >= 0 [-].
        kd: Derivative gain, >= 0 [s].
        lead: With at least 0.5 the derivative is that of the error.
    """

    model: SampledJoint
    kp: float
    kd: float
    lead: float
    dt: float = field(init=False)

    def __post_init__(self) -> None:
        self.dt = self.model.dt
        check_sampling(self)
        check(self, "kp", "", low=0.0)
        check(self, "kd", "s", low=0.0)
        self.linear = pd_law(self.kp, self.kd, self.dt, lead=self.lead)
        self._memory = LawMemory(self.linear)
        self._applied = np.zeros(0)

    @final
    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        if len(self._applied) != len(fresh):
            self._applied = measurement.tau.copy()
        self._applied = np.where(fresh, measurement.tau, self._applied)
        added = self._compensation(measurement, reference, self._applied, fresh)
        command = self._memory.propose(measurement, reference, fresh) + added
        self._applied = np.clip(command, -self.torque_limit, self.torque_limit)
        self._memory.commit(self._applied)
        return np.asarray(command)

    @abstractmethod
    def _compensation(
        self, measurement: Measurement, reference: Floats, applied: Floats, fresh: Mask
    ) -> Floats:
        """Return what is added to the command [N m], shape (n,).

        `applied` is the motor torque since the sample before; of a fresh joint its joint torque.
        """


def compensated_row(
    law: Callable[..., CompensatedPd],
    more: Callable[[SampledJoint, Gains], Gains],
    tunable: tuple[Gain, ...],
    **row: Any,
) -> ControllerEntry:
    """Return the row of such a law.

    `law` makes it for a sampled joint, gains by their names, and a torque limit. `more` gives the
    gains beside those of PD, for a joint and the PD gains that are designed for it; they are
    `tunable`.
    """

    def defaults(joint: Joint, dt: float) -> Gains:
        model = SampledJoint(joint, dt)
        gains = pd_defaults(model)
        return gains | dict(more(model, gains))

    def build(joint: Joint, dt: float, gains: Gains) -> Controller:
        return law(SampledJoint(joint, dt), **gains, torque_limit=limits_of(joint).tau)

    row = {"structures": SPRUNG, "tunable": (KP, KD, LATE, *tunable)} | row
    return ControllerEntry(defaults=defaults, build=build, **row)
