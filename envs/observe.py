"""What a task computes, compiled: draw an episode, look up its signals, reward, observe.

It knows of a joint no more than is `Seen` of it, so that a real joint serves as a simulated one
does. `cjt_gym.envs.step` tells in which order it is called.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.observation import CLIP, PAST, PRESENT, Observed
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.compiled import compiled, inlined
from cjt_gym.joint.kernel.random_stream import mix, uniform
from cjt_gym.signals.evaluate import evaluate

Masks = NDArray[np.bool_]
Words = NDArray[np.uint64]

TERMS = ("tracking", "precision", "smoothness", "effort", "safety")
TRACKING, PRECISION, SMOOTHNESS, EFFORT, SAFETY = range(len(TERMS))
REPORT = (
    *("tau", "tau_measured", "tau_reference", "tau_command", "base_action", "residual"),
    *(f"reward/{name}" for name in TERMS),
)
"""What a step reports of an episode: keys of its info."""
FINE = 0.05
"""Error over the torque amplitude up to which the term `precision` grows about linearly."""


class Task(NamedTuple):
    """Constants of a task, and the arrays of its n episodes."""

    reference_rows: Floats  # signals of which an episode draws its reference, shape (signals, 6)
    disturbance_rows: Floats  # likewise for the load, shape (signals, 6)
    reference_tables: Floats  # their tables one below the other, shape (rows, 2)
    disturbance_tables: Floats  # likewise
    reference_spans: NDArray[np.int64]  # first and last row of each one's table, shape (signals, 2)
    disturbance_spans: NDArray[np.int64]  # likewise
    reference_row: Floats  # the reference of each episode, shape (n, 6)
    disturbance_row: Floats  # the disturbance of each episode, shape (n, 6)
    # index of the reference and the disturbance of each episode, shape (n, 2)
    picks: NDArray[np.int64]
    keys: NDArray[np.uint64]  # keys of reference and disturbance, shape (n, 2)
    start: Floats  # initial states, shape (n, 6)
    load: Floats  # load input at the present time, shape (n,)
    reference: Floats  # reference at the present time, shape (n,) [N m]
    command: Floats  # last motor torque commanded, shape (n,) [N m]
    # shape (n, size), float32; the past in it is that of the next one, too
    observation: NDArray[np.float32]
    reward: Floats  # shape (n,)
    terms: Floats  # weighted reward terms, shape (n, 5)
    terminated: Masks  # shape (n,)
    truncated: Masks  # shape (n,)
    weights: Floats  # of the reward terms, shape (5,)
    divisors: Floats  # of the fields of `Observed`, shape (7,)
    amplitude: float  # torque that references and rewards are divided by [N m]
    most_speed: float  # speed of the motor beyond which an episode ends [rad/s]
    most_torque: float  # joint torque beyond which it ends [N m]
    dt: float  # control step [s]
    n: float  # gear ratio
    size: int  # numbers of an observation up to its past
    episode_steps: int  # control steps after which an episode is truncated
    preview: int  # future samples of the reference in the observation


class Seen(NamedTuple):
    """What a task sees of a joint at the end of a control step."""

    k: int  # control steps since the episode began
    q_m: float  # measured angle of the motor [rad]
    dq_m: float  # measured velocity of the motor [rad/s]
    dq_l: float  # measured velocity of the load [rad/s]
    tau: float  # measured joint torque [N m]
    true_tau: float  # joint torque that is rewarded, on a real joint the measured one [N m]
    true_dq_m: float  # velocity that is limited, likewise [rad/s]


class Control(NamedTuple):
    """What a step is told and what it reports."""

    action: Floats  # in [-1, 1], shape (n,); values outside are clipped
    base: Floats  # motor torque of the base controller, shape (n,) [N m]
    residual: Floats  # motor torque of the action, shape (n,) [N m]
    wanted: Floats  # both, within the limits, shape (n,) [N m]
    commands: Floats  # the same as currents [A], shape (n, 2)
    report: Floats  # columns of `REPORT`, shape (1, 11) for a single episode, else (0, 11)
    factors: Floats  # [action scale, torque limit, torque per ampere]


def make_control(num: int, action_scale: float, limit: float, torque_per_ampere: float) -> Control:
    """Allocate for `num` episodes."""
    return Control(
        action=np.zeros(num),
        base=np.zeros(num),
        residual=np.zeros(num),
        wanted=np.zeros(num),
        commands=np.zeros((num, 2)),
        report=np.zeros((1 if num == 1 else 0, len(REPORT))),
        factors=np.array([action_scale, limit, torque_per_ampere]),
    )


@inlined
def reference_at(task: Task, i: int, t: float) -> float:
    """Return the reference of episode i at time t [N m]."""
    span = task.reference_spans[task.picks[i, 0]]
    table = task.reference_tables[span[0] : span[1]]
    return float(evaluate(task.reference_row[i], task.keys[i, 0], table, t))


@inlined
def load_at(task: Task, i: int, t: float) -> float:
    """Return the load input of episode i at time t [N m or rad/s]."""
    span = task.disturbance_spans[task.picks[i, 1]]
    table = task.disturbance_tables[span[0] : span[1]]
    return float(evaluate(task.disturbance_row[i], task.keys[i, 1], table, t))


@inlined
def draw_episode(rng: Words, task: Task, i: int) -> None:
    """Draw reference, disturbance and the angle of the joint for episode i."""
    for j, rows in enumerate((task.reference_rows, task.disturbance_rows)):
        pick = int(uniform(rng, i) * rows.shape[0])
        task.picks[i, j] = pick
        drawn = task.reference_row[i] if j == 0 else task.disturbance_row[i]
        for column in range(rows.shape[1]):  # an assignment of rows takes seconds to compile
            drawn[column] = rows[pick, column]
        task.keys[i, j] = mix(rng[i] + np.uint64(j + 1))
    angle = 2.0 * math.pi * uniform(rng, i)
    for body in range(3):
        task.start[i, body] = angle
        task.start[i, 3 + body] = 0.0
    task.load[i] = load_at(task, i, 0.0)


@compiled
def draw_episodes(rng: Words, task: Task, mask: Masks) -> None:
    """Draw reference, disturbance and the angle of the joint for the episodes in a mask."""
    for i in range(mask.shape[0]):
        if mask[i]:
            draw_episode(rng, task, i)


@inlined
def limited(x: float) -> float:
    """Clip an observation to its finite box."""
    return min(max(x, -CLIP), CLIP)


@inlined
def look_up(task: Task, i: int, k: int) -> None:
    """Set reference and load of episode i after k control steps."""
    t = k * task.dt
    task.reference[i] = reference_at(task, i, t)
    task.load[i] = load_at(task, i, t)


@inlined
def reward(task: Task, i: int, now: Seen, command: float) -> None:
    """Reward the step of episode i with its motor torque [N m], and note whether it ended."""
    weights = task.weights
    error = (task.reference[i] - now.true_tau) / task.amplitude
    change = (command - task.command[i]) / task.amplitude
    task.command[i] = command
    too_fast = abs(now.true_dq_m) > task.most_speed
    too_strong = abs(now.true_tau) > task.most_torque
    task.terminated[i] = too_fast or too_strong
    task.truncated[i] = now.k >= task.episode_steps and not task.terminated[i]
    terms = task.terms[i]
    terms[TRACKING] = -weights[TRACKING] * abs(error)
    terms[PRECISION] = 0.0
    if weights[PRECISION] > 0.0:
        fine = math.log1p(abs(error) / FINE) / math.log1p(1.0 / FINE)
        terms[PRECISION] = -weights[PRECISION] * fine
    terms[SMOOTHNESS] = -weights[SMOOTHNESS] * change * change
    terms[EFFORT] = -weights[EFFORT] * (command / task.amplitude) ** 2
    terms[SAFETY] = -weights[SAFETY] if task.terminated[i] else 0.0
    total = 0.0
    for j in range(SAFETY + 1):
        total += terms[j]
    task.reward[i] = total


@inlined
def rotor_angle(task: Task, q_m: float) -> float:
    """Return the angle of the rotor for one of the motor on the link side [rad]."""
    return float(task.n * q_m)


@inlined
def observe(task: Task, i: int, now: Seen, rotor: tuple[float, float], begun: bool) -> None:
    """Write the observation of episode i, which has begun before or begins.

    `rotor` is the sine and cosine of the rotor's measured angle.
    """
    out, t = task.observation[i], now.k * task.dt
    for ahead in range(task.preview + 1):
        value = task.reference[i] if ahead == 0 else reference_at(task, i, t + ahead * task.dt)
        out[ahead] = limited(value / task.amplitude)
    error = task.reference[i] - now.tau
    sample = Observed(error, rotor[0], rotor[1], now.tau, now.dq_m, now.dq_l, task.command[i])
    put_sample(out[task.preview + 1 : task.size], sample, task.divisors, begun)


@inlined
def put_sample(out: NDArray[np.float32], sample: Observed, divisors: Floats, begun: bool) -> None:
    """Put a sample, over its divisors, into an observation, before those of the past.

    `out` is what follows the reference in the observation before, shape (3 + 4 history,). Before an
    episode has begun there is no past, and its first sample stands for all of it.
    """
    for j in range(PRESENT):
        out[j] = limited(sample[j] / divisors[j])
    past = out[PRESENT:]
    if begun:
        for k in range(past.shape[0] - 1, PAST - 1, -1):
            past[k] = past[k - PAST]
    for j in range(PAST):
        past[j] = limited(sample[PRESENT + j] / divisors[PRESENT + j])
    if not begun:
        for k in range(PAST, past.shape[0]):
            past[k] = past[k - PAST]
