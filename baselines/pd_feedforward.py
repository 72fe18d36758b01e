"""PD control of the joint torque with feed-forward of the reference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

from cjt_gym.baselines.controller import Controller, Floats, Mask, check, check_sampling
from cjt_gym.baselines.entry import SPRUNG, ControllerEntry, Gain, Gains
from cjt_gym.baselines.linear_law import LinearLaw, assemble
from cjt_gym.baselines.linear_row import grid
from cjt_gym.baselines.pid import (
    CUTOFF_HZ,
    KD,
    KP,
    FilteredDerivative,
    damping_gains,
    pid,
    usual_cutoff,
)
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.robust import best_gains
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement, limits_of

DERIVATIVES = ("error", "output")
RIGID_KP = 0.5
"""Of a joint without torque dynamics, whose error becomes 1 / (1 + kp)."""


@final
@dataclass(eq=False)
class PdFeedForward(Controller):
    """PD control with feed-forward, in parallel form.

        u = r + kp e + kd F e_d,   e = r - tau,   e_d = e ("error") or -tau ("output")

    with F the filtered derivative of `FilteredDerivative`. The derivative of the output damps the
    joint without amplifying steps of the reference; that of the error also leads the reference.

    Attributes:
        kp: Proportional gain, >= 0 [-].
        kd: Derivative gain, >= 0 [s].
        dt: Sample time [s].
        derivative: Of what: "error" or "output".
        cutoff_hz: Cut-off of the derivative's low pass, below the Nyquist frequency [Hz].
        torque_limit: Largest motor torque that is commanded [N m].

    Raises:
        ConfigurationError: A number is out of range.
        UnknownNameError: `derivative` is neither of the two.

    References:
        Vischer, Khatib (1995), IEEE Transactions on Robotics and Automation 11(4), for the
        feed-forward; Readman (1994), Flexible Joint Robots, CRC Press.
    """

    kp: float
    kd: float
    dt: float
    derivative: str = "error"
    cutoff_hz: float = CUTOFF_HZ
    torque_limit: float = math.inf

    def __post_init__(self) -> None:
        check_sampling(self)
        check(self, "kp", "", low=0.0)
        check(self, "kd", "s", low=0.0)
        check(self, "cutoff_hz", "Hz", above=0.0)
        if self.cutoff_hz >= 0.5 / self.dt:
            raise ConfigurationError(
                f"cutoff_hz of PdFeedForward must be below the Nyquist frequency, "
                f"{0.5 / self.dt:g} Hz at dt = {self.dt:g} s, got {self.cutoff_hz:g}. Lower one of "
                "them."
            )
        check_name("derivative of PdFeedForward", self.derivative, DERIVATIVES)
        self._filter = FilteredDerivative(self.cutoff_hz, self.dt)
        lead = self.derivative == "error"
        self.linear = pd_feedforward_law(self.kp, self.kd, self.dt, lead, self.cutoff_hz)

    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        error = reference - measurement.tau
        differentiated = error if self.derivative == "error" else -measurement.tau
        rate = self._filter.step(differentiated, fresh)
        return reference + self.kp * error + self.kd * rate


def pd_feedforward_law(
    kp: float, kd: float, dt: float, lead: float = 1.0, cutoff_hz: float | None = None
) -> LinearLaw:
    """Return the law; see `PdFeedForward`, and `cjt_gym.baselines.pid.derivative` for the cut-off.

    With a `lead` of at least 0.5 the derivative is that of the error.
    """
    return assemble(dt, pid(kp, 0.0, kd, dt, lead, 1.0, cutoff_hz))


def _defaults(joint: Joint, dt: float) -> Gains:
    """Return designed gains; a rigid joint, which has no torque dynamics, gets kp alone."""
    if joint.structure not in SPRUNG:
        return {"kp": RIGID_KP, "kd": 0.0, "lead": 1.0}
    model = SampledJoint(joint, dt)
    damping = damping_gains(model, (0.0, 0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5))
    kp = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0, 3.0)
    return best_gains(
        model,
        lambda g: pd_feedforward_law(g["kp"], g["kd"], dt, g["lead"]),
        grid(kp=kp, kd=damping, lead=(1.0, 0.0)),
    )


def _build(joint: Joint, dt: float, gains: Gains) -> Controller:
    derivative = "error" if gains["lead"] >= 0.5 else "output"
    limit, cutoff = limits_of(joint).tau, usual_cutoff(dt)
    return PdFeedForward(gains["kp"], gains["kd"], dt, derivative, cutoff, limit)


ROW = ControllerEntry(
    name="pd_feedforward",
    summary="Feed-forward and PD on the torque error, derivative filtered at 200 Hz.",
    source="Vischer, Khatib (1995), IEEE Transactions on Robotics and Automation 11(4)",
    tunable=(
        KP,
        KD,
        Gain("lead", "-", 0.0, 1.0),
    ),
    defaults=_defaults,
    build=_build,
)
