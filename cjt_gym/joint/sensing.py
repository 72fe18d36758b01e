"""From true values to what drive and sensors make of them: noise, steps, delay, filters."""

from __future__ import annotations

import math
from typing import Any

from cjt_gym.joint.arrays import (
    CURRENT_I,
    DQ_G,
    DQ_L,
    DQ_M,
    Q_G,
    Q_L,
    Q_M,
    TAU,
    Batch,
    Floats,
    Setup,
)
from cjt_gym.joint.compiled import compiled
from cjt_gym.joint.random_stream import normal
from cjt_gym.joint.substep import store_state


@compiled
def write_channels(
    p: Any, setup: Setup, x: Floats, currents: Floats, tau: float, load: float, out: Floats
) -> None:
    """Write the true values of all channels, shape (8,)."""
    store_state(setup, x, load, out[Q_M:TAU])
    out[CURRENT_I] = currents[0]
    out[TAU] = tau
    if setup.groups[1] != setup.groups[2]:
        out[TAU] = p.k_b * (out[Q_G] - out[Q_L]) + p.d_gl * (out[DQ_G] - out[DQ_L])


@compiled
def lateness(delay: float, setup: Setup) -> tuple[int, int]:
    """Split a delay [s] into whole control steps and substeps, rounded to a substep."""
    total = round(delay / setup.h)
    return total // setup.substeps, total % setup.substeps


@compiled
def condition_command(batch: Batch, setup: Setup, i: int, command: float) -> float:
    """Return the command as the drive receives it: with noise, quantized."""
    p = batch.p[i]
    if p.command_noise > 0.0:
        unit = 1.0 if setup.is_voltage else 1.0 / (p.k_t * p.n)
        command += p.command_noise * unit * normal(batch.rng, i)
    if p.command_resolution > 0.0:
        command = math.floor(command / p.command_resolution + 0.5) * p.command_resolution
    return command


@compiled
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


@compiled
def low_pass(old: float, new: float, cutoff: float, dt: float) -> float:
    """Advance a first-order low pass with unit gain and cut-off [Hz], exact for held input."""
    return old + (1.0 - math.exp(-2.0 * math.pi * cutoff * dt)) * (new - old)


@compiled
def measure(batch: Batch, setup: Setup, i: int, at: int, at_torque: int, first: bool) -> None:
    """Write what the sensors report: late, noisy, quantized, differentiated, filtered.

    Noise is added to the physical quantity and the sum is quantized. Where velocities are
    differentiated they are the backward difference of the measured angle, low-pass filtered.

    Args:
        batch: All joints.
        setup: What they share.
        i: Which joint.
        at: Place of the values in the ring of outputs.
        at_torque: Place of the torque.
        first: Whether this is the first measurement after a reset.
    """
    p = batch.p[i]
    new = batch.measured[i]
    old = new.copy()
    for channel in range(8):
        value = batch.outputs[i, at_torque if channel == TAU else at, channel]
        noise, resolution = sensor(p, channel)
        if noise > 0.0:
            value += noise * normal(batch.rng, i)
        if resolution > 0.0:
            value = math.floor(value / resolution + 0.5) * resolution
        new[channel] = value
    if p.torque_cutoff > 0.0 and not first:
        new[TAU] = low_pass(old[TAU], new[TAU], p.torque_cutoff, setup.dt)
    if p.velocity_cutoff > 0.0:
        for body in range(3):
            rate = 0.0 if first else (new[Q_M + body] - old[Q_M + body]) / setup.dt
            before = rate if first else old[DQ_M + body]
            new[DQ_M + body] = low_pass(before, rate, p.velocity_cutoff, setup.dt)
