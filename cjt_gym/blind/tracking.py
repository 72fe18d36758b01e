"""Closed loops for random joints: gains under which a joint is stable."""

from __future__ import annotations

import numpy as np

from cjt_gym.blind.control import Gains
from cjt_gym.blind.joints import Datasheet
from cjt_gym.blind.plant import Floats, Structure, World
from cjt_gym.blind.run import FINE_STEP, Chances, Run, draw_chances, run

TRIED, TRIAL_STEP = 2.0, 4e-5
"""Duration and fine step of a trial of gains [s]."""
TRIALS = 6
"""Number of times the gains are halved before only the feedforward remains."""
CLIPPED = 0.02
"""Share of samples at the current limit above which a loop counts as unstable."""
OVERSHOOT = 3.0
"""The same for the ratio of torque to reference, both rms."""


def first_gains(structure: Structure, sheet: Datasheet, rng: np.random.Generator) -> Gains:
    """Return suitable gains for the joint of a datasheet: PI or PD, with feedforward.

    Only part of the torque reaches a free load, so the feedforward also accelerates the motor.
    """
    p = sheet.values
    motor = p["I_m"] + p["I_g"]
    whole = 1.0 if structure.is_locked else 1.0 + motor / p["I_l"]
    rate = np.sqrt(p["k_b"] / motor * (whole if structure.bar_is_soft else 1.0))
    common = {
        "closed": 1.0,
        "per_ampere": 1.0 / (p["k_t"] * p["n"]),
        "limit": sheet.i_p,
        "ff": whole,
        "dt": sheet.dt,
        "smooth": float(np.exp(-2.0 * np.pi * min(120.0, 0.1 / sheet.dt) * sheet.dt)),
    }
    if rng.random() < 0.4:
        kp = rng.uniform(0.05, 0.3)
        return Gains(**common, kp=kp, ki=rng.uniform(0.5, 4.0))
    kp = rng.uniform(0.2, 1.2)
    return Gains(**common, kp=kp, kd=2.0 * rng.uniform(0.15, 0.5) / rate)


def is_stable(result: Run, reference: Floats, limit: float) -> bool:
    """Return whether a closed loop neither saturated nor diverged."""
    clipped = np.mean(np.abs(result.command) >= limit)
    size = np.sqrt(np.mean(result.measured[:, 4] ** 2) / np.mean(reference**2))
    return bool(clipped < CLIPPED and size < OVERSHOOT)


def halved(gains: Gains) -> Gains:
    """Return gains with half the feedback."""
    return gains._replace(kp=0.5 * gains.kp, ki=0.5 * gains.ki, kd=0.5 * gains.kd)


def under_control(
    world: World,
    reference: Floats,
    gains: Gains,
    rng: np.random.Generator,
    fine_step: float = FINE_STEP,
) -> Run:
    """Return a closed-loop run, whose gains are halved until it is stable.

    Two seconds of motion are tried first, then the whole run.

    Args:
        world: The true joint.
        reference: Reference of the joint torque [N m], shape (n,).
        gains: Initial gains.
        rng: Random numbers.
        fine_step: Longest step of the integrator in the whole run [s].
    """
    chances = draw_chances(world, len(reference), rng)
    moving = int(np.argmax(reference != 0.0))
    part = slice(moving, moving + round(TRIED / world.sampling))
    start = Chances(
        chances.channels[part],
        chances.process[part],
        *[values[: len(reference[part])] for values in (chances.times, chances.lost)],
    )
    for _ in range(TRIALS):
        trial = run(world, reference[part], gains, start, fine_step=TRIAL_STEP)
        if is_stable(trial, reference[part], gains.limit):
            result = run(world, reference, gains, chances, fine_step=fine_step)
            if is_stable(result, reference, gains.limit):
                return result
        gains = halved(gains)
    gains = gains._replace(kp=0.0, ki=0.0, kd=0.0)
    return run(world, reference, gains, chances, fine_step=fine_step)
