"""Figures of merit of a closed loop: margins, bandwidth, steps, noise, and the port."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cjt_gym.analysis.loop import PORT_SHARE, Loop, Responses
from cjt_gym.analysis.system import Complex, Floats

STEP_S = 1.0
"""Of a step response [s]."""
SETTLED = 0.05
"""Of a step within which it has settled."""
LOW_HZ = 1.0
"""Frequency that replaces zero frequency, at which integrators make the response infinite."""
REJECTION_HZ = 20.0
"""Up to where disturbances count, as far as references go."""
STIFFEST = 1e6
"""Virtual spring that is tried at the most [N m/rad], more than a hundred torsion bars."""
CLOSE = 1e-2
"""Relative accuracy of a bisection; figures are read to three digits at best."""
LAG_ALLOWED = 1e-3
"""Share of |Z| by which a real part may be negative: the error of the port's sampled model."""


@dataclass(frozen=True)
class Margins:
    """How far a stable loop is from instability, at the motor torque.

    Attributes:
        gain: Largest stable factor > 1 on the loop gain; infinite if unlimited.
        gain_down: Smallest stable factor < 1 on the loop gain; 0 if unlimited.
        phase: Smallest phase at a gain of one [deg]; infinite where there is no such gain.
        delay: Largest additional delay for which the loop is stable [s].
        sensitivity: Ms, largest |S| [-].
    """

    gain: float
    gain_down: float
    phase: float
    delay: float
    sensitivity: float


@dataclass(frozen=True)
class Figures:
    """Figures of merit of a closed loop; NaN where they are undefined.

    Attributes:
        stable: Whether the loop is stable. Where it is not, all others are NaN.
        gain_margin: Largest factor > 1 on the loop gain for which the loop is stable [-].
        gain_reduction: Factor < 1 to which the loop gain may fall [-].
        phase_margin: [deg].
        delay_margin: Largest additional delay for which the loop is stable [s].
        sensitivity_peak: Ms, largest |S| at the motor torque [-].
        reference_peak: Largest response to the reference over that at 1 Hz [-].
        bandwidth_hz: Where the response to the reference falls 3 dB below that at 1 Hz [Hz].
        rise_s: From 10 to 90 % of a unit step [s].
        overshoot: Over the height of the step [-].
        settling_s: Until the torque stays within 5 % of the step; infinite where that is over 1 s.
        static_error: One minus the torque at the end of that second [-].
        disturbance: Response to a torque at the motor up to 20 Hz, rms over frequency [-].
        rejection_hz: Up to where less than 0.7 of a torque at the motor reaches the output [Hz].
        effort_peak: Largest motor torque of a unit step [-].
        noise_amplification: Standard deviation of the motor torque over that of white noise of the
            torque sensor [-].
        port_shortage: Damping of the environment that the output needs to be passive with zero
            reference [N m s/rad]; 0 where the port is passive.
        port_passive: Whether it is.
    """

    stable: bool
    gain_margin: float = math.nan
    gain_reduction: float = math.nan
    phase_margin: float = math.nan
    delay_margin: float = math.nan
    sensitivity_peak: float = math.nan
    reference_peak: float = math.nan
    bandwidth_hz: float = math.nan
    rise_s: float = math.nan
    overshoot: float = math.nan
    settling_s: float = math.nan
    static_error: float = math.nan
    disturbance: float = math.nan
    rejection_hz: float = math.nan
    effort_peak: float = math.nan
    noise_amplification: float = math.nan
    port_shortage: float = math.nan
    port_passive: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain data."""
        return asdict(self)


def figures_of(loop: Loop) -> Figures:
    """Return the figures of merit of a closed loop."""
    if not loop.is_stable():
        return Figures(stable=False)
    r = loop.responses()
    m = margins(r)
    step = step_response(loop)
    shortage = port_shortage(loop, r)
    disturbed = np.abs(r.disturbance)
    low = r.f <= REJECTION_HZ
    return Figures(
        True,
        m.gain,
        m.gain_down,
        m.phase,
        m.delay,
        m.sensitivity,
        float(np.max(np.abs(r.reference)) / np.interp(LOW_HZ, r.f, np.abs(r.reference))),
        bandwidth(r.f, r.reference),
        **step_figures(step[:, 0], loop.plant.dt),
        disturbance=float(np.sqrt(np.trapezoid(disturbed[low] ** 2, r.f[low]) / REJECTION_HZ)),
        rejection_hz=_first(r.f, disturbed, math.sqrt(0.5)),
        effort_peak=float(np.max(np.abs(step[:, 1]))),
        noise_amplification=noise_amplification(r),
        port_shortage=shortage,
        port_passive=shortage == 0.0,
    )


def margins(r: Responses) -> Margins:
    """Return the margins of a stable loop from its responses."""
    loop, f = r.loop, r.f
    up, down = math.inf, 0.0
    for k in np.flatnonzero(np.diff(np.signbit(loop.imag))):
        share = loop.imag[k] / (loop.imag[k] - loop.imag[k + 1])
        real = float(loop.real[k] + share * (loop.real[k + 1] - loop.real[k]))
        if real < 0.0:
            factor = -1.0 / real
            if factor > 1.0:
                up = min(up, factor)
            else:
                down = max(down, factor)
    phase, delay = math.inf, math.inf
    size = np.log(np.maximum(np.abs(loop), 1e-300))
    for k in np.flatnonzero(np.diff(np.signbit(size))):
        share = size[k] / (size[k] - size[k + 1])
        turn = float(np.angle(loop[k + 1] / loop[k]))
        angle = float(np.angle(loop[k])) + share * turn + math.pi
        angle = math.remainder(angle, 2.0 * math.pi)
        phase = min(phase, abs(math.degrees(angle)))
        omega = 2.0 * math.pi * float(f[k] * (f[k + 1] / f[k]) ** share)
        delay = min(delay, angle % (2.0 * math.pi) / omega)
    if loop.size and loop[-1].real < 0.0 and abs(loop[-1].imag) <= 1e-6 * abs(loop[-1].real):
        factor = -1.0 / float(loop[-1].real)  # at the Nyquist frequency L is real
        up, down = (min(up, factor), down) if factor > 1.0 else (up, max(down, factor))
    return Margins(up, down, phase, delay, float(np.max(np.abs(r.sensitivity))))


def bandwidth(f: Floats, response: Complex) -> float:
    """Return where a response first falls 3 dB below what it is at 1 Hz [Hz].

    The highest frequency is returned where it does not.
    """
    gain = np.abs(response)
    level = math.sqrt(0.5) * float(np.interp(LOW_HZ, f, gain))
    above = f >= LOW_HZ
    return _first(f[above], -gain[above], -level)


def _first(f: Floats, values: Floats, level: float) -> float:
    """Return the first frequency at which values pass a level from below [Hz]."""
    above = np.flatnonzero(values > level)
    if len(above) == 0:
        return float(f[-1])
    k = int(above[0])
    if k == 0:
        return float(f[0])
    share = (level - values[k - 1]) / (values[k] - values[k - 1])
    return float(f[k - 1] * (f[k] / f[k - 1]) ** share)


def noise_amplification(r: Responses) -> float:
    """Return the amplification of white noise of the torque sensor to the motor torque [-].

    It is the root of the mean of |G|^2 between zero and the Nyquist frequency.
    """
    power = np.abs(r.noise) ** 2
    total = np.trapezoid(power, r.f) + power[0] * r.f[0]
    return float(np.sqrt(total / r.f[-1]))


def step_response(loop: Loop, duration: float = STEP_S) -> Floats:
    """Return true torque and motor torque after a unit step, shape (samples, 2).

    Args:
        loop: The loop.
        duration: [s].
    """
    system = loop.closed()
    return system.step(round(duration / system.dt))[:, :2]


def step_figures(tau: Floats, dt: float) -> dict[str, float]:
    """Return rise and settling time [s], overshoot and static error [-] of a unit step.

    Args:
        tau: Response to a step from 0 to 1, shape (samples,).
        dt: Sample time [s].
    """
    outside = np.flatnonzero(np.abs(tau - 1.0) > SETTLED)
    last = int(outside[-1]) + 1 if len(outside) else 0
    low, high = (np.flatnonzero(tau >= level) for level in (0.1, 0.9))
    return {
        "rise_s": float(high[0] - low[0]) * dt if len(high) else math.nan,
        "overshoot": max(0.0, float(np.max(tau)) - 1.0),
        "settling_s": last * dt if last < len(tau) else math.inf,
        "static_error": 1.0 - float(tau[-1]),
    }


def port_shortage(loop: Loop, r: Responses | None = None) -> float:
    """Return the damping that the environment must add for the output to be passive.

    A port is passive if its impedance Z has no negative real part at any frequency (Colgate and
    Schenkel, 1997, Journal of Robotic Systems 14(1)). It is looked at up to 0.8 of the Nyquist
    frequency; a thousandth of |Z| is allowed for the sampled model of the port.

    Returns:
        max(0, -min Re Z) [N m s/rad].
    """
    r = loop.responses() if r is None else r
    seen = r.f <= PORT_SHARE * 0.5 / loop.plant.dt
    z = r.port[seen]
    lacking = -z.real - LAG_ALLOWED * np.abs(z)
    return float(max(0.0, np.max(lacking, initial=0.0)))


def stiffest_rendered(loop: Loop, environment: float = 0.0) -> float:
    """Return the stiffest virtual spring that the joint renders stably and passively [N m/rad].

    That is the upper end of its Z-width (Colgate and Brown, 1994, IEEE ICRA); the lower one is
    the impedance of the port with zero reference.

    Args:
        loop: The loop.
        environment: Damping of what touches the output, such as a hand [N m s/rad].

    Returns:
        The stiffness, to a hundredth; 0 where even a soft spring is not passive, infinity where
        every stiffness up to 1e6 N m/rad is.
    """

    def passive(stiffness: float) -> bool:
        rendering = loop.rendering(stiffness)
        return rendering.is_stable() and port_shortage(rendering) <= environment

    if passive(STIFFEST):
        return math.inf
    low, high = STIFFEST * 1e-7, STIFFEST
    if not passive(low):
        return 0.0
    while high > low * (1.0 + CLOSE):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if passive(middle) else (low, middle)
    return low
