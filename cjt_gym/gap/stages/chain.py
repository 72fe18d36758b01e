"""The linear chain motor - gear - load, or a cut piece of it, and its steady-state predictor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from cjt_gym.joint.kernel.arrays import Floats

MOTOR, GEAR, LOAD = range(3)


@dataclass(frozen=True)
class Chain:
    """A piece of the joint, discretised for torques held and positions ramped over a sample."""

    # transition matrix, shape (n, n); the state is the coordinates, then their velocities
    a: Floats
    torque: Floats  # effect of a constant torque on motor, gear and load, shape (n, 3)
    ramp: Floats  # effect of a torque that rises from -1/2 to 1/2 over the sample, shape (n, 3)
    start: Floats  # effect of the prescribed position at the start of the sample, shape (n,)
    slope: Floats  # effect of its mean velocity over the sample, shape (n,)
    # coordinate of motor, gear and load; -1 if the body is not part of it
    groups: tuple[int, int, int]

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return int(self.a.shape[0] // 2)

    def velocity(self, body: int) -> int:
        """Index of a body's velocity in the state."""
        return self.size + self.groups[body]


@dataclass(frozen=True)
class Link:
    """A spring with a damper between two bodies, one of which may be prescribed."""

    one: int | None  # body, or None where its position is prescribed
    other: int | None  # the other body, or None
    stiffness: float  # [N m/rad]
    damping: float  # [N m s/rad]


def build_chain(
    groups: tuple[int, int, int],
    inertia: Sequence[float],
    damping: Sequence[float],
    links: Sequence[Link],
    dt: float,
) -> Chain:
    """Return the discretised chain.

    Args:
        groups: Coordinate of motor, gear and load, -1 for a body outside.
        inertia: Of the three bodies [kg m^2].
        damping: To ground, of the three bodies [N m s/rad].
        links: Springs between bodies.
        dt: Sample time [s].
    """
    size = max(groups) + 1
    mass, drag, spring = np.zeros(size), np.zeros((size, size)), np.zeros((size, size))
    entry, entry_rate = np.zeros(size), np.zeros(size)
    for body, group in enumerate(groups):
        if group >= 0:
            mass[group] += inertia[body]
            drag[group, group] += damping[body]
    for link in links:
        ends = [None if b is None else groups[b] for b in (link.one, link.other)]
        for here, there in (ends, ends[::-1]):
            if here is None:
                continue
            spring[here, here] += link.stiffness
            drag[here, here] += link.damping
            if there is None:
                entry[here] += link.stiffness
                entry_rate[here] += link.damping
            else:
                spring[here, there] -= link.stiffness
                drag[here, there] -= link.damping
    return _discretise(mass, drag, spring, entry, entry_rate, groups, dt)


def _discretise(
    mass: Floats,
    drag: Floats,
    spring: Floats,
    entry: Floats,
    entry_rate: Floats,
    groups: tuple[int, int, int],
    dt: float,
) -> Chain:
    size = mass.size
    n = 2 * size
    # Augmented state: chain, the three torques, the prescribed position and its velocity, and the
    # rates of the torques.
    full = np.zeros((n + 8, n + 8))
    full[:size, size:n] = np.eye(size)
    full[size:n, :size] = -spring / mass[:, None]
    full[size:n, size:n] = -drag / mass[:, None]
    for body, group in enumerate(groups):
        if group >= 0:
            full[size + group, n + body] = 1.0 / mass[group]
    full[size:n, n + 3] = entry / mass
    full[size:n, n + 4] = entry_rate / mass
    full[n + 3, n + 4] = 1.0
    full[n : n + 3, n + 5 :] = np.eye(3)
    step = expm(full * dt)
    torque = step[:n, n : n + 3]
    ramp = step[:n, n + 5 :] / dt - 0.5 * torque
    return Chain(step[:n, :n], torque, ramp, step[:n, n + 3], step[:n, n + 4], groups)


def kalman_gain(
    chain: Chain, outputs: Sequence[int], torque_std: Sequence[float], noise: Sequence[float]
) -> Floats:
    """Return the steady-state gain, shape (n, m).

    Args:
        chain: The piece of the joint.
        outputs: Measured coordinates.
        torque_std: White torque noise on motor, gear and load, per sample [N m].
        noise: Standard deviation of each measurement, per sample.
    """
    n, m = chain.a.shape[0], len(outputs)
    c = np.zeros((m, n))
    c[np.arange(m), list(outputs)] = 1.0
    std = np.array([s if g >= 0 else 0.0 for s, g in zip(torque_std, chain.groups, strict=True)])
    effect = chain.torque * std
    process = effect @ effect.T
    process += 1e-12 * np.trace(process) * np.eye(n)
    r = np.diag(np.square(noise))
    scale = 1.0 / np.mean(np.square(noise))
    p = solve_discrete_are(chain.a.T, c.T, process * scale, r * scale) / scale
    s = c @ p @ c.T + r
    return np.asarray(p @ c.T @ np.linalg.inv(s))
