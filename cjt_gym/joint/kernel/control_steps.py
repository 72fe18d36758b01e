"""The compiled loops over control steps and joints: one kernel for all joints."""

from __future__ import annotations

import math
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.arrays import (
    ACTIVE,
    K_M,
    LATE_SUB,
    LINEAR,
    LOOPS,
    MEMORY,
    MESHES,
    REMEMBERS,
    RESISTS,
    RIPPLE,
    SHAPES,
    SWITCH,
    TAU,
    UNSOLVED,
    VOLTS,
    WORK_ROWS,
    WORK_WIDTH,
    Batch,
    Floats,
    OneJoint,
    Setup,
    X,
)
from cjt_gym.joint.kernel.compiled import compiled, inlined, lean, threaded
from cjt_gym.joint.kernel.current_loop import closes, regulated_command, terminal_volts
from cjt_gym.joint.kernel.disturbance import disturbed_load, is_disturbed
from cjt_gym.joint.kernel.drives import CURRENT, shaped_command
from cjt_gym.joint.kernel.heat import cool, warm
from cjt_gym.joint.kernel.mesh import loops, meshes
from cjt_gym.joint.kernel.resistance import prepare
from cjt_gym.joint.kernel.sensing import (
    condition_command,
    lateness,
    measure,
    plan_lateness,
    take_snapshot,
    write_channels,
)
from cjt_gym.joint.kernel.splitting import careful_substep
from cjt_gym.joint.kernel.substep import linear_substep, load_state, store_state

LARGEST = 1e12
"""State beyond which a simulation has diverged: no joint moves a million million radians."""


@lean
def throw_switches(joint: OneJoint) -> None:
    """Determine what the substeps have to do, so that inactive effects cost nothing."""
    p, ripple, work, setup = joint.p, joint.ripple, joint.work, joint.setup
    for column in range(UNSOLVED + 1):
        work[SWITCH, column] = 0.0
    if not setup.is_voltage and (p.current_rate > 0.0 or p.current_bandwidth > 0.0):
        work[SWITCH, SHAPES] = 1.0
    if meshes(p, ripple):
        work[SWITCH, MESHES] = 1.0
    if loops(p, ripple, setup):
        work[SWITCH, LOOPS] = work[SWITCH, RESISTS] = 1.0
    if p.sigma_m + p.sigma_g + p.sigma_l > 0.0 or p.tau_h > 0.0:
        work[SWITCH, REMEMBERS] = 1.0
    for g in range(setup.size):
        if work[ACTIVE, g] != 0.0:
            work[SWITCH, RESISTS] = 1.0
    busy = work[SWITCH, MESHES] + work[SWITCH, RESISTS]
    springy = setup.groups[1] != setup.groups[2]
    work[SWITCH, LINEAR] = 1.0 if busy == 0.0 and springy and setup.drive == CURRENT else 0.0


@lean
def under_voltage(setup: Setup) -> Setup:
    """Return the same for commands that are voltages."""
    return Setup(
        setup.groups,
        setup.size,
        setup.order,
        setup.drive,
        True,
        setup.h,
        setup.substeps,
        setup.dt,
    )


@lean
def control_step(
    batch: Batch, setup: Setup, i: int, command: float, command_d: float, load: float, work: Floats
) -> bool:
    """Advance joint i by one control step and measure; return whether input and state are finite.

    A NaN has to be caught before it acts: limits and friction compare, and would hide it.
    """
    if not math.isfinite(command + command_d + load):
        return False
    p, memory, ripple, currents = batch.p[i], batch.memory[i], batch.ripple[i], batch.currents[i]
    joint, a, b = OneJoint(p, memory, ripple, currents, work, setup), batch.a[i], batch.b[i]
    depth, k = batch.commands.shape[1], batch.samples[i]
    commands, out = batch.commands[i], batch.outputs[i, (k + 1) % depth]
    commands[k % depth, 0] = condition_command(batch, setup, i, command)
    commands[k % depth, 1] = command_d
    late, late_sub = lateness(p.command_delay, setup)
    is_late = plan_lateness(p, setup, work)
    if p.derating > 0.0:
        warm(p, memory, currents, setup.dt)
    load_state(setup, batch.state[i], work[X])
    work[RIPPLE, :] = 0.0
    prepare(joint, commands[k % depth, 0], load)
    throw_switches(joint)
    tau, is_closed, inner = batch.tau[i], closes(p, setup), joint
    shapes = is_closed and work[SWITCH, SHAPES] == 1.0
    if is_closed:
        inner = OneJoint(p, memory, ripple, currents, work, under_voltage(setup))
        work[SWITCH, SHAPES] = 0.0
    motor = setup.order - setup.size + setup.groups[0]
    wanted, wanted_d = 0.0, 0.0
    for s in range(setup.substeps):
        if is_late:
            take_snapshot(joint, s, tau, load, out, batch.snapshot[i])
        at = (k - late - (1 if s < late_sub else 0)) % depth
        wanted, wanted_d = commands[at, 0], commands[at, 1]
        if is_closed:
            if shapes:
                wanted = shaped_command(p, memory, wanted, setup.h)
            now, dq_m = k * setup.substeps + s, work[X, motor]
            wanted, wanted_d = regulated_command(joint, now, wanted, dq_m)
        if work[SWITCH, LINEAR] == 1.0:
            linear_substep(joint, a, b, wanted, load)
        else:
            tau = careful_substep(inner, a, b, wanted, wanted_d, load)
    if setup.drive != CURRENT and not is_closed:
        memory[VOLTS], memory[VOLTS + 1] = terminal_volts(joint, wanted, wanted_d, work[X, motor])
    for j in range(setup.order):
        if not abs(work[X, j]) < LARGEST:
            return False
    store_state(setup, work[X], load, batch.state[i])
    write_channels(joint, tau, load, out)
    batch.tau[i] = out[TAU]
    if is_late:
        for channel in range(8):
            if work[LATE_SUB, channel] > 0.0:
                out[channel] = batch.snapshot[i, channel]
    batch.samples[i] = k + 1
    measure(batch, setup, i, False, is_late, work)
    return True


@threaded
def one_step(
    batch: Batch, setup: Setup, i: int, command: float, command_d: float, load: float, work: Floats
) -> bool:
    """Do what `control_step` does, compiled once for all its callers and kept on disk."""
    return control_step(batch, setup, i, command, command_d, load, work)


inlined_step: Any = inlined(FunctionType(control_step.__code__, globals(), "inlined_step"))
"""`control_step` compiled into its caller: twice as fast in a long loop, longer to compile."""


@lean
def restart(batch: Batch, setup: Setup, i: int, load: float, work: Floats) -> None:
    """Fill the memory of joint i from its state, with the drive at rest, and measure."""
    p, memory = batch.p[i], batch.memory[i]
    joint = OneJoint(p, memory, batch.ripple[i], batch.currents[i], work, setup)
    for j in range(MEMORY):  # behind it lies the table of the bar
        memory[j] = 0.0
    cool(p, memory)
    batch.currents[i, :] = 0.0
    batch.commands[i] = 0.0
    batch.samples[i] = 0
    load_state(setup, batch.state[i], work[X])
    store_state(setup, work[X], load, batch.state[i])
    for d in range(batch.outputs.shape[1]):
        write_channels(joint, 0.0, load, batch.outputs[i, d])
    batch.tau[i] = batch.outputs[i, 0, TAU]
    measure(batch, setup, i, True, False, work)


@compiled
def step_batch(
    batch: Batch, setup: Setup, commands: Floats, load: Floats, mask: NDArray[np.bool_]
) -> int:
    """Advance the joints in a mask by one control step; return the first that diverged, else -1.

    Its state stays as it was.
    """
    work = np.zeros((WORK_ROWS, WORK_WIDTH))
    failed = -1
    for i in range(batch.a.shape[0]):
        if not mask[i]:
            continue
        pushed = load[i]
        if is_disturbed(batch.p[i]):
            memory, k = batch.memory[i], batch.samples[i]
            pushed = disturbed_load(batch.p[i], memory, setup, batch.rng, i, k, pushed)
        good = one_step(batch, setup, i, commands[i, 0], commands[i, 1], pushed, work)
        if not good and failed < 0:
            failed = i
    return failed


@compiled
def simulate(
    batch: Batch, setup: Setup, commands: Floats, load: Floats, out: Floats, true: Floats
) -> int:
    """Run joint 0 over a whole input; row k holds the values before command k acts.

    Args:
        batch: A batch of one.
        setup: Its setup.
        commands: Shape (samples, 2).
        load: Shape (samples,).
        out: Measured channels, shape (samples, 8).
        true: State, torque of the joint, i_q, i_d, v_q, v_d and torque of the motor, (samples, 12).

    Returns:
        The number of samples written before the state ceased to be finite.
    """
    work = np.zeros((WORK_ROWS, WORK_WIDTH))
    only = 0 * len(commands)  # for a literal 0, `one_step` would be compiled once more
    for k in range(commands.shape[0]):
        p, memory = batch.p[0], batch.memory[0]
        pushed = disturbed_load(p, memory, setup, batch.rng, 0, batch.samples[0], load[k])
        out[k] = batch.measured[0]
        true[k, :6] = batch.state[0]
        true[k, 6] = batch.tau[0]
        if setup.groups[2] < 0:
            true[k, 5] = pushed
            if batch.p[0].play_gap == 0.0:
                true[k, 6] += batch.p[0].d_gl * (batch.state[0, 5] - pushed)
        true[k, 7], true[k, 8] = batch.currents[0, 0], batch.currents[0, 1]
        true[k, 9], true[k, 10] = memory[VOLTS], memory[VOLTS + 1]
        true[k, 11] = memory[K_M] * batch.currents[0, 0]
        if not one_step(batch, setup, only, commands[k, 0], commands[k, 1], pushed, work):
            return k + 1
    return int(commands.shape[0])
