"""A linear controller closed around a linear joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.analysis.probe import LinearLaw, LinearPlant
from cjt_gym.analysis.system import Complex, Floats, System
from cjt_gym.errors import check_range

MARGINAL = 1e-4
"""A pole this close to the unit circle counts as the free motion of an undamped joint."""
LOWEST_HZ, POINTS = 0.02, 1500
"""Of the frequencies of a loop: below its slowest integral, and dense enough for a peak of Ms."""
PORT_SHARE = 0.8
"""Up to which share of the Nyquist frequency the port is looked at."""


@dataclass(frozen=True)
class Responses:
    """Frequency responses of a closed loop, each of shape (frequencies,).

    Attributes:
        f: Frequencies [Hz].
        loop: L, loop gain at the motor torque [-].
        sensitivity: S = 1 / (1 + L) [-].
        reference: From the reference to the true joint torque [-].
        disturbance: From a torque at the motor to the true joint torque [-].
        noise: From the torque sensor's noise to the motor torque [-].
        port: Impedance of the output with zero reference [N m s/rad]: torque against its motion
            over its velocity; the load's own inertia is in it where the load is free.
    """

    f: Floats
    loop: Complex
    sensitivity: Complex
    reference: Complex
    disturbance: Complex
    noise: Complex
    port: Complex


@dataclass(frozen=True)
class Loop:
    """A linear controller around a linear joint.

    Attributes:
        law: The controller; inputs are the reference and its channels.
        plant: The joint.
    """

    law: LinearLaw
    plant: LinearPlant

    @property
    def outputs(self) -> tuple[str, ...]:
        """What of the joint takes part: the law's channels, true torque, motion of the port."""
        port = "true_q_l" if self.plant.output_fixed else "true_dq_l"
        return (*self.law.channels, "true_tau", port)

    @property
    def frequencies(self) -> Floats:
        """From 0.02 Hz to the Nyquist frequency, logarithmic [Hz]."""
        return np.geomspace(LOWEST_HZ, 0.5 / self.plant.dt, POINTS)

    def closed(self) -> System:
        """Return the closed loop.

        Inputs are the reference, a torque at the motor, the torque sensor's noise and the load
        input; outputs the true torque, the command of the controller and the port's motion.
        """
        p, c = self.plant.system(self.outputs), self.law.system
        used = len(self.law.channels)
        y, true = p.c[:used], p.c[used:]
        noisy = np.array([[float(name == "tau")] for name in self.law.channels]).reshape(used, 1)
        d_r, d_y, b_r, b_y = c.d[:, :1], c.d[:, 1:], c.b[:, :1], c.b[:, 1:]
        u = p.b[:, :1]
        a = np.block([[p.a + u @ d_y @ y, u @ c.c], [b_y @ y, c.a]])
        zero = np.zeros((len(c.a), 1))
        b = np.block([[u @ d_r, u, u @ d_y @ noisy, p.b[:, 1:]], [b_r, zero, b_y @ noisy, zero]])
        command = np.block([[d_y @ y, c.c]])
        rest = np.zeros((2, len(c.a)))
        out = np.vstack([np.hstack([true[:1], rest[:1]]), command, np.hstack([true[1:], rest[1:]])])
        d = np.zeros((3, 4))
        d[1, 0], d[1, 2] = d_r[0, 0], (d_y @ noisy)[0, 0]
        return System(a, b, out, d, p.dt)

    def poles(self) -> Complex:
        """Return the poles of the closed loop in the z plane."""
        return np.asarray(np.linalg.eigvals(self.closed().a), dtype=np.complex128)

    def is_stable(self) -> bool:
        """Return whether no disturbance grows; the free motion of an undamped joint may stay."""
        return bool(np.max(np.abs(self.poles()), initial=0.0) <= 1.0 + MARGINAL)

    def responses(self, f: Floats | None = None) -> Responses:
        """Return the frequency responses, at `frequencies` unless others are given [Hz]."""
        f = self.frequencies if f is None else np.asarray(f, dtype=np.float64)
        p = self.plant.system(self.outputs).response(f)
        c = self.law.system.response(f)[:, 0]
        used = len(self.law.channels)
        back = c[:, 1:]
        loop = -np.einsum("fy,fy->f", back, p[:, :used, 0])
        s = 1.0 / (1.0 + loop)
        tau, motion = p[:, used], p[:, used + 1]
        noise = np.zeros(len(f), dtype=np.complex128)
        if "tau" in self.law.channels:
            noise = s * back[:, self.law.channels.index("tau")]
        by_load = s * np.einsum("fy,fy->f", back, p[:, :used, 1])
        return Responses(
            f,
            loop,
            s,
            tau[:, 0] * s * c[:, 0],
            tau[:, 0] * s,
            noise,
            self._port(f, tau[:, 1] + tau[:, 0] * by_load, motion[:, 1] + motion[:, 0] * by_load),
        )

    def _port(self, f: Floats, torque: Complex, motion: Complex) -> Complex:
        """Return the impedance from the responses of torque and motion to the load input.

        A load velocity that is held over a sample makes an angle of straight pieces, which is
        nearly the sine through its corners, so that the ratio of torque and angle is free of the
        hold's lag. The same factor makes a free mass exact under a held torque.
        """
        s = 2j * np.pi * f
        if self.plant.output_fixed:
            return np.asarray(-torque / (s * motion))
        step = np.exp(s * self.plant.dt) - 1.0
        return np.asarray(s * self.plant.dt / (motion * step))

    def rendering(self, stiffness: float) -> Loop:
        """Return the loop whose reference renders a virtual spring at the output.

            r = -stiffness q_l,  from the measured angle of the load

        Args:
            stiffness: Of the spring [N m/rad].

        Raises:
            ConfigurationError: It is negative.
        """
        check_range("The stiffness of a rendered spring", stiffness, "N m/rad", low=0.0)
        channels, system = self.law.channels, self.law.system
        b, d = system.b.copy(), system.d.copy()
        if "q_l" not in channels:
            channels = (*channels, "q_l")
            b, d = (np.hstack([x, np.zeros_like(x[:, :1])]) for x in (b, d))
        at = 1 + channels.index("q_l")
        b[:, at] -= stiffness * b[:, 0]
        d[:, at] -= stiffness * d[:, 0]
        law = replace(self.law, system=replace(system, b=b, d=d), channels=channels)
        return Loop(law, self.plant)
