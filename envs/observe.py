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
from cjt_gym.joint.compiled import compiled, inlined
from cjt_gym.joint.random_stream import mix, uniform
from cjt_gym.signals.evaluate import evaluate

Floats = NDArray[np.float64]
Masks = NDArray[np.bool_]
Words = NDArray[np.uint64]

TERMS = ("tracking", "precision", "smoothness", "effort", "safety")
TRACKING, PRECISION, SMOOTHNESS, EFFORT, SAFETY = range(len(TERMS))
FINE = 0.05
"""Error over the torque amplitude up to which the term `precision` grows about linearly."""


class Task(NamedTuple):
    """Constants of a task, and the arrays of its n episodes.

    Attributes:
        reference_rows: Signals of which an episode draws its reference, shape (signals, 6).
        disturbance_rows: Likewise for the load, shape (signals, 6).
        reference_tables: Their tables one below the other, shape (rows, 2).
        disturbance_tables: Likewise.
        reference_spans: First and last row of each one's table, shape (signals, 2).
        disturbance_spans: Likewise.
        reference_row: The reference of each episode, shape (n, 6).
        disturbance_row: The disturbance of each episode, shape (n, 6).
        picks: Index of the reference and the disturbance of each episode, shape (n, 2).
        keys: Keys of reference and disturbance, shape (n, 2).
        start: Initial states, shape (n, 6).
        load: Load input at the present time, shape (n,).
        reference: Reference at the present time, shape (n,) [N m].
        command: Last motor torque commanded, shape (n,) [N m].
        observation: Shape (n, size), float32; the past in it is that of the next one, too.
        reward: Shape (n,).
        terms: Weighted reward terms, shape (n, 5).
        terminated: Shape (n,).
        truncated: Shape (n,).
        weights: Of the reward terms, shape (5,).
        divisors: Of the fields of `Observed`, shape (7,).
        amplitude: Torque that references and rewards are divided by [N m].
        most_speed: Speed of the motor beyond which an episode ends [rad/s].
        most_torque: Joint torque beyond which it ends [N m].
        dt: Control step [s].
        n: Gear ratio.
        size: Numbers of an observation up to its past.
        episode_steps: Control steps after which an episode is truncated.
        preview: Future samples of the reference in the observation.
    """

    reference_rows: Floats
    disturbance_rows: Floats
    reference_tables: Floats
    disturbance_tables: Floats
    reference_spans: NDArray[np.int64]
    disturbance_spans: NDArray[np.int64]
    reference_row: Floats
    disturbance_row: Floats
    picks: NDArray[np.int64]
    keys: NDArray[np.uint64]
    start: Floats
    load: Floats
    reference: Floats
    command: Floats
    observation: NDArray[np.float32]
    reward: Floats
    terms: Floats
    terminated: Masks
    truncated: Masks
    weights: Floats
    divisors: Floats
    amplitude: float
    most_speed: float
    most_torque: float
    dt: float
    n: float
    size: int
    episode_steps: int
    preview: int


class Seen(NamedTuple):
    """What a task sees of a joint at the end of a control step.

    Attributes:
        k: Control steps since the episode began.
        q_m: Measured angle of the motor [rad].
        dq_m: Measured velocity of the motor [rad/s].
        dq_l: Measured velocity of the load [rad/s].
        tau: Measured joint torque [N m].
        true_tau: Joint torque that is rewarded, on a real joint the measured one [N m].
        true_dq_m: True velocity, which is limited [rad/s].
    """

    k: int
    q_m: float
    dq_m: float
    dq_l: float
    tau: float
    true_tau: float
    true_dq_m: float


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

    Args:
        task: The task.
        i: Which episode.
        now: What is seen of its joint.
        rotor: Sine and cosine of the measured angle of the rotor.
        begun: Whether there was an observation before.
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
    """Put a sample into an observation, before those of the past.

    Args:
        out: What follows the reference in the observation before, shape (3 + 4 history,).
        sample: The sample.
        divisors: What divides it, shape (7,).
        begun: Whether there is a past; the first sample stands for all of it.
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
