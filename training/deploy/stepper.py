"""An exported policy at work, as a whole controller: measurements in, motor torque out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines.linear_law import COMMAND, REFERENCE, SIGNALS, TAU, assemble, static
from cjt_gym.envs.observation import Observed
from cjt_gym.envs.observe import limited, put_sample
from cjt_gym.export.c_law import CLaw
from cjt_gym.joint.compiled import threaded
from cjt_gym.training.deploy.base import run_law
from cjt_gym.training.deploy.exported import Exported
from cjt_gym.training.deploy.network import run_layers

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Q_M, DQ_M, DQ_L = (SIGNALS.index(name) for name in ("q_m", "dq_m", "dq_l"))


class Machine(NamedTuple):
    """What a step needs, and what it goes on from.

    Attributes:
        plan: See `run_layers`.
        numbers: Likewise.
        work: Likewise.
        clip: Likewise.
        reference: Wanted joint torque now and at the next steps, shape (preview + 1,) [N m].
        observation: Shape (size,).
        torque: See `Layout`.
        divisors: Likewise.
        n: Gear ratio.
        action: Motor torque of an action of 1 [N m].
        limit: Largest motor torque that is commanded [N m].
        law: See `run_law`.
        rest: Likewise.
        z: Likewise.
        law_limit: Likewise.
        follows: Likewise.
    """

    plan: NDArray[np.int64]
    numbers: Singles
    work: Singles
    clip: float
    reference: Floats
    observation: Singles
    torque: float
    divisors: Floats
    n: float
    action: float
    limit: float
    law: Floats
    rest: Floats
    z: Floats
    law_limit: float
    follows: bool


@threaded
def run_step(m: Machine, begun: bool) -> float:
    """Return the motor torque to command [N m], for a reference and signals that are in place."""
    w, count = m.z[0, m.rest.shape[0] :], m.reference.shape[0]
    for k in range(count):
        m.observation[k] = limited(m.reference[k] / m.torque)
    error, angle = w[REFERENCE] - w[TAU], m.n * w[Q_M]
    sample = Observed(error, math.sin(angle), math.cos(angle), w[TAU], w[DQ_M], w[DQ_L], w[COMMAND])
    put_sample(m.observation[count:], sample, m.divisors, begun)
    action = m.work[run_layers(m.plan, m.numbers, m.observation, m.clip, m.work), 0]
    base = run_law(m.law, m.rest, m.z, m.law_limit, m.follows, begun)
    return float(min(max(base + action * m.action, -m.limit), m.limit))


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
        law = CLaw(assemble(layout.dt, static()), 0.0) if base is None else base.law
        linear, order = law.linear, len(law.linear.c)
        plan, numbers, work = network.packed
        self.policy = policy
        self._machine = Machine(
            plan=plan,
            numbers=numbers,
            work=work,
            clip=network.clip,
            reference=np.zeros(layout.preview + 1),
            observation=np.zeros(layout.size, dtype=np.float32),
            torque=layout.torque,
            divisors=layout.divisors,
            n=layout.n,
            action=layout.action,
            limit=policy.limit,
            law=np.block([[linear.a, linear.b], [linear.c, linear.d]]),
            rest=linear.at_rest(),
            z=np.zeros((2, order + len(SIGNALS))),
            law_limit=law.limit,
            follows=law.follows,
        )
        self._signals = self._machine.z[0, order:]
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
        machine, signals = self._machine, self._signals
        machine.reference[:] = reference
        first = machine.reference[0]
        signals[:] = first, tau, q_m, q_g, q_l, dq_m, dq_g, dq_l, self.command
        self.command, self._begun = run_step(machine, self._begun), True
        return self.command
