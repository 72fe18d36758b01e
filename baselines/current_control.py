"""The current controller of a voltage drive, for use with voltage commands.

Plants and environments have it inside (effect `current_control`); the law is the same and stands in
`cjt_gym.joint.kernel.current_loop`. The inverter holds the voltage over a sample, so w dt should
stay well below 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.kernel.compiled import compiled
from cjt_gym.joint.kernel.current_loop import FASTEST, NAME, regulate
from cjt_gym.joint.kernel.drives import get_drive


@compiled
def regulate_all(
    p: NDArray[Any],
    drive: int,
    loops: Floats,
    wanted: Floats,
    currents: Floats,
    dq_m: Floats,
    period: float,
) -> None:
    """Do for every joint what `regulate` does for one."""
    for i in range(wanted.shape[0]):
        regulate(p[0], drive, loops[i], wanted[i], currents[i], dq_m[i], period)


@final
@dataclass(eq=False)
class CurrentController:
    """Gives the voltages that make the current follow; see `cjt_gym.joint.kernel.current_loop`.

    Attributes:
        joint: A joint with one of the voltage drives.
        dt: Sample time [s].
        bandwidth_hz: Of the current loop, w / (2 pi), with w dt <= 0.5 [Hz].

    Raises:
        ConfigurationError: The drive takes no voltage, or a number is out of range.
    """

    joint: Joint
    dt: float
    bandwidth_hz: float
    _p: NDArray[Any] = field(init=False, repr=False)
    _loops: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        joint = self.joint
        if joint.drive == "current":
            raise ConfigurationError(
                "A current controller needs a voltage drive, got drive 'current' for "
                f"{joint.parameters.name}. Load the joint with drive='static', 'rl' or 'dq'."
            )
        highest = FASTEST / (2.0 * math.pi * self.dt) if self.dt > 0.0 else math.nan
        if not 0.0 < self.bandwidth_hz <= highest:
            raise ConfigurationError(
                f"bandwidth_hz of CurrentController must be in (0, {highest:g}] Hz at dt = "
                f"{self.dt:g} s, got {self.bandwidth_hz}. Sample faster or ask for less."
            )
        values = {"bandwidth": self.bandwidth_hz, "rate": 1.0 / self.dt}
        loop = resolve_effects({NAME: values}, joint.file, joint.structure_row, joint.drive)
        self._p, _ = replace(joint, effects={**joint.effects, **loop}).packed()
        self._loops = np.zeros((0, 4))

    def act(self, wanted: Floats, currents: Floats, dq_m: Floats, fresh: Mask) -> Floats:
        """Return the voltages [v_q, v_d] until the next sample, within the supply [V], (n, 2).

        From the wanted current on the q axis [A] and the motor velocity on the link side [rad/s],
        shape (n,), and the measured [i_q, i_d] [A], shape (n, 2). The integrals of `fresh` joints,
        which have no past, begin at zero.
        """
        shape = wanted.shape
        if not (shape == dq_m.shape == fresh.shape and currents.shape == (*shape, 2)):
            raise ConfigurationError(
                "wanted, dq_m and fresh must have one shape (n,) and currents (n, 2), got "
                f"{shape}, {dq_m.shape}, {fresh.shape} and {currents.shape}."
            )
        if len(self._loops) != len(wanted):
            self._loops = np.zeros((len(wanted), 4))
        self._loops[fresh] = 0.0
        wanted, currents, dq_m = (
            np.ascontiguousarray(x, dtype=np.float64) for x in (wanted, currents, dq_m)
        )
        drive = get_drive(self.joint.drive)
        regulate_all(self._p, drive, self._loops, wanted, currents, dq_m, self.dt)
        return self._loops[:, 2:].copy()
