"""The sampled linear joint as a torque controller meets it: with delays, lags and filters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cjt_gym.baselines.controller import Floats
from cjt_gym.baselines.linear_law import COMMAND, LinearLaw
from cjt_gym.baselines.mechanics import Mechanics, mechanics, placed, with_commands
from cjt_gym.baselines.rational import Rational, transfer_function
from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Complex
from cjt_gym.joint.linear import frequency_response

DELAY_EFFECTS = ("command_delay", "measurement_delay", "torque_delay")
LONGEST_DELAY = 100
"""Samples; every one is a state of the model, and matrices grow with their square."""
ENCODER = 2.0 * math.pi / 2**19
"""Resolution that is taken where a joint file gives no encoder [rad]."""


@dataclass(frozen=True, eq=False)
class SampledJoint:
    """A joint and the sample time of what controls it; its models are made once.

    Two of them are never equal, so that what is designed on one can be kept by it.

    Attributes:
        joint: The joint.
        dt: Sample time [s].
    """

    joint: Joint
    dt: float

    def __post_init__(self) -> None:
        check_range("The sample time of a controller or an observer", self.dt, "s", above=0.0)

    @cached_property
    def mechanics(self) -> Mechanics:
        """The sampled mechanics."""
        return mechanics(self.joint, self.dt)

    @cached_property
    def loop(self) -> LoopModel:
        """The joint between a law's command and what it measures."""
        return loop_model(self.joint, self.dt)

    @cached_property
    def torque(self) -> Rational:
        """The continuous transfer function from motor torque to joint torque."""
        return transfer_function(*self.mechanics.continuous, self.mechanics.row("tau"))

    @cached_property
    def placed(self) -> Mechanics:
        """The sampled mechanics with the position of the last body as the last state."""
        return placed(self.mechanics)

    @property
    def name(self) -> str:
        """Name and structure of the joint."""
        return f"{self.joint.parameters.name} ({self.joint.structure})"

    @property
    def torsion(self) -> complex:
        """The pole of the slowest oscillation, or the slowest of all if none oscillates [rad/s]."""
        poles = [complex(p) for p in self.torque.poles if abs(p) > 1e-6]
        pairs = [p for p in poles if p.imag > 1e-9 * abs(p)]
        return min(pairs or poles, key=abs)

    @property
    def stiffness(self) -> float:
        """Stiffness of gearbox and torsion bar in series [N m/rad]."""
        p = self.joint.parameters
        gear = 1.0 / p.k_g if self.joint.structure_row.has_gear else 0.0
        return 1.0 / (1.0 / p.k_b + gear)

    @property
    def inertia(self) -> float:
        """Inertia of motor and gear together [kg m^2]."""
        return self.joint.parameters.I_m + self.joint.parameters.get("I_g", 0.0)


@dataclass(frozen=True)
class LoopModel:
    """The joint between a law's command and what it measures, with the noise of the sensors.

    x[k+1] = a x + b u[k - delay] + m n,  y = c x + n_y n
    """

    a: Floats  # shape (order, order)
    b: Floats  # shape (order,)
    c: Floats  # `MEASURED`, shape (7, order)
    tau: Floats  # joint torque itself, shape (order,)
    noise_in: Floats  # sensor noise into the filters, shape (order, 4)
    noise_out: Floats  # sensor noise onto the measurement, shape (7, 4)
    scatter: Floats  # standard deviation of the noise of tau, q_m, q_g, q_l, shape (4,)
    delay: int  # of the whole loop [samples]
    dt: float  # sample time [s]

    def later(self, spare: int) -> LoopModel:
        """Return the same with more delay [samples]."""
        return replace(self, delay=self.delay + spare)

    def response(self, f: Floats) -> Complex:
        """Return the response from command to `MEASURED` and, last, tau, shape (points, 8)."""
        z = np.exp(2j * math.pi * f * self.dt)
        rows = np.concatenate([self.c, self.tau[None]])
        answer = frequency_response(self.a, self.b[:, None], rows, np.zeros((8, 1)), z)
        return np.asarray(answer[..., 0] * z[:, None] ** -self.delay)

    def closed(self, law: LinearLaw) -> tuple[Floats, Floats, Floats]:
        """Return the closed loop's system, its input of sensor noise, and the row of the command.

        Returns:
            Matrices of shape (total, total), (total, 4) and (total,).
        """
        inner, into = law.unlimited()
        into, gain = into[:, 1:], law.d[1:COMMAND]
        n, m = len(self.b), len(law.c)
        both = np.zeros((n + m, n + m))
        both[:n, :n], both[n:, n:], both[n:, :n] = self.a, inner, into @ self.c
        a, head = with_commands(both, np.append(self.b, np.zeros(m)), self.delay)
        noise, command = np.zeros((len(a), 4)), np.zeros(len(a))
        noise[:n], noise[n : n + m] = self.noise_in, into @ self.noise_out
        command[:n], command[n : n + m] = gain @ self.c, law.c
        noise += np.outer(head, gain @ self.noise_out)
        return a + np.outer(head, command), noise, command


def loop_model(joint: Joint, dt: float) -> LoopModel:
    """Return the loop around a joint with the delays and filters that its effects give it.

    Delays are whole samples, all of them at the input; those of single encoders are left out.
    """
    model = mechanics(joint, dt)
    late = sum(joint.setting(name, "delay") for name in DELAY_EFFECTS)
    if late > LONGEST_DELAY * dt:
        raise ConfigurationError(
            f"The delay that gains are designed for must be <= {LONGEST_DELAY} control steps, "
            f"{LONGEST_DELAY * dt:g} s, got {late:g} s for {joint.parameters.name}. Shorten it or "
            "take the controller open_loop."
        )
    a, b, c, tau = model.a, model.b, model.c, model.row("tau")
    noise_in, noise_out = np.zeros((len(b), 4)), np.zeros((7, 4))
    noise_out[:4] = np.eye(4)
    loop = LoopModel(
        a, b, c, tau, noise_in, noise_out, scatter(joint), math.ceil(late / dt - 1e-9), dt
    )
    loop = _lagged(loop, joint.setting("current_lag", "bandwidth"))
    loop = _differentiated(loop, joint.setting("velocity_differentiation", "cutoff"))
    return _filtered(loop, joint.setting("torque_filter", "cutoff"))


def scatter(joint: Joint) -> Floats:
    """Return the noise of tau, q_m, q_g and q_l with quantization, as standard deviations (4,)."""
    values = []
    for name in ("q_m", "q_g", "q_l", "tau"):
        known = joint.file.sensors.get(name, {})
        parts = [float(np.max(known[key].value)) for key in ("noise", "resolution") if key in known]
        noise = parts[0] if "noise" in known else 0.0
        step = parts[-1] if "resolution" in known else 0.0
        values.append(math.hypot(noise, step / math.sqrt(12.0)))
    angles = [value or ENCODER for value in values[:3]]
    stiffness = joint.parameters.get("k_b", 1.0)  # without a spring no torque is measured
    torque = values[3] or stiffness * math.hypot(angles[1], angles[2])
    return np.array([torque, *angles])


def _share(cutoff: float, dt: float) -> float:
    return 1.0 - math.exp(-2.0 * math.pi * cutoff * dt)


def _lagged(loop: LoopModel, bandwidth: float) -> LoopModel:
    """Put the lag of the current loop before the joint; its output is held over a sample."""
    if bandwidth <= 0.0:
        return loop
    share, n = _share(bandwidth, loop.dt), len(loop.b)
    a = np.zeros((n + 1, n + 1))
    a[:n, :n], a[:n, n], a[n, n] = loop.a, (1.0 - share) * loop.b, 1.0 - share
    return _grown(loop, a, np.append(share * loop.b, share), loop.c, loop.noise_in, 1)


def _grown(
    loop: LoopModel, a: Floats, b: Floats, c: Floats, noise_in: Floats, more: int
) -> LoopModel:
    wide = np.zeros((len(c), len(b)))
    wide[:, : c.shape[1]] = c
    tall = np.zeros((len(b), 4))
    tall[: len(noise_in)] = noise_in
    return replace(loop, a=a, b=b, c=wide, tau=np.append(loop.tau, np.zeros(more)), noise_in=tall)


def _differentiated(loop: LoopModel, cutoff: float) -> LoopModel:
    """Replace velocities by filtered differences of the angles."""
    if cutoff <= 0.0:
        return loop
    share, n = _share(cutoff, loop.dt), len(loop.b)
    rate, keep = share / loop.dt, 1.0 - share
    angle, noisy = loop.c[1:4], loop.noise_out[1:4]
    a = np.zeros((n + 6, n + 6))
    a[:n, :n] = loop.a
    a[n : n + 3, :n] = angle  # the angles before
    a[n + 3 :, :n] = rate * angle
    a[n + 3 :, n : n + 3] = -rate * np.eye(3)
    a[n + 3 :, n + 3 :] = keep * np.eye(3)
    noise_in = np.concatenate([loop.noise_in, noisy, rate * noisy])
    grown = _grown(loop, a, np.append(loop.b, np.zeros(6)), loop.c, noise_in, 6)
    c, noise_out = grown.c, loop.noise_out.copy()
    c[4:7] = a[n + 3 :]
    noise_out[4:7] = rate * noisy
    return replace(grown, c=c, noise_out=noise_out)


def _filtered(loop: LoopModel, cutoff: float) -> LoopModel:
    """Put the torque sensor's low pass behind it."""
    if cutoff <= 0.0:
        return loop
    share, n = _share(cutoff, loop.dt), len(loop.b)
    a = np.zeros((n + 1, n + 1))
    a[:n, :n] = loop.a
    a[n, :n], a[n, n] = share * loop.c[0], 1.0 - share
    noise_in = np.concatenate([loop.noise_in, share * loop.noise_out[:1]])
    grown = _grown(loop, a, np.append(loop.b, 0.0), loop.c, noise_in, 1)
    c, noise_out = grown.c, loop.noise_out.copy()
    c[0], noise_out[0] = a[n], share * loop.noise_out[0]
    return replace(grown, c=c, noise_out=noise_out)
