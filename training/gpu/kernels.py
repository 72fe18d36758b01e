"""The environment's step and its begin as CUDA kernels: one thread per episode.

Each calls the very functions that the CPU runs; numba-cuda compiles them as device functions. Every
effect, structure and drive is there, because nothing is written twice.
"""

from __future__ import annotations

import math
from typing import Any

import numba.cuda
import numpy as np
from numba import float64
from numpy.typing import NDArray

from cjt_gym.envs.observe import Control, Task, draw_episode, rotor_angle
from cjt_gym.envs.step import begin, command, seen, tell
from cjt_gym.joint.kernel.arrays import Q_M, WORK_ROWS, WORK_WIDTH, Batch, Floats, Setup
from cjt_gym.joint.kernel.compiled import lean
from cjt_gym.joint.kernel.control_steps import control_step, restart
from cjt_gym.joint.kernel.discretize import SCRATCH
from cjt_gym.joint.kernel.disturbance import disturbed_load, is_disturbed
from cjt_gym.plant.randomization.draw import Draws, Program
from cjt_gym.plant.simulated import redraw_one

cuda: Any = numba.cuda  # it has no types
WORK: Any = (WORK_ROWS, WORK_WIDTH)


@lean
def clear(work: Floats) -> None:
    """Fill the scratch of a thread, which begins with what others left, with zeros."""
    for row in range(work.shape[0]):
        for column in range(work.shape[1]):
            work[row, column] = 0.0


def step_episodes(
    batch: Batch,
    setup: Setup,
    task: Task,
    control: Control,
    program: Program,
    draws: Draws,
    failed: NDArray[np.int64],
) -> None:
    """Advance an episode by one control step and observe.

    `failed`, shape (1,), becomes 1 + the index of one without a finite action or state.
    """
    i = cuda.grid(1)
    if i >= task.load.shape[0]:
        return
    k = batch.samples[i]
    if program.rows.shape[0] > 0 and k > 0:
        scratch = cuda.local.array(SCRATCH, float64)
        draws.changed[i] = redraw_one(batch, setup, program, draws, i, k, scratch)
    if not command(control, i):
        failed[0] = i + 1
        return
    load = task.load[i]
    if is_disturbed(batch.p[i]):
        load = disturbed_load(batch.p[i], batch.memory[i], setup, batch.rng, i, k, load)
    work = cuda.local.array(WORK, float64)
    clear(work)
    if not control_step(batch, setup, i, control.commands[i, 0], 0.0, load, work):
        failed[0] = i + 1
        return
    angle = rotor_angle(task, batch.measured[i, Q_M])
    tell(batch, task, control, i, math.sin(angle), math.cos(angle))


def begin_episodes(
    batch: Batch,
    setup: Setup,
    task: Task,
    program: Program,
    draws: Draws,
    last: NDArray[np.float32],
    everyone: bool,
) -> None:
    """Begin an episode anew that has ended, or every one; `last` takes what it observed last."""
    i = cuda.grid(1)
    if i >= task.load.shape[0] or not (everyone or task.terminated[i] or task.truncated[i]):
        return
    for j in range(last.shape[1]):
        last[i, j] = task.observation[i, j]
    draw_episode(batch.rng, task, i)
    if program.rows.shape[0] > 0:
        scratch = cuda.local.array(SCRATCH, float64)
        redraw_one(batch, setup, program, draws, i, 0, scratch)
    for j in range(6):
        batch.state[i, j] = task.start[i, j]
    work = cuda.local.array(WORK, float64)
    clear(work)
    restart(batch, setup, i, task.load[i], work)
    begin(task, i, seen(batch, i))
