"""Energy that a joint gains and that its motor did not give."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import median_filter
from scipy.signal import savgol_filter

from cjt_gym.gap.check.pieces import Columns
from cjt_gym.gap.check.view import View
from cjt_gym.gap.digits import plain
from cjt_gym.gap.recorded.orient import orient
from cjt_gym.joint.kernel.arrays import Floats

LEVELS = (0.2, 0.35, 0.5, 0.65, 0.8)
"""Quantiles of the angle at which the joint is compared with itself."""
FEWEST = 5
"""Fewest returns to an angle for it to count; most angles must."""
OVER = 0.06
"""Time over which torque and motion are smoothed [s]."""
SHORTEST = 2.0
"""Shortest stretch between two gaps in which returns count [s]."""
SPREAD = 4
"""Decades of inertia, on either side of the usual one, that are tried."""
GROWS, AT_ONCE = 0.5, 3
"""Least gain of a joint whose motor gives nothing, relative to its largest energy, and the returns
over which that is the median: what a pendulum of little friction loses in a swing is smaller than
the noise of its speed, which made 0.2 of it in rows of uncertain instants."""
NOT_THE_INPUT = "it is not the input that moves the joint"
FOREIGN = 0.1
"""Least gain that is told, relative to all energy that the motor gives and takes. Sixty records of
real joints that nothing else moves have at most 0.014, also with a weight and whatever their
inertia is, and joints of arms of which others move up to 0.17; records with a person in an
exoskeleton or with a second robot in contact have 0.12 to 0.97."""


def foreign(view: View) -> list[str]:
    """Return a sentence on a joint that something other than its motor moves.

    Between two instants at one angle a joint gains at most what its motor gives: friction only
    takes, and a weight or spring gives back. That holds for some inertia, which is left open.
    """
    if view.at_rest:
        return []
    share, still = _share(view), _is_constant(view)
    if share < (GROWS if still else FOREIGN):
        return []
    if still:
        value = float(view.driving(view.stretches[0])[0])
        never = "never changes" if value else "is 0 throughout"
        return [
            f"{view.drive} {never}, and the joint gains speed again and again: {NOT_THE_INPUT}, or "
            "something else moves it, such as a hand."
        ]
    backward = _share(view, -1.0) < 0.5 * FOREIGN
    if backward and _is_turned(view):
        return []
    other = f", or the sign of {view.drive} is wrong" if backward else ""
    return [
        "The joint gains energy that its motor does not give, "
        f"{plain(100.0 * share, 2)} % of all that the motor exchanges: something else moves it, "
        f"such as a hand, other joints or a machine{other}."
    ]


def _is_constant(view: View) -> bool:
    """Return whether the torque of the motor is the same throughout, as it is if that is off."""
    return all(np.ptp(view.driving(piece)) == 0.0 for piece in view.stretches)


def _is_turned(view: View) -> bool:
    """Return whether the reader turns the sign of a channel of the longest record."""
    if view.joint is None:
        return False
    _, repairs = orient(max(view.records, key=len), view.joint, view.structure)
    return any(repair.kind == "sign" and repair.changed for repair in repairs)


def _share(view: View, sign: float = 1.0) -> float:
    """Return the energy that something else gives, relative to what the motor exchanges.

    Of a motor with constant torque, which gives nothing between returns to an angle, it is relative
    to the most that the joint has. The back-EMF of a drive by voltage only takes, as friction
    does.
    """
    known = "tau_l" in view or view.structure.has_spring or view.drive is None
    if known or "q_m" not in view:
        return 0.0
    walks = [walk for piece in view.stretches if (walk := _walk(view, piece)) is not None]
    if not walks:
        return 0.0
    levels = np.quantile(np.concatenate([q for q, *_ in walks]), LEVELS)
    found = []
    for level in levels:
        given, moved, kept, exchanged = [], [], [], 0.0
        for q, work, speed, gross in walks:
            at = np.flatnonzero(np.diff(np.sign(q - level)) != 0.0)
            kept.append(0.5 * _at_level(speed, q, level, at) ** 2)
            given.append(np.diff(sign * _at_level(work, q, level, at)))
            moved.append(np.diff(kept[-1]))
            exchanged += float(gross[at[-1]] - gross[at[0]]) if len(at) else 0.0
        if sum(map(len, given)) < FEWEST:
            continue
        work, change = np.concatenate(given), np.concatenate(moved)
        if exchanged > 0.0 and not _is_constant(view):
            found.append(_gain(work, change) / exchanged)
        elif np.any(change):
            most = max(float(energy.max(initial=0.0)) for energy in kept)
            found.append(max(_rise(energy) for energy in kept) / most)
    return float(np.median(found)) if len(found) > len(LEVELS) / 2 else 0.0


def _rise(energy: Floats) -> float:
    """Return by how much an energy grows over any number of returns, but for noise."""
    usual = median_filter(energy, AT_ONCE, mode="nearest")
    return float(np.max(usual - np.minimum.accumulate(usual), initial=0.0))


def _at_level(x: Floats, q: Floats, level: float, at: NDArray[np.intp]) -> Floats:
    """Return a signal at the instants, between two rows each, at which the joint is at an angle."""
    share = (level - q[at]) / (q[at + 1] - q[at])
    return np.asarray(x[at] + share * (x[at + 1] - x[at]))


def _gain(given: Floats, moved: Floats) -> float:
    """Return what is gained between returns to an angle, at the inertia with the least."""
    usual = np.abs(given).sum() / max(np.abs(moved).sum(), 1e-300)
    inertias = [0.0, *(usual * np.logspace(-SPREAD, SPREAD, 20 * SPREAD + 1))]
    return min(float(np.maximum(x * moved - given, 0.0).sum()) for x in inertias)


def _walk(view: View, piece: Columns) -> tuple[Floats, Floats, Floats, Floats] | None:
    """Return angle, work, speed, and work regardless of its sign; None if too short."""
    dt = float(piece["t"][1] - piece["t"][0])
    width = max(5, int(OVER / dt) | 1)
    if len(piece["t"]) < max(SHORTEST / dt, 5 * width):
        return None
    q, speed = (savgol_filter(piece["q_m"], width, 2, deriv=k, delta=dt) for k in (0, 1))
    power = speed * savgol_filter(view.driving(piece), width, 2)
    work, gross = (cumulative_trapezoid(p, dx=dt, initial=0.0) for p in (power, np.abs(power)))
    return q, work, speed, gross
