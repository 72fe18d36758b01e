"""One run of a joint: take a sample, decide on a command, advance to the next sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cjt_gym.blind.compiled import jit
from cjt_gym.blind.control import Gains, decide
from cjt_gym.blind.laws import dampings, inertias, selection
from cjt_gym.blind.plant import GEAR, LOAD, Drive, Floats, Ints, Plant, Sensing, World, packed
from cjt_gym.blind.sensors import clean_channels, measure
from cjt_gym.blind.state import SIZE, Q, initial_state
from cjt_gym.blind.stepper import mobility, sensed_torque, step

FINE_STEP = 1e-5
"""Longest step of the integrator [s]."""
PAST = 8192
"""Number of fine steps whose torque is stored for a late torque sensor; a power of two."""


class Chances(NamedTuple):
    """Random numbers of a run, drawn beforehand.

    Attributes:
        channels: Noise of the measurements [their units], shape (n, 5).
        process: Torque on the motor, held from sample to sample [N m], shape (n,).
        times: Instants at which samples are taken [s], shape (n,).
        lost: Encoder counts lost at each sample, shape (n,).
    """

    channels: Floats
    process: Floats
    times: Floats
    lost: Floats


class Frame(NamedTuple):
    """The parts of a run that do not depend on time.

    Attributes:
        leads: The body whose motion each body shares, shape (4,).
        attach: Body that the mount is attached to.
        mass: Inertias, shape (4, 4).
        damping: Dampings with open and with closed contact, shape (2, 4, 4).
        s: Selection of the free coordinates, shape (4, coordinates).
    """

    leads: Ints
    attach: int
    mass: Floats
    damping: Floats
    s: Floats


@dataclass(frozen=True)
class Run:
    """Results of a run."""

    command: Floats  # command at every sample [A], shape (n,)
    measured: Floats  # measurements of CHANNELS, shape (n, 5)
    clean: Floats  # the same without noise, rounding and calibration errors, shape (n, 5)
    states: Floats  # states, shape (n, SIZE)
    times: Floats  # instants at which the samples were taken [s], shape (n,)


def frame_of(world: World) -> Frame:
    """Return the parts of a run that do not depend on time."""
    p, structure = world.plant, world.structure
    attach = GEAR if structure.is_locked else LOAD
    soft = structure.gear_is_soft
    open_contact = dampings(p, attach, gear=False, bar=soft)
    closed = dampings(p, attach, gear=True, bar=True)
    return Frame(
        structure.lead_array,
        attach,
        inertias(p),
        np.stack([open_contact, closed]),
        selection(structure.leads),
    )


def instants(dt: float, samples: int) -> Floats:
    """Return the nominal instants of the samples [s], shape (samples,)."""
    return np.arange(samples, dtype=np.float64) * dt


def draw_chances(world: World, samples: int, rng: np.random.Generator) -> Chances:
    """Return the random numbers of a run of a world."""
    noise = rng.standard_normal((samples, 5)) * np.array(world.noise)
    process = rng.standard_normal(samples) * world.process
    jitter = np.clip(rng.standard_normal(samples), -3.0, 3.0) * world.jitter
    times = np.maximum(instants(world.sampling, samples) + jitter, 0.0)
    missing = rng.random(samples) < world.lost * world.sampling
    lost = np.where(missing, rng.integers(1, 12, samples), 0) * world.sensing.counts
    return Chances(noise, process, times, lost)


def no_chances(world: World, samples: int) -> Chances:
    """Return the random numbers of a deterministic run."""
    zero = np.zeros(samples)
    return Chances(np.zeros((samples, 5)), zero, instants(world.sampling, samples), zero)


def run(
    world: World,
    reference: Floats,
    gains: Gains,
    chances: Chances,
    restarts: Floats | None = None,
    every: int = 0,
    fine_step: float = FINE_STEP,
) -> Run:
    """Run a joint.

    Args:
        world: The joint.
        reference: Reference of the joint torque [N m], or the current [A] where the loop is open;
            shape (n,).
        gains: Controller.
        chances: Random numbers for as many samples.
        restarts: States to restart from, shape (n, SIZE).
        every: Number of samples after which the run restarts from there; 0 for never.
        fine_step: Longest step of the integrator [s].
    """
    samples = len(reference)
    given = np.zeros((1, SIZE)) if restarts is None else restarts
    x = initial_state(world) if restarts is None else restarts[0].copy()
    command, states = np.zeros(samples), np.zeros((samples, SIZE))
    measured, clean = np.zeros((samples, 5)), np.zeros((samples, 5))
    _advance(
        (packed(world.plant), packed(world.drive), packed(world.sensing)),
        frame_of(world),
        gains,
        chances,
        (np.array(world.resolution), reference, given),
        every,
        fine_step,
        x,
        (command, measured, clean, states),
    )
    return Run(command, measured, clean, states, chances.times)


@jit
def _advance(
    joint: tuple[Plant, Drive, Sensing],
    frame: Frame,
    gains: Gains,
    chances: Chances,
    given: tuple[Floats, Floats, Floats],
    every: int,
    fine_step: float,
    x: Floats,
    out: tuple[Floats, Floats, Floats, Floats],
) -> None:
    """Run all samples; results go to `out` in place."""
    resolution, reference, restarts = given
    command, measured, clean, states = out
    samples = len(reference)
    past, counts, lost, memory = (
        np.zeros((2, PAST)),
        np.zeros(2, np.int64),
        np.zeros(1),
        np.zeros(3),
    )
    for k in range(samples):
        if every > 0 and k > 0 and k % every == 0:
            x[:] = restarts[k]
        look(joint, frame, chances, resolution, k, x, (past, counts, lost), clean[k], measured[k])
        states[k] = x
        command[k] = decide(gains, memory, reference, k, measured[k, 4])
        if k + 1 == samples:
            return
        move(joint, frame, chances, command, k, fine_step, x, (past, counts))


@jit
def look(
    joint: tuple[Plant, Drive, Sensing],
    frame: Frame,
    chances: Chances,
    resolution: Floats,
    k: int,
    x: Floats,
    kept: tuple[Floats, Ints, Floats],
    clean: Floats,
    measured: Floats,
) -> float:
    """Take sample k; return the torque of the joint at that instant [N m].

    Args:
        joint: Its parts.
        frame: See `frame_of`.
        chances: Random numbers of the run.
        resolution: Of CHANNELS, shape (5,).
        k: Sample.
        x: State, shape (SIZE,).
        kept: Torques of the fine steps so far, shape (2, PAST); newest of them and last command
            that arrived, shape (2,); counts that the encoder has lost [rad], shape (1,); in place.
        clean: Receives the measurements without noise, rounding and calibration errors, shape (5,).
        measured: Receives the measurements, shape (5,).
    """
    p, _, s = joint
    past, counts, lost = kept
    t = chances.times[k]
    true, _ = sensed_torque(p, frame.leads, x)
    if k == 0:
        past[0, :], past[1, :] = t - 1.0, true
        counts[1] = -1
    tau = late_torque(past, counts[0], t, s.delay, true) if s.delay > 0.0 else true
    lost[0] -= chances.lost[k] * np.sign(x[Q + 4])
    clean_channels(s, x, tau, t, clean)
    measure(s, clean, chances.channels[k], resolution, lost[0], measured)
    return float(true)


@jit
def move(
    joint: tuple[Plant, Drive, Sensing],
    frame: Frame,
    chances: Chances,
    command: Floats,
    k: int,
    fine_step: float,
    x: Floats,
    kept: tuple[Floats, Ints],
) -> None:
    """Go from sample k to the next, in place.

    Args:
        joint: Its parts.
        frame: See `frame_of`.
        chances: Random numbers of the run.
        command: Commands up to sample k [A].
        k: Sample.
        fine_step: Longest step of the integrator [s].
        x: State, shape (SIZE,).
        kept: As in `look`.
    """
    p, d, _ = joint
    past, counts = kept
    t = chances.times[k]
    length = chances.times[k + 1] - t
    steps = max(int(np.ceil(length / fine_step - 1e-6)), 1)
    h = length / steps
    w, work = np.zeros((2, 4, 4)), np.zeros((4, 4))
    for contact in range(2):
        w[contact] = mobility(frame.mass, frame.damping[contact], frame.s, h)
    for j in range(steps):
        now = t + j * h
        while counts[1] < k and chances.times[counts[1] + 1] + d.delay <= now + 0.5 * h:
            counts[1] += 1
        value = command[counts[1]] if counts[1] >= 0 else 0.0
        noise = chances.process[k]
        tau = step(p, d, frame.leads, frame.attach, w, x, work, value, noise, now, h)
        counts[0] = (counts[0] + 1) % PAST
        past[0, counts[0]], past[1, counts[0]] = now + 0.5 * h, tau


@jit
def late_torque(past: Floats, head: int, now: float, delay: float, latest: float) -> float:
    """Return a past torque, interpolated between the fine steps [N m].

    Args:
        past: Times [s] and torques [N m] of the latest fine steps, a ring of shape (2, PAST).
        head: Index of the last one.
        now: Time [s].
        delay: How long ago [s].
        latest: Torque now [N m].
    """
    after_t, after = now, latest
    for back in range(PAST):
        j = (head - back) % PAST
        if past[0, j] <= now - delay:
            share = (now - delay - past[0, j]) / (after_t - past[0, j])
            return float(past[1, j] + share * (after - past[1, j]))
        after_t, after = past[0, j], past[1, j]
    return after
