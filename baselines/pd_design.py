"""Default gains of PD with feed-forward.

A lightly damped spring behind a delay leaves little room: a proportional gain that is harmless on
a slow joint drives a fast one unstable, because the delay turns its stiffness into negative
damping. So gains follow from each joint's own loop. With P the sampled joint from motor torque to
joint torque, D the delay of the loop and C = kp + kd F the law, `design_gains` minimises

    the mean of |P S|^2 over frequency    (friction and ripple, which enter at the motor)
    + the mean of |1 - T|^2 to 20 Hz      (the reference),   S = 1 / (1 + C P D)

while |S| stays below `PEAK`, the loop is stable also with `SPARE_DELAY` more, and white noise of
the torque sensor is amplified less than `NOISE` times. Joints of the library have gains that a
search on the simulator, friction included, found among those that are stable (`TUNED`, by
`python -m cjt_gym.training.tune_pd`); they are taken where the joint at hand is stable with them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines.filters import FilteredDerivative
from cjt_gym.baselines.tuned_gains import TUNED, TUNED_DT, Gains
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

PEAK = 2.0
SPARE_DELAY = 1e-3
NOISE = 8.0
RIGID_KP = 0.5
REFERENCE_BAND = 20.0
KP = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0)
DAMPING = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.8, 1.0)
DELAY_EFFECTS = ("command_delay", "measurement_delay", "torque_delay")
LONGEST_DELAY = 100
POINTS = 400


@dataclass(frozen=True)
class Loop:
    """The sampled loop around a joint.

    Attributes:
        a: System matrix of the joint over one sample, shape (order, order).
        b: Input of the motor torque, shape (order,).
        c: Output of the joint torque, shape (order,).
        delay: Nominal delay of the loop [samples].
        spare: Delay that it must bear on top [samples].
        filter: Filter of the derivative.
        dt: Sample time [s].
    """

    a: Floats
    b: Floats
    c: Floats
    delay: int
    spare: int
    filter: FilteredDerivative
    dt: float

    def frequencies(self) -> Floats:
        """Return frequencies from 0.5 Hz to the Nyquist frequency, logarithmic [Hz]."""
        return np.geomspace(0.5, 0.5 / self.dt, POINTS)

    def plant(self, f: Floats) -> Complex:
        """Return the response of the joint at frequencies [Hz]."""
        z = np.exp(2j * math.pi * f * self.dt)
        systems = z[:, None, None] * np.eye(len(self.b)) - self.a
        return np.asarray(np.linalg.solve(systems, self.b[None, :, None])[..., 0] @ self.c)

    def law(self, f: Floats, kp: float, kd: float) -> Complex:
        """Return the response of the law to the error at frequencies [Hz]."""
        back = np.exp(-2j * math.pi * f * self.dt)
        rate = self.filter.b * (1.0 - back) / (1.0 - self.filter.a * back)
        return np.asarray(kp + kd * rate)

    def is_stable(self, kp: float, kd: float, delay: int) -> bool:
        """Return whether the closed loop has no pole outside the unit circle."""
        n = len(self.b)
        total = n + 1 + delay
        m = np.zeros((total, total))
        m[:n, :n] = self.a
        m[n, :n] = self.c * (1.0 - self.filter.a)
        m[n, n] = self.filter.a
        command = np.zeros(total)
        command[:n] = -(kp + kd * self.filter.b) * self.c
        command[n] = kd * self.filter.b
        if delay == 0:
            m[:n] += np.outer(self.b, command)
        else:
            m[n + 1] = command
            m[:n, -1] = self.b
            for k in range(1, delay):
                m[n + 1 + k, n + k] = 1.0
        return bool(np.max(np.abs(np.linalg.eigvals(m))) <= 1.0 + 1e-7)

    def is_robust(self, kp: float, kd: float) -> bool:
        """Return whether the loop is stable with the nominal delay and with the spare one."""
        delays = (self.delay, self.delay + self.spare)
        return all(self.is_stable(kp, kd, delay) for delay in delays)

    def noise(self, kp: float, kd: float) -> float:
        """Return the amplification of white noise from the torque sensor to the command."""
        f = self.frequencies()
        law, back = self.law(f, kp, kd), np.exp(-2j * math.pi * f * self.dt)
        command = law / (1.0 + law * self.plant(f) * back**self.delay)
        return float(np.sqrt(np.trapezoid(np.abs(command) ** 2, f) * 2.0 * self.dt))


def make_loop(joint: Joint, dt: float, cutoff_hz: float, spare_delay: float) -> Loop:
    """Return the sampled loop around a joint with the delays that its effects give it.

    Raises:
        ConfigurationError: They are longer than `LONGEST_DELAY` control steps.
    """
    system = joint.state_space(dt)
    late = sum(_setting(joint, name, "delay") for name in DELAY_EFFECTS)
    cutoff = _setting(joint, "torque_filter", "cutoff")
    late += 1.0 / (2.0 * math.pi * cutoff) if cutoff > 0.0 else 0.0
    if late > LONGEST_DELAY * dt:
        raise ConfigurationError(
            f"The delay that PD gains are designed for must be <= {LONGEST_DELAY} control steps, "
            f"{LONGEST_DELAY * dt:g} s, got {late:g} s for {joint.parameters.name}. Shorten it, "
            "give gains of your own (PdFeedForward), or take the controller open_loop."
        )
    row = system.output_labels.index("tau")
    return Loop(
        a=np.asarray(system.A),
        b=np.asarray(system.B)[:, system.input_labels.index("tau_m")],
        c=np.asarray(system.C)[row],
        delay=math.ceil(late / dt - 1e-9),
        spare=math.ceil(spare_delay / dt - 1e-9),
        filter=FilteredDerivative(cutoff_hz, dt),
        dt=dt,
    )


def _setting(joint: Joint, effect: str, symbol: str) -> float:
    """Return one number of an effect, 0 where it is off."""
    value = joint.effects.get(effect, {}).get(symbol, 0.0)
    assert isinstance(value, float)
    return value


def default_gains(joint: Joint, dt: float, cutoff_hz: float) -> Gains:
    """Return the tuned gains of a joint if it is stable with them, else the designed ones.

    Args:
        joint: The joint; delays among its effects are taken into account.
        dt: Sample time [s].
        cutoff_hz: Cut-off of the derivative's low pass [Hz].
    """
    tuned = TUNED.get((joint.parameters.name, joint.structure))
    if tuned is not None and abs(dt - TUNED_DT) < 1e-9:
        loop = make_loop(joint, dt, cutoff_hz, SPARE_DELAY)
        if loop.is_robust(tuned.kp, tuned.kd):
            return tuned
    return design_gains(joint, dt, cutoff_hz)


def design_gains(
    joint: Joint,
    dt: float,
    cutoff_hz: float,
    peak: float = PEAK,
    spare_delay: float = SPARE_DELAY,
    noise: float = NOISE,
) -> Gains:
    """Return the gains for a joint; see the module for what they minimise.

    Args:
        joint: The joint; delays among its effects are taken into account.
        dt: Sample time [s].
        cutoff_hz: Cut-off of the derivative's low pass [Hz].
        peak: Largest |S|.
        spare_delay: Delay that the loop must bear on top of the nominal one [s].
        noise: Largest amplification of the torque sensor's white noise.

    Returns:
        The best gains of the grid; zeros where no feedback is stable. A joint without a spring
        before its load has no dynamics in this model and gets kp = 0.5, kd = 0.
    """
    groups = joint.structure_row.groups
    if groups[1] == groups[2]:
        return Gains(RIGID_KP, 0.0, "error")
    p = joint.parameters
    loop = make_loop(joint, dt, cutoff_hz, spare_delay)
    unit = 2.0 * math.sqrt((p.I_m + p.get("I_g", 0.0)) / p.k_b)
    scored = [(*_score(loop, kp, z * unit, peak, noise), kp, z * unit) for kp, z in GRID]
    for score, derivative, kp, kd in sorted(scored, key=lambda entry: entry[0]):
        if math.isfinite(score) and loop.is_robust(kp, kd):
            return Gains(kp, kd, derivative)
    return Gains(0.0, 0.0, "error")


GRID = tuple(product(KP, DAMPING))


def _score(loop: Loop, kp: float, kd: float, peak: float, noise: float) -> tuple[float, str]:
    """Return the cost, infinite where a limit is broken, and what to differentiate."""
    f = loop.frequencies()
    joint, law = loop.plant(f), loop.law(f, kp, kd)
    back = np.exp(-2j * math.pi * f * loop.dt)
    sensitivity = 1.0 / (1.0 + law * joint * back**loop.delay)
    if np.max(np.abs(sensitivity)) > peak:
        return math.inf, "error"
    if loop.noise(kp, kd) > noise:
        return math.inf, "error"
    disturbance = np.mean(np.abs(joint * sensitivity) ** 2)
    low = f <= REFERENCE_BAND
    forward = (joint * back**loop.delay * sensitivity)[low]
    tracking = {
        "error": np.mean(np.abs(1.0 - (1.0 + law[low]) * forward) ** 2),
        "output": np.mean(np.abs(1.0 - (1.0 + kp) * forward) ** 2),
    }
    derivative = min(tracking, key=lambda name: float(tracking[name]))
    return float(disturbance + tracking[derivative]), derivative
