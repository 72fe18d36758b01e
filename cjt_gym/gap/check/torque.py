"""What a record shows of the motor's torque: its constant, its heat, its ripple."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from cjt_gym.gap.check.balance import Balance, Floats
from cjt_gym.gap.check.friction import seen
from cjt_gym.gap.check.verdicts import Seen, Unseen, Verdict, no_balance, only_from
from cjt_gym.gap.check.view import View

CONSTANT = 0.3
"""Relative difference of the torque constant up to which its least size may come."""
WARMING = (2.0, 5.0, 10.0, 40.0)
"""Time constants of heat that are tried [s]."""
SHORTEST_HEAT = 5.0
"""Time that a record of warming covers at least [s]."""
DROP = 0.3
"""Share of the torque up to which the least drop may come."""
PER_TURN = np.geomspace(1.0, 200.0, 48)
"""Periods of a ripple per turn of the rotor that are tried."""
PERIODS = 1.5
"""Periods of a ripple that a record covers at least."""
FEWEST = 100
"""Samples of slow passes at least."""


def torque_constant(view: View) -> Verdict:
    """A torque constant needs a known torque: without one, all else can be off with it."""
    if (none := no_balance(view)) is not None:
        return none
    balance = view.motor
    assert balance is not None
    instead = "Record a static phase with the joint torque tau, or hang on a known weight."
    known = "tau" in view or "tau_l" in view
    if not known:
        why = "no torque is measured: inertia and friction, off by the same factor, look alike"
        return Unseen(why, instead)
    size = balance.least(balance["u"], ("a", "v", "s", "one"))
    if size <= CONSTANT:
        return Seen(size, "-")
    return Unseen(only_from(size, "-"), instead)


def thermal_derating(view: View) -> Verdict:
    """Torque that falls with heat needs torque for long."""
    if (none := no_balance(view)) is not None:
        return none
    instead = "Record constant torque near the rated one at rest, for a minute or longer."
    if view.seconds < SHORTEST_HEAT:
        return Unseen(f"the record lasts {view.seconds:.2g} s", instead)
    balance = view.motor
    assert balance is not None
    heats = [_heat(view, balance, constant) for constant in WARMING]
    names = ("u", "a", "v", "s", "one")
    size = min(balance.least(balance["u"] * heat, names) for heat in heats)
    if size <= DROP:
        return Seen(size, "-")
    return Unseen(f"as a drop over {view.seconds:.3g} s {only_from(size, '-')}", instead)


def _heat(view: View, balance: Balance, constant: float) -> Floats:
    """Return how warm the windings are while the motor moves, 1 at the most; shape (N,)."""
    assert view.drive is not None
    keep = float(np.exp(-view.dt / constant))
    parts = []
    for piece in view.stretches:
        heat = lfilter([1.0 - keep], [1.0, -keep], piece[view.drive] ** 2)
        parts.append((piece["t"], heat))
    at = balance["time"]
    rows = balance["stretch"].astype(int)
    out = np.zeros(len(balance))
    for k, (t, heat) in enumerate(parts):
        own = rows == k
        out[own] = np.interp(at[own], t, heat)
    warmest = float(out.max())
    return out / warmest if warmest > 1e-200 else np.zeros_like(out)


def cogging(view: View) -> Verdict:
    """A torque periodic in the rotor's angle needs slow passes over several periods."""
    return _ripple(view, lambda balance: np.ones(len(balance)), view.torque_unit)


def gear_ripple(view: View) -> Verdict:
    """A ripple that grows with the load needs the transmitted torque, too."""
    if (none := no_balance(view)) is not None:
        return none
    if "tau" not in view:
        why = "the transmitted torque tau is not recorded, so that it is one with cogging"
        return Unseen(why, "Record tau, and pass the same angles at different torques.")
    return _ripple(view, lambda balance: balance["tau"], "-")


def _ripple(view: View, carrier, unit: str) -> Verdict:  # type: ignore[no-untyped-def]
    if (none := no_balance(view)) is not None:
        return none
    balance = view.motor
    assert balance is not None
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
        term = np.where(slow, np.cos(f * balance["q"]) * carrier(balance), 0.0)
        found = seen(view, balance, term, ("a", "v", "s", "one"), unit, instead)
        if isinstance(found, Seen) and (not isinstance(best, Seen) or found.size < best.size):
            best = found
        best = best or found
    return best or _no_ripple(view, balance, travel, instead)


def _fine(view: View, f: float) -> bool:
    """Whether a period of a ripple is many counts of the angle."""
    assert view.motor_angle is not None
    return f * view.angle_noise(view.motor_angle) < 0.5


def _no_ripple(view: View, balance: Balance, travel: float, instead: str) -> Unseen:
    slowest = float(np.quantile(np.abs(balance["v"]), 0.1))
    turns = travel * view.ratio / (2.0 * np.pi)
    if turns * PER_TURN[-1] < PERIODS:
        return Unseen(f"the rotor turns by {turns:.2g} of a turn only", instead)
    unit = view.angle_unit
    why = (
        f"even its slowest tenth moves at {slowest:.2g} {unit}/s, a period of the ripple passes "
        f"within a few samples of {1e3 * view.dt:.3g} ms"
    )
    return Unseen(why, instead)
