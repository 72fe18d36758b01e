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
from cjt_gym.blind.stepper import Moving, mobility, sensed_torque, step

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


class Bench(NamedTuple):
    """A joint, what chance does to it, and how its run is computed.

    Attributes:
        plant: Plant.
        drive: Drive.
        sensing: Sensors.
        frame: See `frame_of`.
        chances: Random numbers of the run.
        resolution: Of CHANNELS, shape (5,).
        fine_step: Longest step of the integrator [s].
    """

    plant: Plant
    drive: Drive
    sensing: Sensing
    frame: Frame
    chances: Chances
    resolution: Floats
    fine_step: float


class Kept(NamedTuple):
    """What a run keeps from sample to sample, changed in place.

    Attributes:
        past: Times [s] and torques [N m] of the fine steps so far, a ring of shape (2, PAST).
        counts: The newest of them, and the last command that arrived, shape (2,).
        lost: Angle of the counts that the encoder has lost [rad], shape (1,).
    """

    past: Floats
    counts: Ints
    lost: Floats


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


def bench_of(world: World, chances: Chances, fine_step: float = FINE_STEP) -> Bench:
    """Return a joint with what a run of it needs."""
    parts = packed(world.plant), packed(world.drive), packed(world.sensing)
    return Bench(*parts, frame_of(world), chances, np.array(world.resolution), fine_step)


@jit
def nothing_kept() -> Kept:
    """Return what a run keeps before its first sample."""
    return Kept(np.zeros((2, PAST)), np.zeros(2, np.int64), np.zeros(1))


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
    bench = bench_of(world, chances, fine_step)
    out = (command, measured, clean, states)
    _advance(bench, gains, (reference, given), every, x, out)
    return Run(command, measured, clean, states, chances.times)


@jit
def _advance(
    bench: Bench,
    gains: Gains,
    given: tuple[Floats, Floats],
    every: int,
    x: Floats,
    out: tuple[Floats, Floats, Floats, Floats],
) -> None:
    """Run all samples; results go to `out` in place."""
    reference, restarts = given
    command, measured, clean, states = out
    samples = len(reference)
    kept, memory = nothing_kept(), np.zeros(3)
    for k in range(samples):
        if every > 0 and k > 0 and k % every == 0:
            x[:] = restarts[k]
        look(bench, k, x, kept, clean[k], measured[k])
        states[k] = x
        command[k] = decide(gains, memory, reference, k, measured[k, 4])
        if k + 1 == samples:
            return
        move(bench, command, k, x, kept)


@jit
def look(bench: Bench, k: int, x: Floats, kept: Kept, clean: Floats, measured: Floats) -> float:
    """Take sample k; return the torque of the joint at that instant [N m].

    Args:
        bench: The joint and its run.
        k: Sample.
        x: State, shape (SIZE,).
        kept: What the run keeps.
        clean: Receives the measurements without noise, rounding and calibration errors, shape (5,).
        measured: Receives the measurements, shape (5,).
    """
    s, chances = bench.sensing, bench.chances
    past, counts, lost = kept
    t = chances.times[k]
    true, _ = sensed_torque(bench.plant, bench.frame.leads, x)
    if k == 0:
        past[0, :], past[1, :] = t - 1.0, true
        counts[1] = -1
    tau = late_torque(past, counts[0], t, s.delay, true) if s.delay > 0.0 else true
    lost[0] -= chances.lost[k] * np.sign(x[Q + 4])
    clean_channels(s, x, tau, t, clean)
    measure(s, clean, chances.channels[k], bench.resolution, lost[0], measured)
    return float(true)


@jit
def move(bench: Bench, command: Floats, k: int, x: Floats, kept: Kept) -> None:
    """Go from sample k to the next, in place.

    Args:
        bench: The joint and its run.
        command: Commands up to sample k [A].
        k: Sample.
        x: State, shape (SIZE,).
        kept: What the run keeps.
    """
    d, frame, times = bench.drive, bench.frame, bench.chances.times
    past, counts, _ = kept
    t = times[k]
    length = times[k + 1] - t
    steps = max(int(np.ceil(length / bench.fine_step - 1e-6)), 1)
    h = length / steps
    w, work = np.zeros((2, 4, 4)), np.zeros((4, 4))
    for contact in range(2):
        w[contact] = mobility(frame.mass, frame.damping[contact], frame.s, h)
    joint = Moving(bench.plant, d, frame.leads, frame.attach, w, work)
    for j in range(steps):
        now = t + j * h
        while counts[1] < k and times[counts[1] + 1] + d.delay <= now + 0.5 * h:
            counts[1] += 1
        value = command[counts[1]] if counts[1] >= 0 else 0.0
        tau = step(joint, x, value, bench.chances.process[k], now, h)
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
