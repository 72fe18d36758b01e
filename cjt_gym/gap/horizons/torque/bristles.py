"""Dry friction that builds up over a path, as a regressor of the torque.

After a reversal the friction of bristles needs a path to turn round, over which it looks like a
torque that follows the speed. A regression on speed and its sign then takes it for damping.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from cjt_gym.joint.kernel.arrays import Floats

SHORTEST, LONGEST, STEPS = 1e-3, 0.3, 12
"""Paths that are tried, as shares of the travel, and their number."""
FEWEST = 6
"""Fewest ways of one direction, each longer than the path, between which friction turns round; over
one way there and back a friction over the path is any function of the angle."""


def bent(q: Floats, path: float) -> Floats:
    """Return friction over its level where it turns round over a path, shape (N,).

    It is Dahl's law, the bristles of the effect `presliding` without their damping: with s from
    -1 to 1, ds = (dq - |dq| s) / path.

    Args:
        q: Angle or position, shape (N,).
        path: Path over which friction turns round, its level over the bristles' stiffness.

    Example:
        >>> bent(np.array([0.0, 1.0, 0.0]), 0.1).round(3)
        array([ 0.,  1., -1.])
    """
    steps = np.diff(q, prepend=q[:1])
    known = np.maximum.accumulate(np.where(steps != 0.0, np.arange(len(q)), 0))
    way = np.sign(steps)[known]
    gone = np.cumsum(np.abs(steps))
    turns = np.flatnonzero(np.diff(way, prepend=0.0))
    found, before = np.zeros(len(q)), 0.0
    for first, last in pairwise([*turns, len(q)]):
        moved = gone[first:last] - gone[first - 1]
        found[first:last] = way[first] + (before - way[first]) * np.exp(-moved / path)
        before = found[last - 1]
    return found


def ways(q: Floats, path: float) -> int:
    """Return how often an angle goes further in one direction than a path."""
    steps = np.diff(q)
    steps = steps[steps != 0.0]
    turns = np.flatnonzero(np.diff(np.sign(steps))) + 1
    return int(sum(abs(one.sum()) > path for one in np.split(steps, turns)))


def paths(travel: float) -> Floats:
    """Return the paths that are tried, shortest first."""
    return np.asarray(travel * np.geomspace(SHORTEST, LONGEST, STEPS))
