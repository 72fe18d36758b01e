"""From true values to commands and measurements: noise, quantization, delay, filters."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.arrays import (
    CURRENT_I,
    DQ_G,
    DQ_L,
    DQ_M,
    DRIFT,
    LATE,
    LATE_SUB,
    OLD,
    Q_G,
    Q_L,
    Q_M,
    TAU,
    Batch,
    Floats,
    OneJoint,
    Setup,
    X,
)
from cjt_gym.joint.kernel.compiled import apart, lean
from cjt_gym.joint.kernel.random_stream import normal, uniform
from cjt_gym.joint.kernel.springs import BAR, is_nonlinear, spring_torque
from cjt_gym.joint.kernel.substep import store_state


@lean
def write_channels(joint: OneJoint, tau: float, load: float, out: Floats) -> None:
    """Write the true values of all channels, shape (8,)."""
    p, setup = joint.p, joint.setup
    store_state(setup, joint.work[X], load, out[Q_M:TAU])
    out[CURRENT_I] = joint.currents[0]
    out[TAU] = tau
    if setup.groups[1] != setup.groups[2]:
        bend, rate = out[Q_G] - out[Q_L], out[DQ_G] - out[DQ_L]
        if is_nonlinear(p, setup.groups, BAR):
            out[TAU] = spring_torque(p, joint.memory, setup.groups, BAR, bend, rate)
        else:
            out[TAU] = p.k_b * bend + p.d_gl * rate


@lean
def lateness(delay: float, setup: Setup) -> tuple[int, int]:
    """Split a delay [s] into whole control steps and substeps, rounded to a substep."""
    total = round(delay / setup.h)
    return total // setup.substeps, total % setup.substeps


@lean
def is_late(p: Any) -> bool:
    """Whether any measurement arrives late."""
    return bool(
        p.measurement_delay + p.late_i + p.late_q_m + p.late_q_g + p.late_q_l + p.late_tau > 0.0
    )


@lean
def own_lateness(p: Any, channel: int) -> float:
    """Return the delay of a single channel [s]; a velocity shares that of its angle."""
    if channel == CURRENT_I:
        return float(p.late_i)
    if channel in (Q_M, DQ_M):
        return float(p.late_q_m)
    if channel in (Q_G, DQ_G):
        return float(p.late_q_g)
    if channel in (Q_L, DQ_L):
        return float(p.late_q_l)
    return float(p.late_tau)


@lean
def plan_lateness(p: Any, setup: Setup, work: Floats) -> bool:
    """Write by how many steps and substeps each channel is late; return whether any is."""
    if not is_late(p):
        return False
    for channel in range(8):
        steps, rest = lateness(p.measurement_delay + own_lateness(p, channel), setup)
        work[LATE, channel], work[LATE_SUB, channel] = steps, rest
    return True


@apart
def take_snapshot(
    joint: OneJoint, s: int, tau: float, load: float, out: Floats, snapshot: Floats
) -> None:
    """Keep the channels whose reported instant is the start of substep s.

    `out` is scratch for all channels and `snapshot` the result, shape (8,) each.
    """
    wanted, substeps, work = False, joint.setup.substeps, joint.work
    for channel in range(8):
        wanted = wanted or substeps - work[LATE_SUB, channel] == s
    if wanted:
        write_channels(joint, tau, load, out)
        for channel in range(8):
            if substeps - work[LATE_SUB, channel] == s:
                snapshot[channel] = out[channel]


@lean
def condition_command(batch: Batch, setup: Setup, i: int, command: float) -> float:
    """Return the command as the drive receives it: with noise, quantized."""
    p = batch.p[i]
    if p.command_noise > 0.0:
        unit = 1.0 if setup.is_voltage else 1.0 / (p.k_t * p.n)
        command += p.command_noise * unit * normal(batch.rng, i)
    if p.command_resolution > 0.0:
        command = math.floor(command / p.command_resolution + 0.5) * p.command_resolution
    return command


@lean
def sensor(p: Any, channel: int) -> tuple[float, float]:
    """Return noise (standard deviation) and resolution of a channel, in its unit."""
    if channel == CURRENT_I:
        return p.noise_i, p.resolution_i
    if channel == Q_M:
        return p.noise_q_m, p.resolution_q_m
    if channel == Q_G:
        return p.noise_q_g, p.resolution_q_g
    if channel == Q_L:
        return p.noise_q_l, p.resolution_q_l
    if channel == TAU:
        return p.noise_tau, p.resolution_tau
    return 0.0, 0.0


@lean
def low_pass(old: float, new: float, cutoff: float, dt: float) -> float:
    """Advance a first-order low pass with unit gain and cut-off [Hz], exact for held input."""
    return old + (1.0 - math.exp(-2.0 * math.pi * cutoff * dt)) * (new - old)


@lean
def distorts(p: Any) -> bool:
    """Whether any sensor has a wrong gain or zero, drifts, or runs off centre."""
    return bool(
        p.gain_i != 1.0
        or p.gain_q_m != 1.0
        or p.gain_q_g != 1.0
        or p.gain_q_l != 1.0
        or p.gain_tau != 1.0
        or p.bias_i != 0.0
        or p.bias_q_m != 0.0
        or p.bias_q_g != 0.0
        or p.bias_q_l != 0.0
        or p.bias_tau != 0.0
        or p.drift_i + p.drift_q_m + p.drift_q_g + p.drift_q_l + p.drift_tau > 0.0
        or p.eccentricity_q_m + p.eccentricity_q_g + p.eccentricity_q_l > 0.0
    )


@lean
def encoder(p: Any, body: int) -> tuple[float, float, float, float]:
    """Return gain, eccentricity [rad], turns per revolution, and bias [rad] of an encoder."""
    if body == 0:
        return p.gain_q_m, p.eccentricity_q_m, p.eccentricity_turns, p.bias_q_m
    if body == 1:
        return p.gain_q_g, p.eccentricity_q_g, 1.0, p.bias_q_g
    return p.gain_q_l, p.eccentricity_q_l, 1.0, p.bias_q_l


@apart
def distort(p: Any, memory: Floats, new: Floats) -> None:
    """Apply gain, eccentricity, bias and drift to all channels, in place."""
    for body in range(3):
        gain, off_centre, turns, bias = encoder(p, body)
        q, dq = new[Q_M + body], new[DQ_M + body]
        if off_centre > 0.0:
            angle = turns * q + p.eccentricity_phase
            q += off_centre * math.sin(angle)
            dq += off_centre * turns * math.cos(angle) * dq
        new[Q_M + body] = gain * q + bias + memory[DRIFT + 1 + body]
        new[DQ_M + body] = gain * dq
    new[CURRENT_I] = p.gain_i * new[CURRENT_I] + p.bias_i + memory[DRIFT]
    new[TAU] = p.gain_tau * new[TAU] + p.bias_tau + memory[DRIFT + 4]


@apart
def walk(p: Any, memory: Floats, dt: float, rng: NDArray[np.uint64], i: int) -> None:
    """Let the zeros of joint i drift over a control step."""
    root = math.sqrt(dt)
    rates = (p.drift_i, p.drift_q_m, p.drift_q_g, p.drift_q_l, p.drift_tau)
    for j in range(5):
        if rates[j] > 0.0:
            memory[DRIFT + j] += rates[j] * root * normal(rng, i)


@lean
def measure(batch: Batch, setup: Setup, i: int, first: bool, late: bool, work: Floats) -> None:
    """Write the reported values: delayed, distorted, noisy, quantized, differentiated, filtered.

    Noise is added to the physical quantity and the sum is quantized. Where velocities are
    differentiated they are the backward difference of the measured angle, low-pass filtered. A
    lost frame leaves the measurement as it was. Rows of `work` hold how late each channel is.
    """
    p, memory = batch.p[i], batch.memory[i]
    distorted = distorts(p)
    if distorted and not first:
        walk(p, memory, setup.dt, batch.rng, i)
    if p.dropout > 0.0 and not first and uniform(batch.rng, i) < p.dropout:
        return
    new, depth = batch.measured[i], batch.outputs.shape[1]
    old = work[OLD]
    newest = batch.samples[i]
    for channel in range(8):
        old[channel] = new[channel]
        at = newest - int(work[LATE, channel]) if late else newest
        new[channel] = batch.outputs[i, at % depth, channel]
    if distorted:
        distort(p, memory, new)
    for channel in range(8):
        noise, resolution = sensor(p, channel)
        if noise > 0.0:
            new[channel] += noise * normal(batch.rng, i)
        if resolution > 0.0:
            new[channel] = math.floor(new[channel] / resolution + 0.5) * resolution
    if p.torque_cutoff > 0.0 and not first:
        new[TAU] = low_pass(old[TAU], new[TAU], p.torque_cutoff, setup.dt)
    if p.velocity_cutoff > 0.0:
        for body in range(3):
            rate = 0.0 if first else (new[Q_M + body] - old[Q_M + body]) / setup.dt
            before = rate if first else old[DQ_M + body]
            new[DQ_M + body] = low_pass(before, rate, p.velocity_cutoff, setup.dt)
