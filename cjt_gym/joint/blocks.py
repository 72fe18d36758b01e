"""Blocks of joints: between the arrays of a batch and the vector registers of `lanes`.

A block keeps the parameters of its joints from step to step, and reads them anew when they have
changed. What it cannot do it leaves to the general kernel: joints with other effects, measurements
that are late by parts of a control step, and equations that stay unsolved.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.arrays import (
    CURRENT_I,
    K_M,
    LATE_SUB,
    Q_M,
    TAU,
    WORK_ROWS,
    WORK_WIDTH,
    Batch,
    Floats,
    Setup,
)
from cjt_gym.joint.compiled import inlined, lean, vectorisable
from cjt_gym.joint.drives import clip
from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.lanes import Plan, Shape, plan_of, rows_of, run
from cjt_gym.joint.ripple import COGGING, KIND
from cjt_gym.joint.sensing import distorts, is_late, lateness, measure, plan_lateness, sensor

if TYPE_CHECKING:
    from cjt_gym.joint.joint import Joint

Masks = NDArray[np.bool_]
WIDTH, FEWEST = 8, 4  # joints per block, and how many it takes for blocks wider than one
LARGEST = 1e12
HANDLED = (
    *("command_delay", "command_quantization", "current_saturation", "torque_constant"),
    *("torque_offset", "inertia", "damping", "coulomb", "coulomb_asym", "viscous_asym"),
    *("cogging", "stiffness", "gear_stiffness", "load_inertia", "load_coulomb"),
    *(name for name, effect in EFFECTS.items() if effect.stage == "sensing"),
)
UPS = ("d_cm", "d_cg", "d_cl")
DOWNS = ("d_cm_n", "d_cg_n", "d_cl_n")
EXTRAS = ("d_m_extra_n", "d_g_extra_n", "d_l_extra_n")


class Blocks(NamedTuple):
    """The blocks of a batch.

    Attributes:
        rows: The rows of each block, shape (blocks, rows times width).
        stale: Whose parameters have changed since they were read, shape (n,).
        left: Which joints the last step left to the general kernel, shape (n,).
        work: Scratch rows of each thread.
    """

    rows: Floats
    stale: Masks
    left: Masks
    work: Floats


def shape_of(joint: Joint, num: int, voltage: bool) -> Shape | None:
    """Return the shape of a joint's blocks, or None where it needs the general kernel."""
    structure = joint.structure_row
    groups = structure.groups
    if joint.drive != "current" or voltage or groups[1] == groups[2]:
        return None
    if not set(joint.effects) <= set(HANDLED):
        return None
    record, ripple = joint.packed()
    if (ripple[:, KIND] != COGGING).any():
        return None
    rubbing = {
        groups[body]
        for body in range(3)
        if any(record[names[body]][0] != 0.0 for names in (UPS, DOWNS, EXTRAS))
    }
    return Shape(
        structure.order,
        structure.size,
        tuple(sorted(rubbing - {-1})),
        bool(rubbing - {-1}) and float(record["dq_0"][0]) == 0.0,
        ripple.shape[0],
        WIDTH if num >= FEWEST else 1,
    )


def make_blocks(shape: Shape, num: int, threads: int = 1) -> Blocks:
    """Allocate the blocks of `num` joints."""
    blocks = -(-num // shape.width)
    return Blocks(
        rows=np.zeros((blocks, rows_of(shape).count * shape.width)),
        stale=np.ones(num, dtype=np.bool_),
        left=np.zeros(num, dtype=np.bool_),
        work=np.zeros((threads, WORK_ROWS, WORK_WIDTH)),
    )


@lean
def body_friction(p: Any, body: int) -> tuple[float, float, float]:
    """Return Coulomb levels of both directions and the extra viscous friction of a body."""
    if body == 0:
        return p.d_cm, p.d_cm_n, p.d_m_extra_n
    if body == 1:
        return p.d_cg, p.d_cg_n, p.d_g_extra_n
    return p.d_cl, p.d_cl_n, p.d_l_extra_n


@lean
def read_friction(p: Any, setup: Setup, c: Plan, s: Floats, lane: int) -> bool:
    """Read the friction of a joint; return whether it fits the shape."""
    left = 0.0
    for body in range(3):
        up, down, extra = body_friction(p, body)
        left += abs(up) + abs(down) + abs(extra) if setup.groups[body] >= 0 else 0.0
    for k in range(c.n):
        g = c.first if k == 0 else (c.second if k == 1 else c.third)
        ups, downs, extras = 0.0, 0.0, 0.0
        for body in range(3):
            if setup.groups[body] == g:
                up, down, extra = body_friction(p, body)
                ups, downs, extras = ups + up, downs + down, extras + extra
                left -= abs(up) + abs(down) + abs(extra)
        s[c.at.up + k * c.width + lane] = ups
        s[c.at.down + k * c.width + lane] = downs
        s[c.at.extra + k * c.width + lane] = extras
    s[c.at.steep + lane] = 1.0 / p.dq_0 if p.dq_0 > 0.0 else 1.0
    return c.n == 0 or (abs(left) < 1e-12 and (p.dq_0 == 0.0) == c.sharp)


@lean
def is_plain(p: Any) -> bool:
    """Whether the sensors report what is true, at once."""
    if is_late(p) or distorts(p) or p.dropout > 0.0:
        return False
    if p.torque_cutoff > 0.0 or p.velocity_cutoff > 0.0:
        return False
    for channel in range(8):
        noise, resolution = sensor(p, channel)
        if noise > 0.0 or resolution > 0.0:
            return False
    return True


@lean
def read_parameters(
    batch: Batch, setup: Setup, c: Plan, s: Floats, lane: int, i: int, work: Floats
) -> None:
    """Read the parameters of joint i into place lane of a block."""
    p, a, b, width = batch.p[i], batch.a[i], batch.b[i], c.width
    usable = read_friction(p, setup, c, s, lane)
    for i_ in range(c.order):
        for j in range(c.order):
            s[c.at.a + (i_ * c.order + j) * width + lane] = a[i_, j]
        s[c.at.motor + i_ * width + lane] = b[i_, 0]
        s[c.at.load + i_ * width + lane] = b[i_, 1]
        for k in range(c.n):
            g = c.first if k == 0 else (c.second if k == 1 else c.third)
            s[c.at.b + (i_ * c.n + k) * width + lane] = b[i_, 2 + g]
            for m in range(c.n):
                if i_ == (c.first if m == 0 else (c.second if m == 1 else c.third)):
                    s[c.at.mobility + (m * c.n + k) * width + lane] = b[i_, 2 + g] / setup.h
    for j in range(c.harmonics):
        row, tone = c.at.harmonics + 3 * j * width + lane, batch.ripple[i, j]
        s[row] = tone[0]
        s[row + width] = tone[1] * p.cogging_scale
        s[row + 2 * width] = tone[2] * p.cogging_scale
    s[c.at.peak + lane], s[c.at.offset + lane] = p.i_p, p.torque_offset
    s[c.at.k_b + lane], s[c.at.d_gl + lane] = p.k_b, p.d_gl
    late, late_sub = lateness(p.command_delay, setup)
    s[c.at.late + lane], s[c.at.late_sub + lane] = late, late_sub
    s[c.at.plain + lane] = 1.0 if is_plain(p) else 0.0
    if plan_lateness(p, setup, work):
        for channel in range(8):
            usable = usable and work[LATE_SUB, channel] == 0.0
    s[c.at.usable + lane] = 1.0 if usable else 0.0


@lean
def wrap(k: int, depth: int) -> int:
    """Return the place of sample k in a ring."""
    return k & 1 if depth == 2 else k % depth


@lean
def push(c: Plan, s: Floats, lane: int, torque: float, load: float) -> None:
    """Note what motor torque and load input add to the state in a substep."""
    for j in range(c.order):
        at = j * c.width + lane
        s[c.at.push + at] = s[c.at.motor + at] * torque + s[c.at.load + at] * load


@lean
def enter(
    batch: Batch, setup: Setup, c: Plan, s: Floats, lane: int, i: int, command: float, load: float
) -> bool:
    """Put state and inputs of joint i into place lane; return whether the block can move it."""
    if not (math.isfinite(command + load) and s[c.at.usable + lane] == 1.0):
        return False
    p, k, depth = batch.p[i], batch.samples[i], batch.commands.shape[1]
    if p.command_resolution > 0.0:
        command = math.floor(command / p.command_resolution + 0.5) * p.command_resolution
    s[c.at.command + lane] = command
    late, now, before = int(s[c.at.late + lane]), command, command
    if late > 0:
        now = batch.commands[i, wrap(k - late + depth, depth), 0]
    now = clip(now, s[c.at.peak + lane])
    torque = s[c.at.offset + lane] + batch.memory[i, K_M] * now
    s[c.at.current + lane], s[c.at.later + lane] = now, torque
    if s[c.at.late_sub + lane] > 0.0:
        before = batch.commands[i, wrap(k - late - 1 + depth, depth), 0]
        before = clip(before, s[c.at.peak + lane])
        torque = s[c.at.offset + lane] + batch.memory[i, K_M] * before
    push(c, s, lane, torque, load)
    for body in (2, 1, 0):
        g = setup.groups[body]
        if g >= 0:
            s[c.at.x + g * c.width + lane] = batch.state[i, body]
            s[c.at.x + (c.velocity + g) * c.width + lane] = batch.state[i, 3 + body]
        else:
            s[c.at.x + setup.size * c.width + lane] = batch.state[i, body]
    return True


@lean
def leave(
    batch: Batch, setup: Setup, c: Plan, s: Floats, lane: int, i: int, load: float, work: Floats
) -> bool:
    """Take the state of joint i back and measure; return whether it is finite."""
    for j in range(c.order):
        if not abs(s[c.at.x + j * c.width + lane]) < LARGEST:
            return False
    k, depth, state = batch.samples[i], batch.commands.shape[1], batch.state[i]
    for body in range(3):
        g = setup.groups[body]
        if g >= 0:
            state[body] = s[c.at.x + g * c.width + lane]
            state[3 + body] = s[c.at.x + (c.velocity + g) * c.width + lane]
        else:
            state[body] = s[c.at.x + setup.size * c.width + lane]
            state[3 + body] = load
    out, ring = batch.outputs[i, wrap(k + 1, depth)], batch.commands[i, wrap(k, depth)]
    ring[0], ring[1] = s[c.at.command + lane], 0.0
    batch.currents[i, 0] = out[CURRENT_I] = s[c.at.current + lane]
    for j in range(6):
        out[Q_M + j] = state[j]
    tau = s[c.at.k_b + lane] * (state[1] - state[2]) + s[c.at.d_gl + lane] * (state[4] - state[5])
    batch.tau[i] = out[TAU] = tau
    batch.samples[i] = k + 1
    if s[c.at.plain + lane] == 1.0:
        for channel in range(8):
            batch.measured[i, channel] = out[channel]
    else:
        late = plan_lateness(batch.p[i], setup, work)
        measure(batch, setup, i, False, late, work)
    return True


@inlined
def advance_block(c: Plan, setup: Setup, s: Floats, loads: Floats, first: int, last: int) -> None:
    """Move a block by a control step; commands that arrive within it act from there on."""
    done = 0
    while done < setup.substeps:
        until = setup.substeps
        for lane in range(c.width):
            arrival = int(s[c.at.late_sub + lane])
            until = min(until, arrival) if arrival > done else until
        run(c, s, done, until - done, setup.h)
        for lane in range(c.width):
            if int(s[c.at.late_sub + lane]) == until:
                push(c, s, lane, s[c.at.later + lane], loads[min(first + lane, last)])
        done = until


@inlined
def advance_blocks(
    c: Plan,
    batch: Batch,
    setup: Setup,
    blocks: Blocks,
    commands: Floats,
    loads: Floats,
    begin: int,
    end: int,
    work: Floats,
) -> int:
    """Advance the joints of blocks begin to end by one control step; return how many are left."""
    left, last = 0, loads.shape[0] - 1
    for block in range(begin, end):
        s, first = blocks.rows[block], block * c.width
        fresh = True
        for lane in range(c.width):
            fresh = fresh and not blocks.stale[min(first + lane, last)]
        for lane in range(c.width):
            i = min(first + lane, last)
            if not fresh:
                read_parameters(batch, setup, c, s, lane, i, work)
            good = enter(batch, setup, c, s, lane, i, commands[i, 0], loads[i])
            s[c.at.failed + lane] = 0.0 if good else 1.0
        advance_block(c, setup, s, loads, first, last)
        for lane in range(min(c.width, last + 1 - first)):
            i = first + lane
            moved = s[c.at.failed + lane] == 0.0
            moved = moved and leave(batch, setup, c, s, lane, i, loads[i], work)
            blocks.stale[i], blocks.left[i] = False, not moved
            left += 0 if moved else 1
    return left


@cache
def stepper(shape: Shape) -> Any:
    """Return the compiled function that advances the blocks of a shape by a control step.

    Its arguments are those of `advance_blocks` without the first.
    """
    c = plan_of(shape)

    @vectorisable
    def step_blocks(
        batch: Batch,
        setup: Setup,
        blocks: Blocks,
        commands: Floats,
        loads: Floats,
        begin: int,
        end: int,
        work: Floats,
    ) -> int:
        return advance_blocks(c, batch, setup, blocks, commands, loads, begin, end, work)

    return step_blocks
