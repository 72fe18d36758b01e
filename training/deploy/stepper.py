"""An exported policy at work, as a whole controller: measurements in, motor torque out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines.linear_law import SIGNALS
from cjt_gym.joint.compiled import threaded
from cjt_gym.training.deploy.base import run_law
from cjt_gym.training.deploy.exported import Exported
from cjt_gym.training.deploy.layout import observe
from cjt_gym.training.deploy.network import run_layers

Floats = NDArray[np.float64]


@threaded
def run_step(
    plan: NDArray[np.int64],
    numbers: NDArray[np.float32],
    clip: float,
    work: NDArray[np.float32],
    scales: Floats,
    reference: Floats,
    tau: float,
    q_m: float,
    dq_m: float,
    dq_l: float,
    command: float,
    begun: bool,
    observation: NDArray[np.float32],
) -> float:
    """Observe and return the action; see `observe` and `run_layers`."""
    observe(scales, reference, tau, q_m, dq_m, dq_l, command, begun, observation)
    return float(work[run_layers(plan, numbers, observation, clip, work), 0])


@final
class Stepper:
    """The controller of a policy: base controller, network, limit and history.

    Attributes:
        policy: What it runs.
        command: Motor torque of the step before [N m]; overwrite it where the drive applied
            another one.

    Example:
        stepper = Stepper(load_exported("policy.npz"))
        torque = stepper.step([reference], tau, q_m, q_g, q_l, dq_m, dq_g, dq_l)
    """

    def __init__(self, policy: Exported) -> None:
        """Begin an episode.

        Raises:
            ConfigurationError: The file has no base controller, and the policy needs one.
        """
        policy.check_whole("Stepper")
        layout, network, base = policy.layout, policy.on_its_joint, policy.base
        self.policy = policy
        self._fixed = (*network.packed[:2], network.clip, network.packed[2])
        self._scales = np.array([layout.torque, layout.velocity, layout.n])
        self._reference = np.zeros(layout.preview + 1)
        self._observation = np.zeros(layout.size, dtype=np.float32)
        self._signals, self._law = np.zeros(len(SIGNALS)), None
        if base is not None:
            law, x = base.law.linear, np.zeros((2, len(base.law.linear.c)))
            self._law = (law.a, law.b, law.c, law.d, law.at_rest(), x, self._signals)
            self._limits = (base.law.limit, base.law.follows)
        self.reset()

    def reset(self) -> None:
        """Forget the past; the next step is the first."""
        self._begun, self.command = False, 0.0

    def step(
        self,
        reference: Sequence[float] | Floats,
        tau: float,
        q_m: float,
        q_g: float,
        q_l: float,
        dq_m: float,
        dq_g: float,
        dq_l: float,
    ) -> float:
        """Return the motor torque to command [N m].

        Args:
            reference: Wanted joint torque now and at the next steps, shape (preview + 1,) [N m].
            tau: Measured joint torque [N m].
            q_m: Measured motor angle, rotor angle / n [rad].
            q_g: Measured gear angle [rad].
            q_l: Measured load angle [rad].
            dq_m: Measured motor velocity [rad/s].
            dq_g: Measured gear velocity [rad/s].
            dq_l: Measured load velocity [rad/s].
        """
        self._reference[:] = reference
        numbers = (float(tau), float(q_m), float(dq_m), float(dq_l), float(self.command))
        action = run_step(
            *self._fixed, self._scales, self._reference, *numbers, self._begun, self._observation
        )
        base = 0.0
        if self._law is not None:
            first = self._reference[0]
            self._signals[:-1] = first, tau, q_m, q_g, q_l, dq_m, dq_g, dq_l
            base = run_law(*self._law, *self._limits, self._begun)
        self._begun, limit = True, self.policy.limit
        wanted = base + float(action) * self.policy.layout.action
        self.command = min(max(wanted, -limit), limit)
        return self.command
