"""Identification experiments: motor torques that excite what a diagnosis needs to see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cjt_gym.canbus.safety import SafetyLimits
from cjt_gym.errors import check_name
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

HEADROOM = 0.6
"""Share of each limit that the nominal joint may reach in an experiment."""
BACK_OFF, TRIALS = 0.7, 30
"""An experiment beyond that share shrinks by this factor, so often at most."""
LOW, HIGH, TONES = 0.5, 60.0, 40
"""Lowest and highest frequency of chirp and multisine [Hz], and its tones."""


@dataclass(frozen=True)
class Experiment:
    """One row of the table."""

    name: str
    summary: str  # its motion and its purpose
    seconds: float  # its duration [s]
    share: float  # its amplitude as a share of the largest torque
    shape: Callable[[Floats], Floats]  # torque as a function of time [s], within [-1, 1]


def _triangle(t: Floats, period: float | Floats) -> Floats:
    """Return a triangular wave that starts at zero and rises."""
    phase = (t / period) % 1.0
    wave = 4.0 * np.minimum(phase, np.minimum(np.abs(0.5 - phase), 1.0 - phase))
    return np.asarray(np.where(phase < 0.5, wave, -wave))


def _friction_map(t: Floats) -> Floats:
    """Ramp to and fro, every four seconds at another rate."""
    periods = np.array([4.0, 2.0, 1.0, 0.5, 0.25])
    part = np.minimum((t // 4.0).astype(int), len(periods) - 1)
    return np.asarray(_triangle(t - 4.0 * part, periods[part]))


def _chirp(t: Floats) -> Floats:
    """Sweep exponentially: each octave takes the same time."""
    rate = np.log(HIGH / LOW) / 10.0
    return np.asarray(np.sin(2.0 * np.pi * LOW * np.expm1(rate * t) / rate))


def _multisine(t: Floats) -> Floats:
    """Add tones with the phases of Schroeder (1970), which keep the peak low."""
    f = LOW * (HIGH / LOW) ** (np.arange(TONES) / (TONES - 1))
    phases = -np.pi * np.arange(TONES) * (np.arange(TONES) + 1) / TONES
    waves = np.sin(2.0 * np.pi * np.outer(t, f) + phases).sum(axis=1)
    return np.asarray(waves / max(float(np.abs(waves).max()), 1.0) * np.minimum(t / 0.2, 1.0))


def _steps(t: Floats) -> Floats:
    """Return random levels, held for 0.3 s, the same in every run."""
    levels = np.random.default_rng(0).uniform(-1.0, 1.0, int(t[-1] / 0.3) + 1)
    levels[0] = 0.0
    return np.asarray(levels[(t / 0.3).astype(int)])


def _breakaway(t: Floats) -> Floats:
    """Rise slowly from rest and return, pause, and do the same in the other direction."""
    part, within = (t // 2.5).astype(int), t % 2.5
    rise = np.clip(1.0 - np.abs(within - 1.0), 0.0, 1.0)
    return np.asarray(rise * np.where(part % 2 == 0, 1.0, -1.0))


def _loops(t: Floats) -> Floats:
    """Return growing loops, whose width shows play and hysteresis at every size."""
    sizes = np.array([0.1, 0.2, 0.4, 0.7, 1.0])
    part = np.minimum((t // 3.0).astype(int), len(sizes) - 1)
    return np.asarray(sizes[part] * np.sin(2.0 * np.pi * (t - 3.0 * part) / 1.5))


EXPERIMENTS: dict[str, Experiment] = {
    row.name: row
    for row in (
        Experiment(
            "friction_map", "ramps to and fro at five rates: friction over speed", 20.0, 0.4,
            _friction_map,
        ),
        Experiment(
            "slow_ramps", "slow ramps both ways: Coulomb friction, Stribeck, offsets", 16.0, 0.4,
            lambda t: _triangle(t, 8.0),
        ),
        Experiment("chirp", "0.5 to 60 Hz: inertia, stiffness, damping", 10.0, 0.15, _chirp),
        Experiment("multisine", "40 tones from 0.5 to 60 Hz: dynamics", 10.0, 0.25, _multisine),
        Experiment("steps", "random levels: delay, lag, rate limits", 10.0, 0.25, _steps),
        Experiment(
            "breakaway", "from rest until it moves, both sides: stiction", 10.0, 0.15, _breakaway
        ),
        Experiment(
            "ripple_scan", "one slow wide ramp both ways: ripple over angle", 20.0, 0.6,
            lambda t: _triangle(t, 20.0),
        ),
        Experiment(
            "backlash", "growing loops: play, hysteresis", 15.0, 0.2, _loops,
        ),
        Experiment(
            "stiffness", "growing wide loops: stiffness, hardening, hysteresis", 15.0, 0.6, _loops
        ),
    )
}  # fmt: skip
"""All experiments by their names."""


def experiment_torque(name: str, joint: Joint, limits: SafetyLimits, dt: float) -> Floats:
    """Return the motor torque of an experiment at every control step [N m], shape (samples,).

    Its size is its share of the torque limit, or less where the nominal joint would leave its
    limits. It starts and ends at zero.

    Args:
        name: One of `EXPERIMENTS`.
        joint: The nominal joint.
        limits: Limits of the joint.
        dt: Control step [s].

    Raises:
        UnknownNameError: There is no such experiment.
    """
    check_name("experiment", name, EXPERIMENTS)
    row = EXPERIMENTS[name]
    t = np.arange(round(row.seconds / dt), dtype=np.float64) * dt
    ends = np.clip(np.minimum(t, row.seconds - t) / 0.1, 0.0, 1.0)
    torque: Floats = np.asarray(row.share * limits.tau * row.shape(t) * ends, np.float64)
    return fitting_share(joint, torque, limits, dt) * torque


def fitting_share(joint: Joint, torque: Floats, limits: SafetyLimits, dt: float) -> float:
    """Return the share of a motor torque that keeps the nominal joint within its limits.

    Args:
        joint: The nominal joint.
        torque: At every control step [N m], shape (samples,).
        limits: Limits of the joint; `HEADROOM` of its motion is used.
        dt: Control step [s].
    """
    share = 1.0
    for _ in range(TRIALS):
        if _is_within(joint, share * torque, limits, dt):
            break
        share *= BACK_OFF
    return share


def _is_within(joint: Joint, torque: Floats, limits: SafetyLimits, dt: float) -> bool:
    record = joint.simulate(torque, dt=dt, held=True, dt_physics=dt / np.ceil(dt / 1e-4))
    p = joint.parameters
    twist = np.abs(record["true_tau"]).max() / p.get("k_b", np.inf)
    low, high = (HEADROOM * x if np.isfinite(x) else x for x in (limits.q_low, limits.q_high))
    return bool(
        np.abs(record["true_dq_m"]).max() <= HEADROOM * limits.dq_m
        and np.abs(record["true_tau"]).max() <= HEADROOM * limits.tau_joint
        and twist <= HEADROOM * limits.deflection
        and np.abs(torque).max() <= HEADROOM * limits.current * p.k_t * p.n
        and low <= record["true_q_m"].min()
        and record["true_q_m"].max() <= high
    )
