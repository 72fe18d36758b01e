"""PD control of the joint torque with feed-forward of the reference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

from cjt_gym.baselines.controller import Controller, Floats, Mask, check, check_sampling
from cjt_gym.baselines.entry import ControllerEntry, Gain, Gains
from cjt_gym.baselines.filters import FilteredDerivative
from cjt_gym.baselines.pd_design import default_gains
from cjt_gym.errors import ConfigurationError, unknown_name
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement, limits_of

DERIVATIVES = ("error", "output")
CUTOFF_HZ = 200.0


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
        if self.derivative not in DERIVATIVES:
            raise unknown_name("derivative of PdFeedForward", self.derivative, DERIVATIVES)
        self._filter = FilteredDerivative(self.cutoff_hz, self.dt)

    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        error = reference - measurement.tau
        differentiated = error if self.derivative == "error" else -measurement.tau
        rate = self._filter.step(differentiated, fresh)
        return reference + self.kp * error + self.kd * rate


def _defaults(joint: Joint, dt: float) -> Gains:
    gains = default_gains(joint, dt, CUTOFF_HZ)
    return {"kp": gains.kp, "kd": gains.kd, "lead": float(gains.derivative == "error")}


def _build(joint: Joint, dt: float, gains: Gains) -> Controller:
    derivative = "error" if gains["lead"] >= 0.5 else "output"
    limit = limits_of(joint).tau
    return PdFeedForward(gains["kp"], gains["kd"], dt, derivative, torque_limit=limit)


ROW = ControllerEntry(
    name="pd_feedforward",
    summary="Feed-forward and PD on the torque error, derivative filtered at 200 Hz.",
    source="Vischer, Khatib (1995), IEEE Transactions on Robotics and Automation 11(4)",
    tunable=(
        Gain("kp", "-", 0.0, 10.0),
        Gain("kd", "s", 0.0, 0.1),
        Gain("lead", "-", 0.0, 1.0),
    ),
    defaults=_defaults,
    build=_build,
)
