"""Blocks of joints: between the arrays of a batch and the vector registers of `substeps`.

A block keeps the parameters of its joints from step to step, and reads them anew when they have
changed. What it cannot do it leaves to the general kernel: joints with other effects, measurements
that are late by parts of a control step, and equations that stay unsolved.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.kernel.arrays import (
    CURRENT_I,
    K_M,
    LAGGED,
    LATE_SUB,
    Q_M,
    R_W,
    TAU,
    VOLTS,
    WORK_ROWS,
    WORK_WIDTH,
    Batch,
    Floats,
    Setup,
)
from cjt_gym.joint.kernel.compiled import inlined, lean, threaded
from cjt_gym.joint.kernel.control_steps import LARGEST
from cjt_gym.joint.kernel.ripple import COGGING, KIND
from cjt_gym.joint.kernel.sensing import distorts, is_late, lateness, measure, plan_lateness, sensor
from cjt_gym.joint.lanes import substeps as at
from cjt_gym.joint.lanes.substeps import Kind, coordinate, run
from cjt_gym.joint.lanes.vectors import WIDTH

if TYPE_CHECKING:
    from cjt_gym.joint.joint import Joint

Masks = NDArray[np.bool_]
LINE = 64  # bytes of a cache line, on which blocks begin
HANDLED = (
    *("command_delay", "command_quantization", "current_lag", "current_saturation"),
    *("torque_constant", "torque_offset", "inertia", "damping"),
    *("coulomb", "coulomb_asym", "viscous_asym", "stribeck", "cogging", "stiffness"),
    *("gear_stiffness", "load_inertia", "load_coulomb", "gravity"),
    *(name for name, effect in EFFECTS.items() if effect.stage == "sensing"),
)
UPS = ("d_cm", "d_cg", "d_cl")
DOWNS = ("d_cm_n", "d_cg_n", "d_cl_n")
EXTRAS = ("d_m_extra_n", "d_g_extra_n", "d_l_extra_n")
EXCESSES = ("d_sm", "d_sg", "d_sl")


class Blocks(NamedTuple):
    """The blocks of a batch."""

    rows: Floats  # the parameters of each block, shape (blocks, rows, WIDTH)
    scratch: Floats  # scratch rows of each thread, shape (threads, SCRATCH_ROWS, WIDTH)
    stale: Masks  # whose parameters have changed since they were read, shape (n,)
    left: Masks  # which joints the last step left to the general kernel, shape (n,)
    work: Floats  # scratch rows of the general code, shape (threads, WORK_ROWS, WORK_WIDTH)


class Place(NamedTuple):
    """Where a joint of a batch stands in a block."""

    rows: Floats  # parameters of the block
    s: Floats  # scratch rows of the thread
    lane: int
    i: int  # which joint of the batch


def kind_of(joint: Joint, voltage: bool, *, torque: bool = True) -> Kind | None:
    """Return the features that the joints of a batch share, or None for the general kernel.

    With `torque` the torque of the joint is needed, which blocks only know of a spring.
    """
    structure = joint.structure_row
    groups = structure.groups
    if joint.drive != ("static" if voltage else "current"):
        return None
    if torque and not structure.has_spring:
        return None
    if not set(joint.effects) <= set(HANDLED):
        return None
    record, ripple = joint.packed()
    if (ripple[:, KIND] != COGGING).any():
        return None
    rubbing = {
        groups[body]
        for body in range(3)
        if any(record[names[body]][0] != 0.0 for names in (UPS, DOWNS, EXTRAS, EXCESSES))
    }
    hanging = groups[2] if "gravity" in joint.effects else -1
    coordinates = sorted({*rubbing, hanging, *(groups[:1] if voltage else ())} - {-1})
    first, second, third = (*coordinates, 0, 0, 0)[:3]
    return Kind(
        structure.order,
        structure.order - structure.size,
        len(coordinates),
        first,
        second,
        third,
        int(bool(coordinates) and float(record["dq_0"][0]) == 0.0),
        ripple.shape[0],
        int("current_lag" in joint.effects and not voltage),
        int(voltage),
        int("stribeck" in joint.effects),
        coordinates.index(hanging) + 1 if hanging >= 0 else 0,
    )


def aligned(*shape: int) -> Floats:
    """Return zeros that begin on a cache line."""
    size = math.prod(shape)
    room = np.zeros(size + LINE // 8)
    first = (-room.ctypes.data % LINE) // 8
    return room[first : first + size].reshape(shape)


def make_blocks(kind: Kind, num: int, threads: int = 1) -> Blocks:
    """Allocate the blocks of `num` joints."""
    return Blocks(
        rows=aligned(-(-num // WIDTH), at.TONES + 3 * kind.tones, WIDTH),
        scratch=aligned(threads, at.SCRATCH_ROWS, WIDTH),
        stale=np.ones(num, dtype=np.bool_),
        left=np.zeros(num, dtype=np.bool_),
        work=np.zeros((threads, WORK_ROWS, WORK_WIDTH)),
    )


@lean
def body_friction(p: Any, body: int) -> tuple[float, float, float, float]:
    """Return Coulomb levels of both directions, the extra viscous friction, and the breakaway."""
    if body == 0:
        return p.d_cm, p.d_cm_n, p.d_m_extra_n, p.d_sm
    if body == 1:
        return p.d_cg, p.d_cg_n, p.d_g_extra_n, p.d_sg
    return p.d_cl, p.d_cl_n, p.d_l_extra_n, p.d_sl


@lean
def read_friction(p: Any, setup: Setup, kind: Kind, s: Floats, lane: int, back_emf: float) -> bool:
    """Read the friction of a joint, back-EMF included; return whether it fits the kind."""
    left = 0.0
    for k in range(kind.n):
        s[at.UP + k, lane] = s[at.DOWN + k, lane] = s[at.EXCESS + k, lane] = 0.0
        s[at.FORE + k, lane] = s[at.EXTRA + k, lane] = back_emf if k == 0 else 0.0
    for body in range(3):
        up, down, extra, excess = body_friction(p, body)
        excess = excess if p.v_s > 0.0 else 0.0
        found = setup.groups[body] < 0
        for k in range(kind.n):
            if setup.groups[body] == coordinate(kind, k):
                s[at.UP + k, lane] += up
                s[at.DOWN + k, lane] += down
                s[at.EXTRA + k, lane] += extra
                s[at.EXCESS + k, lane] += excess
                found = True
        left += 0.0 if found else abs(up) + abs(down) + abs(extra) + abs(excess)
    width = p.dq_0 if p.dq_0 > 0.0 else 1.0
    s[at.STEEP, lane], s[at.ENOUGH, lane] = 1.0 / width, 1e-10 + 1e-7 * width
    s[at.CLOSE, lane] = 0.5 * math.sqrt(s[at.ENOUGH, lane] * width)
    s[at.PER_V_S, lane] = 1.0 / p.v_s if p.v_s > 0.0 else 0.0
    if kind.falls:  # its curve bends elsewhere, too
        s[at.CLOSE, lane] = s[at.ENOUGH, lane]
    return left == 0.0 and (kind.n == 0 or (p.dq_0 == 0.0) == (kind.sharp == 1))


@lean
def is_unique(kind: Kind, s: Floats, lane: int, k: int) -> bool:
    """Whether friction falls so slowly that the speed of coordinate k has one solution."""
    fall = 0.0
    for m in range(kind.n):
        fall += abs(s[at.MOBILITY + 3 * k + m, lane]) * abs(s[at.EXCESS + m, lane])
    return bool(fall * s[at.PER_V_S, lane] * at.STEEPEST_FALL < at.UNIQUE)


@lean
def is_plain(p: Any) -> bool:
    """Whether the sensors report true values without delay."""
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
    batch: Batch, setup: Setup, kind: Kind, s: Floats, lane: int, i: int, work: Floats
) -> None:
    """Read the parameters of joint i into place lane of a block."""
    p, a, b = batch.p[i], batch.a[i], batch.b[i]
    per_ampere, ohms = batch.memory[i, K_M], batch.memory[i, R_W]
    back_emf = per_ampere * per_ampere / ohms if kind.volts else 0.0
    usable = read_friction(p, setup, kind, s, lane, back_emf)
    for row in range(kind.order):
        for j in range(kind.order):
            s[at.A + 6 * row + j, lane] = a[row, j]
        s[at.MOTOR + row, lane], s[at.LOAD + row, lane] = b[row, 0], b[row, 1]
        for k in range(kind.n):
            s[at.RUB + 6 * k + row, lane] = b[row, 2 + coordinate(kind, k)]
    for k in range(kind.n):
        for m in range(kind.n):
            torque = b[coordinate(kind, k), 2 + coordinate(kind, m)]
            s[at.MOBILITY + 3 * k + m, lane] = torque / setup.h
        usable = usable and is_unique(kind, s, lane, k)
    for j in range(kind.tones):
        row, tone = at.TONES + 3 * j, batch.ripple[i, j]
        s[row, lane] = tone[0]
        s[row + 1, lane], s[row + 2, lane] = tone[1] * p.cogging_scale, tone[2] * p.cogging_scale
    s[at.PEAK, lane], s[at.LIMIT, lane] = p.v_0 if kind.volts else p.i_p, p.i_p
    s[at.PER_UNIT, lane], s[at.OFFSET, lane] = per_ampere, p.torque_offset
    if kind.volts:
        s[at.PER_UNIT, lane] = s[at.SLOWED, lane] = per_ampere / ohms
        s[at.PER_VOLT, lane] = 1.0 / ohms
    s[at.K_B, lane], s[at.D_GL, lane] = p.k_b, p.d_gl
    s[at.WEIGHT, lane], s[at.HANGS, lane] = p.weight, p.weight_angle
    s[at.RESOLUTION, lane] = p.command_resolution
    s[at.LATE, lane], s[at.LATE_SUB, lane] = lateness(p.command_delay, setup)
    lag = 2.0 * math.pi * p.current_bandwidth * setup.h
    usable = usable and (lag == 0.0 or kind.lags == 1 or kind.volts == 1)
    s[at.STAYS, lane] = math.exp(-lag) if lag > 0.0 else 0.0
    s[at.MEAN, lane] = -math.expm1(-lag) / lag if lag > 0.0 else 0.0
    s[at.PLAIN, lane] = 1.0 if is_plain(p) else 0.0
    if plan_lateness(p, setup, work):
        for channel in range(8):
            usable = usable and work[LATE_SUB, channel] == 0.0
    s[at.USABLE, lane] = 1.0 if usable else 0.0


@inlined
def wrap(k: int, depth: int) -> int:
    """Return the place of sample k in a ring."""
    return k & 1 if depth == 2 else k % depth


@inlined
def enter(
    batch: Batch, setup: Setup, kind: Kind, place: Place, command: float, load: float
) -> bool:
    """Put a joint's state and inputs into its place; return whether the block can move it."""
    rows, s, lane, i = place
    if not (math.isfinite(command + load) and rows[at.USABLE, lane] == 1.0):
        return False
    k, depth = batch.samples[i], batch.commands.shape[1]
    resolution = rows[at.RESOLUTION, lane]
    if resolution > 0.0:
        command = math.floor(command / resolution + 0.5) * resolution
    s[at.COMMAND, lane], s[at.PUSHED, lane] = command, load
    late = int(rows[at.LATE, lane])
    now = batch.commands[i, wrap(k - late + depth, depth), 0] if late > 0 else command
    s[at.AFTER, lane] = now
    if rows[at.LATE_SUB, lane] > 0.0:
        s[at.BEFORE, lane] = batch.commands[i, wrap(k - late - 1 + depth, depth), 0]
    s[at.LAGGED, lane] = batch.memory[i, LAGGED]
    for body in (2, 1, 0):
        g = setup.groups[body]
        if g >= 0:
            s[at.X + g, lane] = batch.state[i, body]
            s[at.X + kind.velocity + g, lane] = batch.state[i, 3 + body]
        else:
            s[at.X + setup.size, lane] = batch.state[i, body]
    return True


@inlined
def leave(batch: Batch, setup: Setup, kind: Kind, place: Place, load: float, work: Floats) -> bool:
    """Take a joint's state out of its place and measure; return whether it is finite."""
    rows, s, lane, i = place
    for j in range(kind.order):
        if not abs(s[at.X + j, lane]) < LARGEST:
            return False
    k, depth, state = batch.samples[i], batch.commands.shape[1], batch.state[i]
    for body in range(3):
        g = setup.groups[body]
        if g >= 0:
            state[body] = s[at.X + g, lane]
            state[3 + body] = s[at.X + kind.velocity + g, lane]
        else:
            state[body] = s[at.X + setup.size, lane]
            state[3 + body] = load
    out, ring = batch.outputs[i, wrap(k + 1, depth)], batch.commands[i, wrap(k, depth)]
    ring[0], ring[1] = s[at.COMMAND, lane], 0.0
    current = s[at.CURRENT if kind.volts else at.ACTING, lane]
    batch.currents[i, 0] = out[CURRENT_I] = current
    if kind.volts:
        induced = rows[at.SLOWED, lane] * state[3]
        batch.memory[i, VOLTS] = (current + induced) / rows[at.PER_VOLT, lane]
    if kind.lags:
        batch.memory[i, LAGGED] = s[at.LAGGED, lane]
    for j in range(6):
        out[Q_M + j] = state[j]
    tau = rows[at.K_B, lane] * (state[1] - state[2]) + rows[at.D_GL, lane] * (state[4] - state[5])
    batch.tau[i] = out[TAU] = tau
    batch.samples[i] = k + 1
    if rows[at.PLAIN, lane] == 1.0:
        for channel in range(8):
            batch.measured[i, channel] = out[channel]
    else:
        late = plan_lateness(batch.p[i], setup, work)
        measure(batch, setup, i, False, late, work)
    return True


@lean
def advance(
    batch: Batch,
    setup: Setup,
    kind: Kind,
    blocks: Blocks,
    commands: Floats,
    loads: Floats,
    share: tuple[int, int, int],
) -> int:
    """Advance joints by one control step; return how many are left to the general kernel.

    The share of a thread is its first block, the one behind its last, and its number.
    """
    begin, end, thread = share
    left, last = 0, loads.shape[0] - 1
    s, work = blocks.scratch[thread], blocks.work[thread]
    for block in range(begin, end):
        rows, first = blocks.rows[block], block * WIDTH
        for lane in range(WIDTH):
            i = min(first + lane, last)  # the last joint fills the last block
            if blocks.stale[i]:
                read_parameters(batch, setup, kind, rows, lane, i, work)
            good = enter(batch, setup, kind, Place(rows, s, lane, i), commands[i, 0], loads[i])
            s[at.FAILED, lane] = 0.0 if good else 1.0
        run(kind, rows, s, setup.substeps, setup.h)
        for lane in range(min(WIDTH, last + 1 - first)):
            i = first + lane
            place, moved = Place(rows, s, lane, i), s[at.FAILED, lane] == 0.0
            moved = moved and leave(batch, setup, kind, place, loads[i], work)
            blocks.stale[i], blocks.left[i] = False, not moved
            left += 0 if moved else 1
    return left


advance_blocks = threaded(advance)
