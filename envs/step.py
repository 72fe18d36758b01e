"""One step of an environment, from the action to the observation.

An episode goes through these calls, in this order:

1. `command`: action and base controller become a torque within the limits, and a current;
2. `advance` moves the joints and reads their sensors, those of a block side by side in vector
   registers (`cjt_gym.joint.lanes`); what a block cannot do is left to the general kernel
   (`cjt_gym.joint.kernel.control_steps`), which `Episodes` calls;
3. `seen`: what the task gets to see of the joint, the only thing that it knows of it;
4. `look_up` and `reward`: the reference now, the reward, and whether the episode ends;
5. `observe`: the observation.

`step_blocks` and `tell_some` are the step for joints in blocks and for those that were left.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.handover import opened
from cjt_gym.envs.observe import SAFETY, Control, Seen, Task, look_up, observe, reward, rotor_angle
from cjt_gym.joint.kernel.arrays import DQ_L, DQ_M, Q_M, TAU, Batch
from cjt_gym.joint.kernel.compiled import compiled, inlined, threaded
from cjt_gym.joint.lanes import advance
from cjt_gym.joint.lanes.substeps import COSINE, SINE
from cjt_gym.joint.lanes.vector_math import sine_cosine
from cjt_gym.joint.lanes.vectors import WIDTH, get, put

BAD_ACTION = -1


@threaded
def step_blocks(address: int, begin: int, end: int, thread: int) -> int:
    """Step the episodes of blocks begin to end.

    A call for all blocks turns actions into commands first; one for some finds them there.

    Returns:
        How many joints it left to the general kernel, whose episodes it then has not concluded,
        or `BAD_ACTION` before anything has moved.
    """
    batch, setup, kind, blocks, task, control = opened(address)
    s, left, num = blocks.scratch[thread], 0, task.load.shape[0]
    if end - begin == blocks.rows.shape[0] and not command_all(control):
        return BAD_ACTION
    for block in range(begin, end):
        share = block, block + 1, thread
        left += advance(batch, setup, kind, blocks, control.commands, task.load, share)
        first = block * WIDTH
        count = min(WIDTH, num - first)
        for lane in range(count):
            s[SINE, lane] = rotor_angle(task, batch.measured[first + lane, Q_M])
        sine, cosine = sine_cosine(get(s, SINE))
        put(s, SINE, sine)
        put(s, COSINE, cosine)
        for lane in range(count):
            if not blocks.left[first + lane]:
                tell(batch, task, control, first + lane, s[SINE, lane], s[COSINE, lane])
    return left


@threaded
def tell_some(batch: Batch, task: Task, control: Control, mask: NDArray[np.bool_]) -> None:
    """Conclude the steps of the episodes in a mask, whose joints have moved."""
    for i in range(mask.shape[0]):
        if mask[i]:
            angle = rotor_angle(task, batch.measured[i, Q_M])
            tell(batch, task, control, i, math.sin(angle), math.cos(angle))


@threaded
def command_all(control: Control) -> bool:
    """Turn all actions and bases into currents; return whether the actions are finite."""
    good = True
    for i in range(control.action.shape[0]):
        good = command(control, i) and good
    return good


@inlined
def command(control: Control, i: int) -> bool:
    """Turn action and base of episode i into a current; return whether the action is finite."""
    action, scale, limit = control.action[i], control.factors[0], control.factors[1]
    if not math.isfinite(action):
        return False
    control.residual[i] = min(max(action, -1.0), 1.0) * scale
    control.wanted[i] = min(max(control.base[i] + control.residual[i], -limit), limit)
    control.commands[i, 0] = control.wanted[i] / control.factors[2]
    return True


@inlined
def seen(batch: Batch, i: int) -> Seen:
    """Return what the task of episode i sees of its joint."""
    measured = batch.measured[i]
    return Seen(
        batch.samples[i],
        measured[Q_M],
        measured[DQ_M],
        measured[DQ_L],
        measured[TAU],
        batch.tau[i],
        batch.state[i, 3],
    )


@inlined
def conclude(task: Task, i: int, now: Seen, command: float, sine: float, cosine: float) -> None:
    """Do what follows the measurement in a step of episode i: signals, reward, observation.

    `command` is the motor torque that was commanded [N m]; sine and cosine are those of the rotor's
    measured angle.
    """
    look_up(task, i, now.k)
    reward(task, i, now, command)
    observe(task, i, now, (sine, cosine), True)


@inlined
def tell(batch: Batch, task: Task, control: Control, i: int, sine: float, cosine: float) -> None:
    """Conclude the step of episode i, with sine and cosine of its rotor; report a single one."""
    now = seen(batch, i)
    conclude(task, i, now, control.wanted[i], sine, cosine)
    if control.report.shape[0] == 0:
        return
    report = control.report[i]
    report[0], report[1] = now.true_tau, now.tau
    report[2], report[3] = task.reference[i], task.command[i]
    report[4], report[5] = control.base[i], control.residual[i]
    for j in range(SAFETY + 1):
        report[6 + j] = task.terms[i, j]


@inlined
def begin(task: Task, i: int, now: Seen) -> None:
    """Observe episode i for the first time; its past is as if it had always been like this."""
    task.command[i] = 0.0
    look_up(task, i, 0)
    angle = rotor_angle(task, now.q_m)
    observe(task, i, now, (math.sin(angle), math.cos(angle)), False)


@compiled
def begin_some(batch: Batch, task: Task, mask: NDArray[np.bool_]) -> None:
    """Observe the episodes in a mask for the first time, whose joints were reset."""
    for i in range(mask.shape[0]):
        if mask[i]:
            begin(task, i, seen(batch, i))


@compiled
def begin_seen(task: Task, now: Seen) -> None:
    """Begin a single episode with what is seen of a joint that is moved elsewhere."""
    begin(task, 0, now)


@compiled
def conclude_seen(task: Task, now: Seen, command: float) -> None:
    """Conclude the step of a single episode with what is seen of a joint that moved elsewhere."""
    angle = rotor_angle(task, now.q_m)
    conclude(task, 0, now, command, math.sin(angle), math.cos(angle))
