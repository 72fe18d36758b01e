"""An exported policy that runs as a whole controller: measurements in, motor torque out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines.linear_law import COMMAND, REFERENCE, SIGNALS, TAU, assemble, static
from cjt_gym.envs.observation import Observed
from cjt_gym.envs.observe import limited, put_sample
from cjt_gym.export.c_law import CLaw
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.compiled import threaded
from cjt_gym.training.deploy.base import Running, run_law, running
from cjt_gym.training.deploy.exported import Exported
from cjt_gym.training.deploy.network import Packed, run_layers

Singles = NDArray[np.float32]
Q_M, DQ_M, DQ_L = (SIGNALS.index(name) for name in ("q_m", "dq_m", "dq_l"))


Machine = tuple[Packed, Running, Floats, Singles, Floats, float, float, float, float]
"""Network; law, with the signals of the step; reference now and at the next steps, shape
(preview + 1,) [N m]; observation, shape (size,); and of the layout divisors, torque, n and action;
largest motor torque [N m]."""


@threaded
def run_step(machine: Machine, begun: bool) -> float:
    """Return the motor torque to command [N m], for a reference and signals that are in place."""
    network, law, reference, observation, divisors, torque, n, action, limit = machine
    _, rest, z, _, _ = law
    w, count = z[0, rest.shape[0] :], reference.shape[0]
    for k in range(count):
        observation[k] = limited(reference[k] / torque)
    error, angle = w[REFERENCE] - w[TAU], n * w[Q_M]
    sample = Observed(error, math.sin(angle), math.cos(angle), w[TAU], w[DQ_M], w[DQ_L], w[COMMAND])
    put_sample(observation[count:], sample, divisors, begun)
    _, _, work, _ = network
    found = work[run_layers(network, observation), 0]
    return float(min(max(run_law(law, begun) + found * action, -limit), limit))


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
        law = CLaw(assemble(layout.dt, static()), 0.0) if base is None else base.law
        self._law, self._reference = running(law), np.zeros(layout.preview + 1)
        self._signals = self._law[2][0, -len(SIGNALS) :]
        observation = np.zeros(layout.size, np.float32)
        numbers = (layout.divisors, layout.torque, layout.n, layout.action, policy.limit)
        self._machine = (network.packed, self._law, self._reference, observation, *numbers)
        self.reset()

    def __repr__(self) -> str:
        return f"<Stepper of the policy {self.policy.name}: dt = {self.policy.layout.dt:g} s>"

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
        first = self._reference[0]
        self._signals[:] = first, tau, q_m, q_g, q_l, dq_m, dq_g, dq_l, self.command
        self.command, self._begun = run_step(self._machine, self._begun), True
        return self.command
