"""Impedance control: the joint renders a spring and a damper at its output.

    tau_d = r + stiffness (q_0 - q_l) - damping dq_l

is the joint torque that the inner loop is given, passivity-based with a momentum observer
(`cjt_gym.baselines.passivity_momentum`). r is added to it, a torque about the rendered
equilibrium; q_0 is the angle at which the load stood at the reset, so that the joint holds it
there. A passive inner loop renders a passive port as long as delays allow.

References:
    Hogan (1985), Impedance control: an approach to manipulation, Journal of Dynamic Systems,
    Measurement and Control 107(1); Ott, Albu-Schaeffer, Kugi, Hirzinger (2008), On the
    passivity-based impedance control of flexible joint robots, IEEE Transactions on Robotics 24(2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from cjt_gym.baselines import passivity_momentum
from cjt_gym.baselines.controller import Controller, Floats, Mask, check, check_sampling
from cjt_gym.baselines.entry import SPRUNG, ControllerEntry, Gain, Gains
from cjt_gym.baselines.linear_law import REFERENCE, SIGNALS, LawMemory, LinearLaw
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.shipped import gains_of
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement, limits_of

STIFFNESS_SHARE = 0.05
"""Of the torsion bar's stiffness that is rendered; the bar itself is the upper limit."""
DAMPING_RATIO = 0.5
"""Of the inertia on the rendered spring: it settles with little overshoot."""


@final
@dataclass(eq=False)
class Impedance(Controller):
    """Renders a spring and a damper on a linear torque law; see the module."""

    inner: LinearLaw
    stiffness: float  # of the rendered spring, >= 0 [N m/rad]
    damping: float  # of the rendered damper, >= 0 [N m s/rad]
    torque_limit: float = math.inf  # largest motor torque that is commanded [N m]
    dt: float = field(init=False)

    def __post_init__(self) -> None:
        self.dt = self.inner.dt
        check_sampling(self)
        check(self, "stiffness", "N m/rad", low=0.0)
        check(self, "damping", "N m s/rad", low=0.0)
        self.linear = rendered(self.inner, self.stiffness, self.damping)
        self._memory = LawMemory(self.inner)
        self._rest = np.zeros(0)

    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        if len(self._rest) != len(fresh):
            self._rest = measurement.q_l.copy()
        self._rest = np.where(fresh, measurement.q_l, self._rest)
        spring = self.stiffness * (self._rest - measurement.q_l)
        wanted = reference + spring - self.damping * measurement.dq_l
        command = self._memory.propose(measurement, wanted, fresh)
        self._memory.commit(np.clip(command, -self.torque_limit, self.torque_limit))
        return command


def rendered(law: LinearLaw, stiffness: float, damping: float) -> LinearLaw:
    """Return a torque law with its reference less that of a spring and a damper at the load."""
    b, d = law.b.copy(), law.d.copy()
    for name, weight in (("q_l", stiffness), ("dq_l", damping)):
        column = SIGNALS.index(name)
        b[:, column] -= weight * b[:, REFERENCE]
        d[column] -= weight * d[REFERENCE]
    return replace(law, b=b, d=d)


def _defaults(joint: Joint, dt: float) -> Gains:
    model, inner = SampledJoint(joint, dt), gains_of(passivity_momentum.ROW, joint, dt)
    stiffness = STIFFNESS_SHARE * joint.parameters.k_b
    free = not joint.structure_row.output_fixed
    inertia = model.inertia + (joint.parameters.get("I_l", 0.0) if free else 0.0)
    damping = 2.0 * DAMPING_RATIO * math.sqrt(stiffness * inertia)
    return {
        "stiffness": stiffness,
        "damping": damping,
        **{f"inner_{k}": v for k, v in inner.items()},
    }


def _build(joint: Joint, dt: float, gains: Gains) -> Controller:
    row = passivity_momentum.ROW
    inner = row.build(joint, dt, {g.name: gains[f"inner_{g.name}"] for g in row.tunable}).linear
    assert inner is not None
    return Impedance(inner, gains["stiffness"], gains["damping"], limits_of(joint).tau)


ROW = ControllerEntry(
    name="impedance",
    summary="Renders a spring and a damper at the load, on passivity-based torque control.",
    source="Hogan (1985), Journal of Dynamic Systems, Measurement and Control 107(1); Ott, "
    "Albu-Schaeffer, Kugi, Hirzinger (2008), IEEE Transactions on Robotics 24(2)",
    tunable=(
        Gain("stiffness", "N m/rad", 0.0, 1e5, asked=True),
        Gain("damping", "N m s/rad", 0.0, 1e3, asked=True),
        *(replace(gain, name=f"inner_{gain.name}") for gain in passivity_momentum.ROW.tunable),
    ),
    defaults=_defaults,
    build=_build,
    structures=SPRUNG,
    renders=True,
)
