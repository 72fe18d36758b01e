"""What a record shows of the motor's inertia and friction, from its torque balance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cjt_gym.gap.check.balance import Balance, factors
from cjt_gym.gap.check.resonances import resonance
from cjt_gym.gap.check.verdicts import (
    TORQUE,
    Seen,
    Unseen,
    Verdict,
    from_balance,
    only_from,
    percent,
)
from cjt_gym.gap.check.view import View
from cjt_gym.joint.kernel.arrays import Floats

BOTH_WAYS = 0.02
"""Least share of the moving samples in the rarer direction, and of the way."""
FEWEST_COUNTS = 10.0
"""Least travel in each direction, in counts."""
INERTIA = 1.0
"""Upper limit on the smallest identifiable inertia difference, relative to the inertia."""
FEWEST_REVERSALS = 4
"""Fewest reversals or breakaways for presliding."""
SLOW = 0.002
"""Least share of the motion that is slower than a tenth of its highest speed."""
STEPS = 3.0
"""Least presliding displacement, in counts or standard deviations of the noise."""
SWING = 0.1
"""Largest presliding displacement, relative to a usual swing."""
APART = 0.05
"""Least share of an effect's torque that other effects cannot explain."""
ONE_SPEED = 0.75
"""Ratio of slow to fast motion (10 and 90 % of it) above which dry and viscous friction look alike:
what then tells them apart is a tenth of the motion. Five real records of one speed have 0.83 to
0.88, all others that were tried at most 0.6."""
LOADED = 0.05
"""Least gravity torque that counts as a load, relative to the driving torque."""
PARTS, SAME, STEADY = 8, 0.2, 0.5
"""Parts of a record whose mean accelerations are compared, and the spread of the torque and of
these, relative to their mean, below which one torque accelerates the joint steadily. Of 563 real
records that is so of one, of a wheel that runs up at a limit of its current."""
RUNS_UP = "one torque accelerates the joint steadily: friction and inertia take it alike"
OTHER_TORQUES = "Record motion under different torques: steps, or a sine."
COASTS = "nothing drives the joint: friction and weight show relative to its inertia only"
TURN = "Record motion in both directions, as often in one as in the other."
SPREAD = "Record slow and fast motion: ramps from rest to full speed in both directions."


def runs_up(balance: Balance) -> bool:
    """Return whether one torque accelerates a joint steadily all the time.

    What friction takes of it and what inertia takes are alike then. The noise of the acceleration
    would let friction take all; over parts of the record it is small.
    """
    parts = np.array([float(np.mean(x)) for x in np.array_split(balance["a"], PARTS)])
    torque, growth = (
        float(np.std(x)) / max(abs(float(np.mean(x))), 1e-300) for x in (balance.y, parts)
    )
    return torque < SAME and growth < STEADY


def two_ways(view: View) -> bool:
    """Return whether the motor moves far enough in both directions."""
    count = view.angle_noise(view.motor_angle) if view.motor_angle else 0.0
    return _rarer(view) >= BOTH_WAYS and min(view.travel) > FEWEST_COUNTS * count


def _rarer(view: View) -> float:
    """Return the share of the motion in the rarer direction, of its samples or its way."""
    way = sum(view.travel)
    return min(*view.both_ways, min(view.travel) / way if way else 0.0)


def one_way(view: View) -> str:
    """Return a clause on motion in one direction."""
    share = percent(1.0 - _rarer(view))
    way = "positive" if view.both_ways[0] > view.both_ways[1] else "negative"
    return f"{share} of the motion is in the {way} direction"


def seen(
    view: View,
    balance: Balance,
    term: Floats,
    against: Sequence[str],
    unit: str,
    instead: str,
    share: float = TORQUE,
) -> Verdict:
    """Judge whether a torque with a given column is identifiable.

    Args:
        view: The records.
        balance: Balance of the body on which it acts.
        term: Its column, shape (N,).
        against: Names of the columns that it must be distinguished from.
        unit: Unit of its factor.
        instead: What to record if it is not identifiable.
        share: Upper limit on its smallest size, relative to the driving torque.
    """
    size = balance.least(term, against)
    most = float(np.quantile(np.abs(term), 0.95)) or float(np.abs(term).max(initial=0.0))
    torque = size * most
    own = balance.apart(term, against)
    if own < APART:
        why = f"inertia or other friction could explain all but {percent(own)} of it"
        return Unseen(why, instead)
    if np.isfinite(torque) and torque <= share * balance.level:
        return Seen(size, unit)
    driven = "its inertia takes" if balance.coasts else "the joint is driven by"
    driven = f"while {driven} {balance.level:.2g} {view.torque_unit}"
    return Unseen(f"{only_from(torque, view.torque_unit)}, {driven}", instead)


@from_balance
def inertia(view: View, balance: Balance) -> Verdict:
    """Judge inertia, which requires inertial torque above the noise and fast enough sampling."""
    if (fast := too_fast(view)) is not None:
        return fast
    if balance.coasts:
        return Unseen(COASTS, "Record motion under a torque that is measured or commanded.")
    if runs_up(balance):
        return Unseen(RUNS_UP, OTHER_TORQUES)
    nominal = sum(view.value(name) for name in view.inertias)
    unit = view.inertia_unit if view.joint else f"{view.torque_unit} s^2/{view.angle_unit}"
    quick = "Record quick motion: steps of the current, or a chirp."
    return seen_inertia(balance, nominal, unit, quick)


def seen_inertia(balance: Balance, nominal: float, unit: str, instead: str) -> Verdict:
    """Judge whether an inertia that is wrong by as much as it is would show."""
    size = balance.least(balance["a"], ("v", "s", "one"))
    if size <= INERTIA * max(nominal, abs(balance.inertia)):
        return Seen(size, unit)
    return Unseen(f"{only_from(size, unit)}, more than the joint has", instead)


def too_fast(view: View) -> Unseen | None:
    """Return the reason if a held joint resonates above the log's Nyquist frequency, else None."""
    swing, nyquist = resonance(view), 0.5 / view.dt
    if not view.structure.output_fixed or swing <= nyquist:
        return None
    why = (
        f"the held joint resonates at {swing:.3g} Hz, above the log's Nyquist frequency of "
        f"{nyquist:.3g} Hz, and inertia matters only near that frequency"
    )
    return Unseen(why, f"Record at {max(1e3, 5.0 * swing):.2g} Hz or more.")


@from_balance
def damping(view: View, balance: Balance) -> Verdict:
    """Judge damping, which differs from Coulomb friction over a range of speeds."""
    if (fast := too_fast(view)) is not None:
        return fast
    unit = f"{view.torque_unit} s/{view.angle_unit}"
    return _by_speed(view, balance, balance["v"], ("a", "s"), unit)


@from_balance
def coulomb(view: View, balance: Balance) -> Verdict:
    """Judge Coulomb friction, which requires a range of speeds or both directions."""
    if runs_up(balance):
        return Unseen(RUNS_UP, OTHER_TORQUES)
    return _by_speed(view, balance, balance["s"], ("a", "v"), view.torque_unit)


def _by_speed(
    view: View, balance: Balance, term: Floats, against: Sequence[str], unit: str
) -> Verdict:
    low, high = view.speeds
    speeds = f"the speeds lie between {low:.2g} and {high:.2g} {view.angle_unit}/s"
    if low > ONE_SPEED * high:
        return Unseen(f"{speeds}, so that dry and viscous friction look alike", SPREAD)
    found = seen(view, balance, term, against, unit, SPREAD)
    if isinstance(found, Seen):
        return found
    return Unseen(f"{speeds}, so that {found.why}", found.instead)


@from_balance
def coulomb_asym(view: View, balance: Balance) -> Verdict:
    """Judge direction-dependent friction, which requires motion in both directions."""
    if not two_ways(view):
        return Unseen(
            f"{one_way(view)}: effects that depend on the direction are not visible", TURN
        )
    term = np.abs(balance["s"])
    return seen(view, balance, term, ("a", "v", "s"), view.torque_unit, TURN)


@from_balance
def viscous_asym(view: View, balance: Balance) -> Verdict:
    """Judge direction-dependent damping, which requires both directions and a range of speeds."""
    if (fast := too_fast(view)) is not None:
        return fast
    if not two_ways(view):
        return Unseen(
            f"{one_way(view)}: effects that depend on the direction are not visible", TURN
        )
    term, unit = np.abs(balance["v"]), f"{view.torque_unit} s/{view.angle_unit}"
    return seen(view, balance, term, ("a", "v", "s", "one"), unit, SPREAD)


@from_balance
def torque_offset(view: View, balance: Balance) -> Verdict:
    """Judge a constant torque, which differs from Coulomb friction if both directions occur."""
    if not two_ways(view):
        why = f"{one_way(view)}: a constant torque cannot be told from Coulomb friction"
        return Unseen(why, TURN)
    return seen(view, balance, balance["one"], ("a", "v", "s"), view.torque_unit, TURN)


@from_balance
def stribeck(view: View, balance: Balance) -> Verdict:
    """Judge friction that falls with speed, which requires both slow and fast phases."""
    v = np.abs(balance["v"])
    fastest = float(np.quantile(v, 0.95))
    scales = np.geomspace(max(float(v.min()), 1e-3 * fastest), 0.5 * fastest, 12)
    terms = [balance["s"] * np.exp(-((v / scale) ** 2)) for scale in scales]
    best = min(terms, key=lambda term: balance.least(term, ("a", "v", "s", "one")))
    found = seen(view, balance, best, ("a", "v", "s", "one"), view.torque_unit, SPREAD)
    slow = float(np.mean(v < 0.1 * fastest))
    if isinstance(found, Seen) and slow >= SLOW:
        return found
    shown = "of the motion above the noise is slower than a tenth of the highest speed"
    why = f"{percent(slow)} {shown}"
    if isinstance(found, Unseen):
        why = f"{why}, so that {found.why}"
    return Unseen(why, "Record many slow reversals: ramps through zero speed in both directions.")


@from_balance
def presliding(view: View, balance: Balance) -> Verdict:
    """Judge elastic presliding, which requires reversals and a fine enough angle."""
    instead = "Record small oscillations below the breakaway torque, many of them."
    if view.reversals < FEWEST_REVERSALS:
        turns = "reverses or starts from rest"
        times = {0: f"never {turns}", 1: f"{turns} only once"}
        said = times.get(view.reversals, f"{turns} only {view.reversals} times")
        return Unseen(f"the motion {said}", instead)
    assert view.motor_angle is not None
    count = STEPS * view.angle_noise(view.motor_angle)
    if view.motor_angle in view.channels and view.motor_angle.startswith("q_"):
        count = max(count, STEPS * view.channels[view.motor_angle].resolution)
    swing = sum(view.travel) / view.reversals
    if count > SWING * swing:
        unit = view.angle_unit
        why = (
            f"a typical swing of {swing:.2g} {unit} is hardly more than {count:.2g} {unit} of noise"
        )
        return Unseen(why, "Record larger swings, or a finer angle.")
    return Seen(count, view.angle_unit)


@from_balance
def load_friction(view: View, balance: Balance) -> Verdict:
    """Judge load-dependent friction, which requires a load varying independently of direction."""
    instead = "Record the same motion under two different loads, with the joint torque tau."
    names = ("a", "v", "s", "one")
    if "tau" in balance and (view.wound or view.channels["tau"].moves):
        return seen(view, balance, balance["s"] * np.abs(balance["tau"]), names, "-", instead)
    if not view.structure.has_spring and "tau_l" in view:
        lost = balance["s"] * np.abs(balance["u"])
        return seen(view, balance, lost, (*names, "u"), "-", instead)
    if view.structure.output_fixed and view.structure.has_spring and "tau" not in view.channels:
        wound = balance["q"] - balance["q"].mean()  # the spring's torque, by its stiffness
        plain = [balance[name] for name in ("a", "v", "s", "one")]
        rate = abs(float(factors(balance.y, [*plain, wound])[-1]))
        return seen(view, balance, rate * balance["s"] * np.abs(wound), (*names, "q"), "-", instead)
    if view.structure.output_fixed or view.angle_unit == "m":
        return Unseen("the transmitted torque tau is not recorded", instead)
    weight = _weight(balance)
    if weight is None:
        return Unseen("neither tau, tau_l nor a weight on the joint shows a varying load", instead)
    return seen(view, balance, balance["s"] * np.abs(weight), names, "-", instead)


def _weight(balance: Balance) -> Floats | None:
    """Return the gravity torque, shape (N,); None if the record shows none."""
    plain = [balance[name] for name in ("a", "v", "s", "one")]
    waves = [np.sin(balance["q"]), np.cos(balance["q"])]
    weight = np.column_stack(waves) @ factors(balance.y, [*plain, *waves])[-2:]
    shown = float(np.std(weight))
    return weight if shown > max(LOADED * balance.level, 3.0 * balance.scatter) else None
