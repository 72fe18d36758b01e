"""Linear models of a controller and of a simulated joint, from their answers to impulses.

Neither has to say what it is made of: any law behind `act` and any joint behind `SimulatedPlant`
is asked with impulses, and realised as a state-space model. A law is called linear only if
impulses of three times the size and the other sign are answered in proportion, and if the model
predicts what was not used to make it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from cjt_gym.analysis.system import Floats, System, realize
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import CHANNELS
from cjt_gym.plant import Law, Measurement, SimulatedPlant, limits_of

TRUE = ("true_tau", "true_q_l", "true_dq_l")
LINEAR_EFFECTS = (
    *("command_delay", "current_lag", "torque_constant", "inertia", "damping", "stiffness"),
    *("gear_stiffness", "torque_gain", "torque_delay", "sensor_gain", "channel_delay"),
    *("measurement_delay", "velocity_differentiation", "torque_filter", "load_inertia"),
)
"""Effects that keep a joint linear; all others are left out of its linear model."""
SIZE = 2e-3
"""Of a kick over the torque limit: far from every limit, far above rounding."""
FACTOR = -3.0
"""Size of the second kick over the first: a law that is linear answers in the same proportion."""
PROBE_HZ = 10.0
"""Frequency at which typical velocities belong to typical angles."""
WARM, SAMPLES, PLANT_SAMPLES = 20, 400, 600
"""Control steps before a kick, and after it for laws and joints: their answers have died away, or
their slow modes show well enough for the model to be told."""
LINEAR = 1e-3
"""Relative mismatch up to which a law is linear; friction that is compensated is far above."""
NEGLIGIBLE = 1e-9
"""Answer that counts as none."""


@dataclass(frozen=True)
class LinearLaw:
    """The linear model of a controller at rest.

    Attributes:
        system: From the reference and the channels that it uses to the motor torque.
        channels: Which channels these are.
        mismatch: By how much it is not linear, or misses the law's answers; relative.
    """

    system: System
    channels: tuple[str, ...]
    mismatch: float

    @property
    def is_linear(self) -> bool:
        """Whether the model represents the law: a mismatch below 0.1 %."""
        return self.mismatch < LINEAR


@dataclass(frozen=True)
class LinearPlant:
    """The linear model of a joint with its delays and filters.

    Inputs are the motor torque [N m] and the load input: a velocity [rad/s] where the output is
    fixed and a torque [N m] elsewhere.

    Attributes:
        impulse: Answers of `CHANNELS` and `TRUE` to unit impulses, shape (samples, outputs, 2).
        dt: Sample time [s].
        output_fixed: Whether the load's motion is prescribed.
        left_out: Active effects that are not in it.
    """

    impulse: Floats
    dt: float
    output_fixed: bool
    left_out: tuple[str, ...]
    known: dict[tuple[str, ...], System] = field(default_factory=dict, repr=False, compare=False)

    def system(self, outputs: tuple[str, ...]) -> System:
        """Return the smallest model with these outputs, of `CHANNELS` and `TRUE`.

        Raises:
            ConfigurationError: What is left is not linear.
        """
        if outputs not in self.known:
            names = CHANNELS + TRUE
            system, missed = realize(self.impulse[:, [names.index(n) for n in outputs]], self.dt)
            if missed > LINEAR:
                raise ConfigurationError(
                    f"The linear model of the joint misses its simulation by {100.0 * missed:.2g} %"
                    f" in {', '.join(outputs)}. Identify the loop by simulation instead (identify)."
                )
            self.known[outputs] = system
        return self.known[outputs]


def linear_joint(joint: Joint) -> Joint:
    """Return a joint with only those effects that keep it linear."""
    kept = {n: v for n, v in joint.effects.items() if n in LINEAR_EFFECTS}
    return replace(joint, effects=kept)


def _sizes(joint: Joint) -> dict[str, float]:
    """Return how large a probe of each channel is, so that all mean about the same torque."""
    p, tau = joint.parameters, SIZE * limits_of(joint).tau
    angle = tau / p.get("k_b", tau)
    rate = angle * 2.0 * np.pi * PROBE_HZ
    sizes = {"i": tau / (p.k_t * p.n), "tau": tau}
    return sizes | {n: angle if n.startswith("q") else rate for n in CHANNELS[1:7]}


def probe_law(law: Law, joint: Joint, dt: float) -> LinearLaw:
    """Return the linear model of a controller, from its answers to impulses at rest.

    Args:
        law: The controller; it is reset before and after.
        joint: The joint that it is for, whose scales the probes take.
        dt: Sample time [s].
    """
    sizes = np.array([limits_of(joint).tau * SIZE, *_sizes(joint).values()])
    order = ("reference", *_sizes(joint))
    count = len(order)
    n = 1 + 2 * count
    kick = np.zeros((count, n))
    kick[np.arange(count), 1 + np.arange(count)] = sizes
    kick[np.arange(count), 1 + count + np.arange(count)] = FACTOR * sizes
    answers = np.empty((SAMPLES, n))
    law.reset()
    for k in range(-WARM, SAMPLES):
        values = dict(zip(order, kick if k == 0 else np.zeros_like(kick), strict=True))
        reference = values.pop("reference")
        t = np.full(n, (k + WARM) * dt)
        answer = law.act(Measurement(t=t, **values), reference)
        if k >= 0:
            answers[k] = answer
    law.reset()
    moved = answers[:, 1:] - answers[:, :1]
    one, other = moved[:, :count] / sizes, moved[:, count:] / (FACTOR * sizes)
    scale = np.abs(one * sizes).max(axis=0)
    uses = scale > NEGLIGIBLE * max(float(scale.max()), sizes[0])
    uses[0] = True
    difference = np.abs((one - other) * sizes).max(axis=0)[uses]
    uneven = float((difference / np.maximum(scale[uses], NEGLIGIBLE * sizes[0])).max())
    system, missed = realize(one[:, None, uses], dt)
    channels = tuple(name for name, used in zip(order, uses, strict=True) if used)[1:]
    return LinearLaw(system, channels, max(uneven, missed))


def probe_plant(joint: Joint, dt: float, dt_physics: float = 1e-4) -> LinearPlant:
    """Return the linear model of a simulated joint, from its answers to impulses at rest.

    Args:
        joint: The joint; effects that are not linear are left out.
        dt: Control step [s].
        dt_physics: Substep [s].
    """
    linear = linear_joint(joint)
    plant = SimulatedPlant(linear, 2, dt, dt_physics)
    measured = plant.reset(seed=0)
    size = np.array([SIZE * limits_of(joint).tau, 0.0])
    load = np.array([0.0, 1e-3])
    answers = np.empty((PLANT_SAMPLES, len(CHANNELS + TRUE), 2))
    for k in range(PLANT_SAMPLES):
        arrays = plant.batch.arrays
        values = [*(getattr(measured, n) for n in CHANNELS), arrays.tau]
        answers[k] = [*values, arrays.state[:, 2], arrays.state[:, 5]]
        here = (size, load) if k == 0 else (np.zeros(2), np.zeros(2))
        measured = plant.step(*here)
    answers[:, :, 0] /= size[0]
    answers[:, :, 1] /= load[1]
    left = tuple(name for name in joint.effects if name not in LINEAR_EFFECTS)
    return LinearPlant(answers, dt, joint.structure_row.output_fixed, left)
