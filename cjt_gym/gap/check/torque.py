"""What a record shows of the motor's torque: constant, thermal derating, ripple."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from cjt_gym.gap.check.balance import Balance
from cjt_gym.gap.check.friction import seen
from cjt_gym.gap.check.pieces import Columns
from cjt_gym.gap.check.verdicts import Seen, Unseen, Verdict, from_balance, only_from
from cjt_gym.gap.check.view import View
from cjt_gym.joint.kernel.arrays import Floats

CONSTANT = 0.3
"""Upper limit on the smallest identifiable relative difference of the torque constant."""
WARMING = (2.0, 5.0, 10.0, 40.0)
"""Candidate thermal time constants [s]."""
SHORTEST_HEAT = 5.0
"""Least duration of a record for thermal derating [s]."""
DROP = 0.3
"""Upper limit on the smallest identifiable relative drop of the torque."""
PER_TURN = np.geomspace(1.0, 200.0, 48)
"""Candidate numbers of ripple periods per turn of the rotor."""
KNOWN_TORQUE = "Record a static phase with the joint torque tau, or attach a known weight."
"""What tells a torque constant from an inertia."""
PERIODS = 1.5
"""Fewest ripple periods that a record must cover."""
FEWEST = 100
"""Fewest samples at low speed."""


@from_balance
def torque_constant(view: View, balance: Balance) -> Verdict:
    """Judge the torque constant, which requires a known torque to fix the overall scale.

    On a voltage, what the back EMF takes away is such a torque if the damping is known.
    """
    size = _by_back_emf(view, balance)
    if size <= CONSTANT:
        return Seen(size, "-")
    if not view.cut and "tau_l" not in view:
        what = "used" if "tau" in view else "measured"
        why = f"no torque is {what}: inertia and friction, off by the same factor, look alike"
        return Unseen(why, KNOWN_TORQUE)
    size = balance.least(balance["u"], ("a", "v", "s", "one"))
    if size <= CONSTANT:
        return Seen(size, "-")
    return Unseen(only_from(size, "-"), KNOWN_TORQUE)


def _by_back_emf(view: View, balance: Balance) -> float:
    """Return the least relative difference of a torque constant that the back EMF shows.

    A torque constant larger by a share s looks like a damping lower by s (b - d), where b is that
    of the back EMF and d the datasheet's, whose own uncertainty it must exceed.
    """
    if view.drive != "v" or view.joint is None or view.joint.parameters.takes_volts:
        return float("inf")
    known = view.joint.parameters.quantities
    stated = [q for b in "mgl" if (q := known.get(f"d_{b}")) is not None and q.number > 0.0]
    if not stated or any(q.guess or q.tolerance is None for q in stated):
        return float("inf")
    back = view.torque_per_input * view.value("k_t") * view.ratio
    apart = back - sum(q.number for q in stated)
    if apart <= 0.0:
        return float("inf")
    open_ = sum(q.number * (q.tolerance or 0.0) for q in stated) / apart
    return max(balance.least(apart * balance["v"], ("a", "s", "one")), open_)


@from_balance
def thermal_derating(view: View, balance: Balance) -> Verdict:
    """Judge thermal derating, which requires torque over a long time."""
    instead = "Record constant torque near the rated one at rest, for a minute or longer."
    if view.seconds < SHORTEST_HEAT:
        return Unseen(f"the record lasts {view.seconds:.2g} s", instead)
    heats = [_heat(view, constant) for constant in WARMING]
    names = ("u", "a", "v", "s", "one")
    size = min(balance.least(balance["u"] * heat, names) for heat in heats)
    if size <= DROP:
        return Seen(size, "-")
    return Unseen(f"as a drop over {view.seconds:.3g} s {only_from(size, '-')}", instead)


def _heat(view: View, constant: float) -> Floats:
    """Return the relative winding heat while the motor moves, at most 1, shape (N,)."""
    keep = float(np.exp(-view.dt / constant))

    def heat(piece: Columns) -> Floats:
        return np.asarray(lfilter([1.0 - keep], [1.0, -keep], piece[view.drive or ""] ** 2))

    out = view.at_motion(heat)
    warmest = float(out.max())
    return out / warmest if warmest > 1e-200 else np.zeros_like(out)


@from_balance
def cogging(view: View, balance: Balance) -> Verdict:
    """Judge a torque periodic in the rotor's angle, which requires slow motion over periods."""
    return _ripple(view, balance, balance["one"], view.torque_unit)


@from_balance
def gear_ripple(view: View, balance: Balance) -> Verdict:
    """Judge load-dependent ripple, which also requires the transmitted torque."""
    if "tau" not in balance:
        why = "the transmitted torque tau is not recorded, so that it cannot be told from cogging"
        return Unseen(why, "Record tau, and pass the same angles at different torques.")
    return _ripple(view, balance, balance["tau"], "-")


def _ripple(view: View, balance: Balance, carrier: Floats, unit: str) -> Verdict:
    travel = float(np.ptp(balance["q"]))
    instead = "Record slow passes over several turns of the rotor, at 1 kHz."
    best: Verdict | None = None
    turn = 2.0 * np.pi if view.angle_unit == "rad" else travel
    for per_turn in PER_TURN * view.ratio:
        f = 2.0 * np.pi * per_turn / turn
        if f * travel < 2.0 * np.pi * PERIODS:
            continue
        slow = balance.slow(f, view.dt)
        if slow.sum() < FEWEST or not _fine(view, f):
            continue
        term = np.where(slow, np.cos(f * balance["q"]) * carrier, 0.0)
        found = seen(view, balance, term, ("a", "v", "s", "one"), unit, instead)
        if isinstance(found, Seen) and (not isinstance(best, Seen) or found.size < best.size):
            best = found
        best = best or found
    return best or _no_ripple(view, balance, travel, instead)


def _fine(view: View, f: float) -> bool:
    """Return whether the angle resolves a period of a ripple."""
    assert view.motor_angle is not None
    return f * view.angle_noise(view.motor_angle) < 0.5


def _no_ripple(view: View, balance: Balance, travel: float, instead: str) -> Unseen:
    slowest = float(np.quantile(np.abs(balance["v"]), 0.1))
    turns = travel * view.ratio / (2.0 * np.pi)
    if turns * PER_TURN[-1] < PERIODS:
        return Unseen(f"the rotor moves by only {turns:.2g} of a turn", instead)
    unit = view.angle_unit
    why = (
        f"even its slowest tenth moves at {slowest:.2g} {unit}/s, a period of the ripple passes "
        f"within a few samples of {1e3 * view.dt:.3g} ms"
    )
    return Unseen(why, instead)
