"""The simulation step: one for all structures, drives and effects, over a batch of joints.

A substep of length h advances the linear joint exactly for forces that are constant over it.
Forces that resist motion (friction, the voltage limit of a drive without inductance) are
taken at the *mean* velocity over the substep, v = (z(h) - z(0)) / h:

    v + W R(v) = v_free,      W = B_z / h,

where v_free is the mean velocity without them and W, symmetric and positive definite, is the
mean velocity that a unit of constant torque adds. The work of such a force over the substep
is then exactly -h R(v) v <= 0, so that no substep creates energy, whatever its length. The
equation is the optimality condition of a convex function and is solved coordinate by
coordinate; with sharp friction (dq_0 = 0) a coordinate that settles at v = 0 keeps its
position exactly and comes to rest. Forces of position (ripple) are taken at the middle of the
free motion. Currents of drives with inductance advance exactly for half a substep on either
side of the mechanics. The order of convergence is two.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cjt_gym.joint.drives import CURRENT, STATIC, advance_currents, clip, static_current
from cjt_gym.joint.friction import LOAD, coulomb_levels, friction, has_friction
from cjt_gym.joint.random_stream import normal
from cjt_gym.joint.ripple import ripple_torque

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

CHANNELS = ("i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
CURRENT_I, Q_M, Q_G, Q_L, DQ_M, DQ_G, DQ_L, TAU = range(8)
SWEEPS = 100
NEWTON = 12
ITERATIONS = 60
LARGEST = 1e12


class Setup(NamedTuple):
    """What all joints of a batch share.

    Attributes:
        groups: Coordinate of motor, gear and load, -1 for a prescribed load.
        size: Number of coordinates.
        order: Number of mechanical states.
        drive: Number of the drive.
        is_voltage: Whether commands are voltages [V]; else currents [A].
        h: Substep [s].
        substeps: Substeps per control step.
        dt: Control step [s].
    """

    groups: tuple[int, int, int]
    size: int
    order: int
    drive: int
    is_voltage: bool
    h: float
    substeps: int
    dt: float


class Batch(NamedTuple):
    """The arrays of n joints; the kernel changes all but p, ripple, a and b.

    Attributes:
        p: Parameter records, shape (n,).
        ripple: Rows [f, a, b, kind], shape (n, rows, 4).
        a: Discrete system matrix of a substep, shape (n, order, order).
        b: Its inputs: motor torque, load input, torque per coordinate; (n, order, 2 + size).
        state: [q_m q_g q_l dq_m dq_g dq_l], shape (n, 6) [rad, rad/s].
        currents: [i_q, i_d], shape (n, 2) [A].
        tau: Transmitted joint torque, shape (n,) [N m].
        snapshot: Channel values within the step for all channels and for tau, shape (n, 2, 8).
        commands: Ring of the last commands (q and d axis), shape (n, depth, 2).
        outputs: Ring of the last true channel values, shape (n, depth, 8).
        measured: Latest measured channel values, shape (n, 8).
        samples: Control steps since reset, shape (n,).
        rng: Random streams, shape (n,).
    """

    p: Any
    ripple: Floats
    a: Floats
    b: Floats
    state: Floats
    currents: Floats
    tau: Floats
    snapshot: Floats
    commands: Floats
    outputs: Floats
    measured: Floats
    samples: Integers
    rng: NDArray[np.uint64]


# Rows of the scratch array of one substep, shape (13, 8), so that none is allocated in it.
X = 0  # state at the start of the substep
FREE = 1  # state at its end
SPEED = 2  # mean velocities of the coordinates
FREE_SPEED = 3  # the same without resisting torques
RESIST = 4  # resisting torques
GUESS = 5  # mean velocities of the substep before, from which the search starts
REST = 6  # residuals of the search
SLOPE = 7  # slopes of the resisting torques
ACTIVE = 8  # 1 where anything resists a coordinate
JACOBIAN = 9  # three rows
RIPPLE = 12  # ripple torque of the substep before, and 1 where there was one
WORK_ROWS, WORK_WIDTH = 13, 8


@njit(cache=True)
def load_state(setup: Setup, state: Floats, x: Floats) -> None:
    """Copy the bodies' state, shape (6,), into the structure's own, shape (order,)."""
    for body in range(3):
        g = setup.groups[body]
        if g >= 0:
            x[g] = state[body]
            x[setup.order - setup.size + g] = state[3 + body]
        else:
            x[setup.size] = state[body]


@njit(cache=True)
def store_state(setup: Setup, x: Floats, load: float, state: Floats) -> None:
    """Copy the structure's state back to the bodies; `load` is the velocity of a fixed one."""
    for body in range(3):
        g = setup.groups[body]
        if g >= 0:
            state[body] = x[g]
            state[3 + body] = x[setup.order - setup.size + g]
        else:
            state[body] = x[setup.size]
            state[3 + body] = load


@njit(cache=True)
def resistance(
    p: Any, setup: Setup, g: int, command: float, v: float, side: float
) -> tuple[float, float]:
    """Return the resisting torque on coordinate g at mean velocity v, and its slope."""
    torque, slope = 0.0, 0.0
    for body in range(3):
        if setup.groups[body] == g:
            t, s = friction(p, body, v, side)
            torque += t
            slope += s
    if setup.drive == STATIC and setup.groups[0] == g:
        k = p.k_t * p.n
        current, s = static_current(p, command, setup.is_voltage, v)
        torque -= k * current
        slope -= k * s
    return torque, slope


@njit(cache=True)
def resists(p: Any, setup: Setup, g: int) -> bool:
    """Whether anything resists the motion of coordinate g."""
    for body in range(3):
        if setup.groups[body] == g and has_friction(p, body):
            return True
    return bool(setup.drive == STATIC and setup.groups[0] == g)


@njit(cache=True)
def coulomb_sum(p: Any, groups: tuple[int, int, int], g: int, side: float) -> float:
    """Return the Coulomb level of coordinate g in the direction of `side` [N m]."""
    total = 0.0
    for body in range(3):
        if groups[body] == g:
            up, down = coulomb_levels(p, body)
            total += up if side > 0.0 else down
    return total


@njit(cache=True)
def settle(
    p: Any, setup: Setup, g: int, command: float, w: float, target: float
) -> tuple[float, float]:
    """Solve v + w R(v) = target for one coordinate.

    Newton's method from the side of rest, where R is concave in speed, so that it approaches
    the root from one side; a bracket guards the kinks.

    Returns:
        The mean velocity v [rad/s] and R(v) [N m]; v is exactly zero where the resistance
        holds the coordinate.
    """
    up, _ = resistance(p, setup, g, command, 0.0, 1.0)
    down, _ = resistance(p, setup, g, command, 0.0, -1.0)
    if w * down <= target <= w * up:
        return 0.0, target / w
    side = 1.0 if target > w * up else -1.0
    v = side * max(0.0, side * target - w * coulomb_sum(p, setup.groups, g, side))
    low, high = 0.0, math.inf
    torque = 0.0
    for _ in range(ITERATIONS):
        torque, slope = resistance(p, setup, g, command, v, side)
        rest = v + w * torque - target
        if rest * side < 0.0:
            low = abs(v)
        else:
            high = abs(v)
        step = rest / (1.0 + w * slope)
        new = v - step
        if not low <= new * side <= high:
            new = side * 0.5 * (low + min(high, 2.0 * low + abs(step)))
        if abs(new - v) <= 1e-14 * (abs(new) + abs(target)):
            v = new
            break
        v = new
    return v, (target - v) / w


@njit(cache=True)
def eliminate(work: Floats, n: int) -> None:
    """Solve the Jacobian's equations for the residuals, in place in both.

    The Jacobian is the identity plus a positive definite matrix times non-negative slopes, so
    that no pivoting is needed.
    """
    for k in range(n):
        for i in range(k + 1, n):
            factor = work[JACOBIAN + i, k] / work[JACOBIAN + k, k]
            for j in range(k + 1, n):
                work[JACOBIAN + i, j] -= factor * work[JACOBIAN + k, j]
            work[REST, i] -= factor * work[REST, k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            work[REST, k] -= work[JACOBIAN + k, j] * work[REST, j]
        work[REST, k] /= work[JACOBIAN + k, k]


@njit(cache=True)
def search(p: Any, setup: Setup, b: Floats, command: float, work: Floats) -> bool:
    """Try Newton's method from the mean velocities of the substep before.

    Returns:
        Whether it converged; then rows SPEED and RESIST hold the solution.
    """
    size = setup.size
    for g in range(size):
        work[SPEED, g] = work[GUESS, g] if work[ACTIVE, g] == 1.0 else work[FREE_SPEED, g]
    for _ in range(NEWTON):
        for g in range(size):
            work[REST, g] = work[SPEED, g] - work[FREE_SPEED, g]
            for other in range(size):
                work[JACOBIAN + g, other] = 1.0 if g == other else 0.0
        for other in range(size):
            if work[ACTIVE, other] == 1.0:
                v = work[SPEED, other]
                side = 1.0 if v >= 0.0 else -1.0
                torque, slope = resistance(p, setup, other, command, v, side)
                work[RESIST, other], work[SLOPE, other] = torque, slope
                for g in range(size):
                    w = b[g, 2 + other] / setup.h
                    work[REST, g] += w * torque
                    work[JACOBIAN + g, other] += w * slope
        eliminate(work, size)
        largest = 0.0
        for g in range(size):
            work[SPEED, g] -= work[REST, g]
            if work[ACTIVE, g] == 1.0:
                work[RESIST, g] -= work[SLOPE, g] * work[REST, g]
                largest = max(largest, abs(work[REST, g]) - 1e-9 * abs(work[SPEED, g]))
        if largest <= 1e-7 * p.dq_0:
            return True
    return False


@njit(cache=True)
def descend(p: Any, setup: Setup, b: Floats, command: float, work: Floats) -> None:
    """Minimise one coordinate after the other; it converges whatever the coupling."""
    work[RESIST, :] = 0.0
    for _ in range(SWEEPS):
        change = 0.0
        for g in range(setup.size):
            if work[ACTIVE, g] == 0.0:
                continue
            target, w = work[FREE_SPEED, g], b[g, 2 + g] / setup.h
            for other in range(setup.size):
                if other != g:
                    target -= b[g, 2 + other] / setup.h * work[RESIST, other]
            v, torque = settle(p, setup, g, command, w, target)
            change = max(change, abs(torque - work[RESIST, g]) * w - 1e-13 * abs(target))
            work[SPEED, g], work[RESIST, g] = v, torque
        if change <= 1e-15:
            break


@njit(cache=True)
def resist(p: Any, setup: Setup, b: Floats, command: float, work: Floats) -> bool:
    """Find mean velocities and resisting torques from the free ones; False if none resists."""
    active = 0.0
    for g in range(setup.size):
        active += work[ACTIVE, g]
    if active == 0.0:
        return False
    if p.dq_0 == 0.0 or not search(p, setup, b, command, work):
        descend(p, setup, b, command, work)
    for g in range(setup.size):
        work[GUESS, g] = work[SPEED, g]
    return True


@njit(cache=True)
def come_to_rest(p: Any, setup: Setup, b: Floats, work: Floats) -> None:
    """Hold the coordinates that sharp friction has stopped: exact position, no velocity.

    A coordinate is held if it did not move in the mean, or if it turned within the substep
    although friction could have held it. Both only take kinetic energy away.
    """
    for g in range(setup.size):
        up = coulomb_sum(p, setup.groups, g, 1.0)
        down = coulomb_sum(p, setup.groups, g, -1.0)
        if up + down == 0.0:
            continue
        row = setup.order - setup.size + g
        if work[SPEED, g] == 0.0:
            work[FREE, g], work[FREE, row] = work[X, g], 0.0
        elif work[FREE, row] * work[SPEED, g] < 0.0:
            needed = (work[FREE, row] - work[X, row]) / b[row, 2 + g] + work[RESIST, g]
            if -down <= needed <= up:
                work[FREE, row] = 0.0


@njit(cache=True)
def shift(b: Floats, setup: Setup, sign: float, work: Floats) -> None:
    """Add the effect of the resisting torques in row RESIST to the end of the substep."""
    for g in range(setup.size):
        if work[ACTIVE, g] == 1.0:
            for i in range(setup.order):
                work[FREE, i] += sign * b[i, 2 + g] * work[RESIST, g]


@njit(cache=True)
def mesh_torque(p: Any, setup: Setup, tau_rigid: float, work: Floats) -> float:
    """Return the torque that the gear transmits, averaged over the substep [N m].

    Row FREE holds the motion under the resisting torques of the substep before.
    """
    one, other = setup.groups[0], setup.groups[1]
    stiffness, damping = p.k_g, p.d_mg
    if one == other:
        other = setup.groups[2]
        stiffness, damping = p.k_b, p.d_gl
    if one == other:
        return tau_rigid
    if other < 0:
        other = setup.size
    start = work[X, one] - work[X, other]
    end = work[FREE, one] - work[FREE, other]
    return float(stiffness * 0.5 * (start + end) + damping * (end - start) / setup.h)


@njit(cache=True)
def position_torque(p: Any, ripple: Floats, setup: Setup, tau: float, work: Floats) -> float:
    """Return the torque on the motor that depends on position, at the middle of the substep."""
    g = setup.groups[0]
    row = setup.order - setup.size + g
    middle = 0.5 * (work[X, g] + work[FREE, g])
    q_m = middle + 0.125 * setup.h * (work[X, row] - work[FREE, row])
    return ripple_torque(ripple, q_m, tau, p.cogging_scale, p.gear_ripple_scale)


@njit(cache=True)
def settled_ripple(
    p: Any, ripple: Floats, b: Floats, setup: Setup, tau: float, work: Floats
) -> float:
    """Return the ripple torque of a substep [N m].

    What the gear transmits depends on the motion that friction and ripple themselves cause; both
    are predicted by the substep before, and by a second pass where there was none.
    """
    passes = 1 if work[RIPPLE, 1] == 1.0 else 2
    work[RIPPLE, 1] = 1.0
    for _ in range(passes):
        before = work[RIPPLE, 0]
        shift(b, setup, -1.0, work)
        for i in range(setup.order):
            work[FREE, i] += b[i, 0] * before
        torque = position_torque(p, ripple, setup, mesh_torque(p, setup, tau, work), work)
        shift(b, setup, 1.0, work)
        for i in range(setup.order):
            work[FREE, i] -= b[i, 0] * before
        work[RIPPLE, 0] = torque
    return float(work[RIPPLE, 0])


@njit(cache=True)
def rigid_torque(p: Any, setup: Setup, load: float, work: Floats) -> float:
    """Return the mean torque that a rigid joint passed on to its load over a substep [N m]."""
    v = (work[FREE, 0] - work[X, 0]) / setup.h
    side = 1.0 if v >= 0.0 else -1.0
    drag, _ = friction(p, LOAD, v, side)
    if v == 0.0 and p.dq_0 == 0.0:
        total = coulomb_sum(p, setup.groups, 0, side)
        drag = work[RESIST, 0] * abs(drag) / total if total > 0.0 else 0.0
    acceleration = (work[FREE, 1] - work[X, 1]) / setup.h
    return float(p.I_l * acceleration + p.d_l * v + drag - load)


@njit(cache=True)
def substep(
    p: Any,
    ripple: Floats,
    a: Floats,
    b: Floats,
    setup: Setup,
    currents: Floats,
    tau: float,
    command: float,
    command_d: float,
    load: float,
    work: Floats,
) -> float:
    """Advance one joint by h, in place (row X, currents); return the rigid joint's torque.

    Args:
        p: Parameter record.
        ripple: Its ripple rows, shape (rows, 4).
        a: Discrete system matrix, shape (order, order).
        b: Discrete inputs, shape (order, 2 + size).
        setup: What the batch shares.
        currents: [i_q, i_d] [A].
        tau: Transmitted torque of the last substep [N m], which counts if the joint is rigid.
        command: Current [A] or voltage [V] on the q axis.
        command_d: Voltage on the d axis [V].
        load: Load torque [N m] or, where the output is fixed, load velocity [rad/s].
        work: Scratch rows, with the state in row X.
    """
    order, size, drive = setup.order, setup.size, setup.drive
    motor, half = order - size + setup.groups[0], 0.5 * setup.h
    is_voltage = setup.is_voltage
    if drive == CURRENT:
        currents[0] = clip(command, p.i_p)
    elif drive != STATIC:
        advance_currents(p, drive, currents, command, command_d, is_voltage, work[X, motor], half)
    tau_m = p.torque_offset
    if drive != STATIC:
        tau_m += p.k_t * p.n * currents[0]
    for i in range(order):
        value = b[i, 0] * tau_m + b[i, 1] * load
        for j in range(order):
            value += a[i, j] * work[X, j]
        work[FREE, i] = value
    if ripple.shape[0] > 0:
        extra = settled_ripple(p, ripple, b, setup, tau, work)
        for i in range(order):
            work[FREE, i] += b[i, 0] * extra
    for g in range(size):
        work[FREE_SPEED, g] = (work[FREE, g] - work[X, g]) / setup.h
    if resist(p, setup, b, command, work):
        shift(b, setup, -1.0, work)
        if p.dq_0 == 0.0:
            come_to_rest(p, setup, b, work)
    if setup.groups[1] == setup.groups[2]:
        tau = rigid_torque(p, setup, load, work)
    if drive == STATIC:
        g = setup.groups[0]
        v = (work[FREE, g] - work[X, g]) / setup.h
        currents[0], _ = static_current(p, command, is_voltage, v)
    elif drive != CURRENT:
        dq_m = work[FREE, motor]
        advance_currents(p, drive, currents, command, command_d, is_voltage, dq_m, half)
    for i in range(order):
        work[X, i] = work[FREE, i]
    return tau


@njit(cache=True)
def write_channels(
    p: Any, setup: Setup, x: Floats, currents: Floats, tau: float, load: float, out: Floats
) -> None:
    """Write the true values of all channels, shape (8,)."""
    store_state(setup, x, load, out[Q_M:TAU])
    out[CURRENT_I] = currents[0]
    out[TAU] = tau
    if setup.groups[1] != setup.groups[2]:
        out[TAU] = p.k_b * (out[Q_G] - out[Q_L]) + p.d_gl * (out[DQ_G] - out[DQ_L])


@njit(cache=True)
def lateness(delay: float, setup: Setup) -> tuple[int, int]:
    """Split a delay [s] into whole control steps and substeps, rounded to a substep."""
    total = round(delay / setup.h)
    return total // setup.substeps, total % setup.substeps


@njit(cache=True)
def control_step(
    batch: Batch, setup: Setup, i: int, command: float, command_d: float, load: float, work: Floats
) -> bool:
    """Advance joint i by one control step and measure; return whether its state is finite.

    Args:
        batch: All joints.
        setup: What they share.
        i: Which joint.
        command: Command on the q axis, current [A] or voltage [V].
        command_d: Voltage on the d axis [V].
        load: Load torque [N m] or load velocity [rad/s], held over the step.
        work: Scratch rows.
    """
    p = batch.p[i]
    ripple, a, b, currents = batch.ripple[i], batch.a[i], batch.b[i], batch.currents[i]
    depth, k = batch.commands.shape[1], batch.samples[i]
    commands, out = batch.commands[i], batch.outputs[i, (k + 1) % depth]
    commands[k % depth, 0] = condition_command(batch, setup, i, command)
    commands[k % depth, 1] = command_d
    late, late_sub = lateness(p.command_delay, setup)
    seen, seen_sub = lateness(p.measurement_delay, setup)
    felt, felt_sub = lateness(p.measurement_delay + p.torque_delay, setup)
    load_state(setup, batch.state[i], work[X])
    work[RIPPLE, :] = 0.0
    for g in range(setup.size):
        work[ACTIVE, g] = 1.0 if resists(p, setup, g) else 0.0
        work[GUESS, g] = work[X, setup.order - setup.size + g]
        side = 1.0 if work[GUESS, g] >= 0.0 else -1.0
        work[RESIST, g], _ = resistance(p, setup, g, commands[k % depth, 0], work[GUESS, g], side)
    tau = batch.tau[i]
    for s in range(setup.substeps):
        if s == setup.substeps - felt_sub:
            write_channels(p, setup, work[X], currents, tau, load, batch.snapshot[i, 1])
        if s == setup.substeps - seen_sub:
            write_channels(p, setup, work[X], currents, tau, load, batch.snapshot[i, 0])
        at = (k - late - (1 if s < late_sub else 0)) % depth
        tau = substep(
            p, ripple, a, b, setup, currents, tau, commands[at, 0], commands[at, 1], load, work
        )
    for j in range(setup.order):
        if not abs(work[X, j]) < LARGEST:
            return False
    store_state(setup, work[X], load, batch.state[i])
    write_channels(p, setup, work[X], currents, tau, load, out)
    batch.tau[i] = out[TAU]
    if seen_sub > 0:
        out[:TAU] = batch.snapshot[i, 0, :TAU]
    if felt_sub > 0:
        out[TAU] = batch.snapshot[i, 1, TAU]
    batch.samples[i] = k + 1
    measure(batch, setup, i, (k + 1 - seen) % depth, (k + 1 - felt) % depth, False)
    return True


@njit(cache=True)
def condition_command(batch: Batch, setup: Setup, i: int, command: float) -> float:
    """Return the command as the drive receives it: with noise, quantized."""
    p = batch.p[i]
    if p.command_noise > 0.0:
        unit = 1.0 if setup.is_voltage else 1.0 / (p.k_t * p.n)
        command += p.command_noise * unit * normal(batch.rng, i)
    if p.command_resolution > 0.0:
        command = math.floor(command / p.command_resolution + 0.5) * p.command_resolution
    return command


@njit(cache=True)
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


@njit(cache=True)
def low_pass(old: float, new: float, cutoff: float, dt: float) -> float:
    """Advance a first-order low pass with unit gain and cut-off [Hz], exact for held input."""
    return old + (1.0 - math.exp(-2.0 * math.pi * cutoff * dt)) * (new - old)


@njit(cache=True)
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


@njit(cache=True)
def restart(batch: Batch, setup: Setup, i: int, load: float, work: Floats) -> None:
    """Fill the memory of joint i from its state, with the drive at rest, and measure."""
    batch.currents[i, :] = 0.0
    batch.commands[i] = 0.0
    batch.samples[i] = 0
    load_state(setup, batch.state[i], work[X])
    store_state(setup, work[X], load, batch.state[i])
    for d in range(batch.outputs.shape[1]):
        write_channels(
            batch.p[i], setup, work[X], batch.currents[i], 0.0, load, batch.outputs[i, d]
        )
    batch.tau[i] = batch.outputs[i, 0, TAU]
    measure(batch, setup, i, 0, 0, True)


@njit(cache=True)
def step_batch(batch: Batch, setup: Setup, commands: Floats, load: Floats) -> int:
    """Advance every joint by one control step.

    Args:
        batch: All joints.
        setup: What they share.
        commands: Commands on the q and d axes, shape (n, 2).
        load: Load torque [N m] or load velocity [rad/s], shape (n,).

    Returns:
        -1, or the first joint whose state ceased to be finite; its state stays as it was.
    """
    work = np.zeros((WORK_ROWS, WORK_WIDTH))
    failed = -1
    for i in range(batch.a.shape[0]):
        good = control_step(batch, setup, i, commands[i, 0], commands[i, 1], load[i], work)
        if not good and failed < 0:
            failed = i
    return failed


@njit(cache=True)
def simulate(
    batch: Batch, setup: Setup, commands: Floats, load: Floats, out: Floats, true: Floats
) -> int:
    """Run joint 0 over a whole input; row k is what holds before command k acts.

    Args:
        batch: A batch of one.
        setup: Its setup.
        commands: Shape (samples, 2).
        load: Shape (samples,).
        out: Measured channels, shape (samples, 8).
        true: State, torque of the joint and current, shape (samples, 8).

    Returns:
        The number of samples written before the state ceased to be finite.
    """
    work = np.zeros((WORK_ROWS, WORK_WIDTH))
    for k in range(commands.shape[0]):
        out[k] = batch.measured[0]
        true[k, :6] = batch.state[0]
        true[k, 6] = batch.tau[0]
        if setup.groups[2] < 0:
            true[k, 5] = load[k]
            true[k, 6] += batch.p[0].d_gl * (batch.state[0, 5] - load[k])
        true[k, 7] = batch.currents[0, 0]
        if not control_step(batch, setup, 0, commands[k, 0], commands[k, 1], load[k], work):
            return k + 1
    return int(commands.shape[0])
