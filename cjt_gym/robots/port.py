"""The port between an actuator and the body that it moves.

The two simulations take steps of the same length h. In a step the output of the actuator moves at
one velocity, the mean v = (dq + dq') / 2 of the body's velocities before and after, so that both
cover the same way; and the body is pushed by the mean torque of that step. As that torque depends
on v, the body is first pushed by the torque that its present velocity would give,

    tau(dq) = tau + c (A - 1) x / 2 - z dq,     z = d_gl - c B / 2,

with x, A and B the state and the exact discretisation of the actuator and c its row of torque, and
z (dq' - dq) / 2, which the body does not know yet, becomes an inertia h z / 2. That is the
trapezoidal rule for a linear actuator, which is stable for springs of any stiffness. What friction,
ripple, delay and the nonlinear spring change is known after the step, and goes into the next one,
so that no impulse is lost.

MuJoCo moves a body with its new velocity, so that its positions are half a step ahead of its
velocities; the load angle of the actuator is that at the time of the velocities.

References:
    Newmark (1959), A method of computation for structural dynamics, Journal of the Engineering
    Mechanics Division 85(3); Hairer, Lubich, Wanner (2006), Geometric Numerical Integration, I.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Batch, Floats, Setup
from cjt_gym.plant import SimulatedPlant
from cjt_gym.plant.measurement import Measurement
from cjt_gym.plant.randomization import Randomization


class Port:
    """One actuator and what has passed between it and its body.

    Attributes:
        plant: The actuator, a batch of one.
        inertia: Inertia that the body's joint has to have besides its own [kg m^2].
        given: Work that the actuator has done on its output since the reset [J].
        taken: Work that the body has received since the reset [J].
    """

    def __init__(
        self, joint: Joint, dt: float, dt_physics: float, randomization: Randomization = None
    ) -> None:
        """Prepare the actuator.

        Args:
            joint: The actuator; its output is fixed, as its motion comes from the body.
            dt: Step of both simulations, which is also that of control [s].
            dt_physics: Substep of the actuator [s]; dt is a whole multiple of it.
            randomization: What varies from one reset to the next.

        Raises:
            ConfigurationError: The output of the joint is free, or its load moves by itself.
        """
        if not joint.structure_row.output_fixed:
            raise ConfigurationError(
                f"The structure of a joint inside a robot must be output_fixed or "
                f"output_fixed_rigid_gearbox, as the robot moves its load, got {joint.structure} "
                f"for {joint.file.name}."
            )
        if "load_motion" in joint.effects:
            raise ConfigurationError(
                f"The effect load_motion of {joint.file.name} cannot act inside a robot, which "
                "moves the load itself. Leave it out."
            )
        self.plant = SimulatedPlant(joint, 1, dt, dt_physics, randomization)
        self._load = np.zeros(1)
        self.reset(0.0, 0.0)

    def reset(self, q: float, dq: float, seed: int | None = None) -> Measurement:
        """Start with a relaxed spring at an angle [rad] of the body and its velocity [rad/s]."""
        at = q - 0.5 * self.plant.dt * dq
        self._load[0] = dq
        start = np.array([[at, at, at, dq, dq, dq]])
        first = self.plant.reset(seed, start=start, load=self._load)
        arrays, setup = self.plant.batch.arrays, self.plant.batch.setup
        self._pick = coordinates(setup)
        self._row, self._slope = affine(arrays, setup)
        p = arrays.p[0]
        self._jump = float(p["d_gl"]) if p["play_gap"] == 0.0 else 0.0
        own = self.plant.joint.parameters.get("I_l", 0.0)
        self.inertia = own + 0.5 * self.plant.dt * self._slope
        self._owed = self._pushed = self.given = self.taken = 0.0
        return first

    @property
    def torque(self) -> float:
        """Torque on the output at the end of the last step [N m]."""
        return float(self.plant.batch.arrays.tau[0])

    def push(self, dq: float) -> float:
        """Return the torque to apply to the body over the next step [N m].

        Args:
            dq: Velocity of the body now [rad/s].
        """
        state = self.plant.batch.arrays.state[0]
        relaxing = float(self._row @ state[self._pick])
        begin = self.torque + self._jump * float(state[5])
        self._pushed = begin + relaxing - self._slope * dq + self._owed
        return self._pushed

    def move(self, dq: float, dq_next: float, command: float) -> Measurement:
        """Take the step that the body took, and measure.

        Args:
            dq: Velocity of the body before the step [rad/s].
            dq_next: Its velocity after it [rad/s].
            command: Motor torque that is commanded for the step [N m].

        Raises:
            SimulationError: A state ceased to be finite.
        """
        h, v = self.plant.dt, 0.5 * (dq + dq_next)
        begin = self.torque + self._jump * (float(self.plant.batch.arrays.state[0, 5]) - v)
        self._load[0] = v
        measured = self.plant.step(np.array([command]), self._load)
        mean = 0.5 * (begin + self.torque)
        received = self._pushed - 0.5 * self._slope * (dq_next - dq)
        self._owed += mean - received
        self.given += h * mean * v
        self.taken += h * received * v
        return measured


def coordinates(setup: Setup) -> NDArray[np.int64]:
    """Return where the state of a structure stands among [q_m q_g q_l dq_m dq_g dq_l]."""
    first = [setup.groups.index(g) for g in range(setup.size)]
    return np.array([*first, 2, *(3 + body for body in first)])


def affine(arrays: Batch, setup: Setup) -> tuple[Floats, float]:
    """Return what the mean torque of a step depends on, of the first joint of a batch.

    That is the row c (A - 1) / 2, shape (order,), and the slope z >= 0 [N m s/rad].
    """
    p, size, gear = arrays.p[0], setup.size, setup.groups[1]
    step, into = arrays.a[0], arrays.b[0, :, 1]
    whole, moved = np.eye(setup.order), np.zeros(setup.order)
    for _ in range(setup.substeps):
        whole, moved = step @ whole, step @ moved + into
    c = np.zeros(setup.order)
    c[gear], c[size], c[setup.order - size + gear] = p["k_b"], -p["k_b"], p["d_gl"]
    return 0.5 * c @ (whole - np.eye(setup.order)), max(0.0, float(p["d_gl"] - 0.5 * c @ moved))
