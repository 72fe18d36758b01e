"""A whole step of an environment in one compiled call: command, joints, reward, observation.

Handing the arrays of joints and episodes over to compiled code costs more than a step of one
joint. So they are handed over once: `table_of` notes where each array lies, and the compiled step
takes nothing but that table.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

from cjt_gym.envs.observe import SAFETY, Task, conclude_one
from cjt_gym.joint.arrays import TAU, Batch, Floats, Setup
from cjt_gym.joint.blocks import Blocks, advance_blocks
from cjt_gym.joint.compiled import inlined, vectorisable
from cjt_gym.joint.configure import PARAMETER_DTYPE
from cjt_gym.joint.lanes import Kind
from cjt_gym.joint.vectors import WIDTH

SLOTS = 4  # address and up to three lengths
BAD_ACTION = -1
REPORT = (
    *("tau", "tau_measured", "tau_reference", "tau_command", "base_action", "residual"),
    *("reward/tracking", "reward/smoothness", "reward/effort", "reward/safety"),
)
F8, F4, I8, U8, B1 = np.float64, np.float32, np.int64, np.uint64, np.bool_


class Control(NamedTuple):
    """What a step is told and what it reports.

    Attributes:
        action: In [-1, 1], shape (n,); values outside are clipped.
        base: Motor torque of the base controller, shape (n,) [N m].
        residual: Motor torque of the action, shape (n,) [N m].
        wanted: Both, within the limits, shape (n,) [N m].
        commands: The same as currents [A], shape (n, 2).
        report: Rows of `REPORT`, shape (10, n).
        factors: [action scale, torque limit, torque per ampere].
    """

    action: Floats
    base: Floats
    residual: Floats
    wanted: Floats
    commands: Floats
    report: Floats
    factors: Floats


def make_control(num: int, action_scale: float, limit: float, torque_per_ampere: float) -> Control:
    """Allocate for `num` episodes."""
    return Control(
        action=np.zeros(num),
        base=np.zeros(num),
        residual=np.zeros(num),
        wanted=np.zeros(num),
        commands=np.zeros((num, 2)),
        report=np.zeros((len(REPORT), num)),
        factors=np.array([action_scale, limit, torque_per_ampere]),
    )


def table_of(
    batch: Batch, setup: Setup, kind: Kind, blocks: Blocks, task: Task, control: Control
) -> NDArray[np.int64]:
    """Return where all arrays lie; it holds while these live and are not replaced."""
    fields = [*batch, *blocks, *task, *control, np.array([setup.h, setup.dt])]
    arrays = [x for x in fields if isinstance(x, np.ndarray)]
    rows = [[x.ctypes.data, *x.shape, 0, 0, 0][:SLOTS] for x in arrays]
    g, numbers = setup.groups, (setup.size, setup.order, setup.drive, setup.substeps)
    table = [number for row in rows for number in row]
    steps = np.array([setup.h, setup.dt]).view(np.int64).tolist()
    task_numbers = (task.episode_steps, task.preview)
    return np.array([*g, *numbers, *steps, *task_numbers, *kind, *table[:-SLOTS]])


FIRST = 19  # numbers before the arrays


@intrinsic
def borrowed(typing_context: Any, address: Any, shape: Any, dtype: Any) -> Any:
    """Return the array of a shape that lies at an address, in row-major order."""
    array = types.Array(dtype.dtype, len(shape), "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        made = context.make_array(array)(context, builder)
        size = context.get_abi_sizeof(context.get_data_type(array.dtype))
        lengths = cgutils.unpack_tuple(builder, arguments[1])
        strides, step = [], context.get_constant(types.intp, size)
        for length in reversed(lengths):
            strides.insert(0, step)
            step = builder.mul(step, length)
        populate_array(
            made,
            data=builder.inttoptr(arguments[0], made.data.type),
            shape=lengths,
            strides=strides,
            itemsize=context.get_constant(types.intp, size),
            meminfo=None,
        )
        return made._getvalue()

    return array(types.int64, shape, dtype), generate


@inlined
def one(t: NDArray[np.int64], k: int, dtype: Any) -> Any:
    """Return array k, a vector."""
    at = FIRST + SLOTS * k
    return borrowed(t[at], (t[at + 1],), dtype)


@inlined
def two(t: NDArray[np.int64], k: int, dtype: Any) -> Any:
    """Return array k, a matrix."""
    at = FIRST + SLOTS * k
    return borrowed(t[at], (t[at + 1], t[at + 2]), dtype)


@inlined
def three(t: NDArray[np.int64], k: int, dtype: Any) -> Any:
    """Return array k, of three dimensions."""
    at = FIRST + SLOTS * k
    return borrowed(t[at], (t[at + 1], t[at + 2], t[at + 3]), dtype)


@inlined
def open_batch(t: NDArray[np.int64]) -> Batch:
    """Return the arrays of the joints."""
    return Batch(
        one(t, 0, PARAMETER_DTYPE),
        three(t, 1, F8),
        three(t, 2, F8),
        three(t, 3, F8),
        two(t, 4, F8),
        two(t, 5, F8),
        two(t, 6, F8),
        one(t, 7, F8),
        two(t, 8, F8),
        three(t, 9, F8),
        three(t, 10, F8),
        two(t, 11, F8),
        one(t, 12, I8),
        one(t, 13, U8),
    )


@inlined
def open_blocks(t: NDArray[np.int64]) -> Blocks:
    """Return the blocks of joints."""
    return Blocks(three(t, 14, F8), one(t, 15, B1), one(t, 16, B1), three(t, 17, F8))


@inlined
def open_task(t: NDArray[np.int64]) -> Task:
    """Return the arrays of the episodes."""
    return Task(
        two(t, 18, F8),
        two(t, 19, F8),
        two(t, 20, F8),
        two(t, 21, F8),
        two(t, 22, I8),
        two(t, 23, I8),
        two(t, 24, F8),
        two(t, 25, F8),
        two(t, 26, I8),
        two(t, 27, U8),
        two(t, 28, F8),
        one(t, 29, F8),
        one(t, 30, F8),
        one(t, 31, F8),
        three(t, 32, F8),
        two(t, 33, F4),
        one(t, 34, F8),
        two(t, 35, F8),
        one(t, 36, B1),
        one(t, 37, B1),
        one(t, 38, F8),
        one(t, 39, F8),
        t[9],
        t[10],
    )


@inlined
def open_control(t: NDArray[np.int64]) -> Control:
    """Return what a step is told and what it reports."""
    return Control(
        one(t, 40, F8),
        one(t, 41, F8),
        one(t, 42, F8),
        one(t, 43, F8),
        two(t, 44, F8),
        two(t, 45, F8),
        one(t, 46, F8),
    )


@inlined
def open_setup(t: NDArray[np.int64]) -> Setup:
    """Return what the joints share; commands are currents."""
    h, dt = np.int64(t[7]).view(np.float64), np.int64(t[8]).view(np.float64)
    return Setup((t[0], t[1], t[2]), t[3], t[4], t[5], t[6] < 0, h, t[6], dt)


@inlined
def open_kind(t: NDArray[np.int64]) -> Kind:
    """Return what the joints have in common."""
    return Kind(t[11], t[12], t[13], t[14], t[15], t[16], t[17], t[18])


@vectorisable
def command(control: Control, i: int) -> bool:
    """Turn action and base of episode i into a current; return whether the action is finite."""
    action, scale, limit = control.action[i], control.factors[0], control.factors[1]
    if not math.isfinite(action):
        return False
    control.residual[i] = min(max(action, -1.0), 1.0) * scale
    control.wanted[i] = min(max(control.base[i] + control.residual[i], -limit), limit)
    control.commands[i, 0] = control.wanted[i] / control.factors[2]
    return True


@vectorisable
def tell(batch: Batch, task: Task, control: Control, i: int) -> None:
    """Conclude the step of episode i and write its report."""
    conclude_one(batch, task, i, control.wanted[i])
    report = control.report
    report[0, i], report[1, i] = batch.tau[i], batch.measured[i, TAU]
    report[2, i], report[3, i] = task.reference[i], task.command[i]
    report[4, i], report[5, i] = control.base[i], control.residual[i]
    for j in range(SAFETY + 1):
        report[6 + j, i] = task.terms[i, j]


@vectorisable
def step_episodes(t: NDArray[np.int64], begin: int, end: int, thread: int) -> int:
    """Step the episodes of blocks begin to end.

    Args:
        t: What `table_of` has noted.
        begin: First block.
        end: Behind the last block.
        thread: Whose scratch to use.

    Returns:
        How many joints it left to the general kernel, whose episodes it then has not concluded,
        or `BAD_ACTION` before anything has moved.
    """
    batch, setup, kind, blocks = open_batch(t), open_setup(t), open_kind(t), open_blocks(t)
    task, control = open_task(t), open_control(t)
    first, last = begin * WIDTH, min(end * WIDTH, task.load.shape[0])
    good = True
    for i in range(first, last):
        good = command(control, i) and good
    if not good:
        return BAD_ACTION
    loads = task.load
    left = advance_blocks(batch, setup, kind, blocks, control.commands, loads, begin, end, thread)
    for i in range(first, last):
        if not blocks.left[i]:
            tell(batch, task, control, i)
    return left


@vectorisable
def tell_some(batch: Batch, task: Task, control: Control, mask: NDArray[np.bool_]) -> None:
    """Conclude the steps of the episodes in a mask."""
    for i in range(mask.shape[0]):
        if mask[i]:
            tell(batch, task, control, i)


@vectorisable
def command_all(control: Control) -> bool:
    """Turn all actions and bases into currents; return whether the actions are finite."""
    good = True
    for i in range(control.action.shape[0]):
        good = command(control, i) and good
    return good
