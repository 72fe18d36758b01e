"""Inverse dynamics: a regression of the motor's torque on the motion.

A search that starts from too heavy a joint may get stuck there: such a joint hardly responds to its
torque, so that no further effect changes much. Inverse dynamics err in the other direction and give
alternative starts. Where a controller imposes the motion, so that nothing predicts it from the
torque, they still show where the torque goes.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from cjt_gym.gap.horizons.prediction.log import LEAST_SMOOTH, STUCK, Log, felt_torque
from cjt_gym.gap.horizons.prediction.model import motor_inertia
from cjt_gym.gap.horizons.torque.averaged import averaged
from cjt_gym.gap.horizons.torque.bristles import FEWEST as FEWEST_WAYS
from cjt_gym.gap.horizons.torque.bristles import bent, paths, ways
from cjt_gym.gap.horizons.torque.cross_validated import (
    BLOCKS,
    CLEAR,
    SHORTEST,
    SPENT,
    Spent,
    deviations,
    gain,
    predicted,
    steady_gain,
)
from cjt_gym.gap.horizons.torque.dead_time import DELAY, dead_time, in_time
from cjt_gym.gap.horizons.torque.over_angle import over_angle
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.gap.recorded.tolerances import VAGUE, stated, tolerance_of
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

OVER = 0.1
"""Time over which torque and motion are smoothed [s]."""
SLICES = 200
"""Part of a log of a joint that runs out over which they are smoothed: it slows down so steadily
that noise of the speed may hide it within `OVER`."""
FEWEST = 50
"""Fewest samples of motion."""
WIDTH = 8
"""Number of regressor columns."""
OUTSIDE = 3.0
"""Number of tolerances, and of deviations, by which damping must exceed the datasheet's."""
PLACES = {
    "damping": (1,), "coulomb": (2,), "torque_offset": (3,), "gravity": (4, 5),
    "torque_constant": (6,), "load_friction": (7,),
}  # fmt: skip
"""Regressor columns of each effect."""
BY_LOAD = ("torque_constant", "load_friction")
"""Effects that need the measured torque of a load. Where the motor both drives and brakes, the
torque tells them apart."""
HELD_IN = {
    "coulomb_asym": ("coulomb", "torque_offset"),
    "viscous_asym": ("damping", "torque_offset"),
    "stribeck": ("coulomb",),
    "presliding": ("coulomb",),
    "load_friction": ("coulomb",),
    "load_coulomb": ("coulomb",),
}
"""What a regression shows of effects that it does not have."""
ONE_WAY = frozenset({"torque_offset", "coulomb_asym"})
"""Effects that motion in one direction does not tell from Coulomb friction."""
DRAGS = frozenset({"damping", "coulomb"})
"""Friction of which few or noisy speeds tell the sum rather than the parts."""
DRAG, HALF = "damping", 0.5
"""Effect that may be too small to be detected but whose torque others absorb if it is left out,
and the share of another effect that must remain once it is included."""
LIKELY = 2.0
"""Least reduction in standard deviations for another law of the drag to be likely."""
BENT = 0.3
"""Least share of the error that friction over a path must remove from a regression that has the
sign of the speed in its place."""
SWINGS = 0.5
"""For a body that swings by itself: share of the acceleration that its angle may leave open, and
ratio of its torque to that of its weight."""
EDGES, PUSHED = (0.2, 0.4, 0.6, 0.8), 0.5
"""Quantiles of the angle at which a push may begin, and the share of the error that it must remove
beside a weight: 0.67 of a hopper's leg on the ground, at most 0.07 of five joints with weights, and
0.19, or 0.32 of one that mostly rests, of joints with unknown friction or a walking robot's."""
SETS = (("coulomb",), ("coulomb", "torque_offset"), ("coulomb", "gravity"))
"""Effects of each start."""


@dataclass(frozen=True)
class Inverse:
    """Result of a regression.

    Attributes:
        inertia: Inertia of all bodies that move with the motor [kg m^2].
        damping: Their damping [N m s/rad].
        effects: Values of the terms, by the name of the effect, dry friction first.
    """

    inertia: float
    damping: float
    effects: dict[str, tuple[float, ...]]


def inverse(joint: Joint, logs: Sequence[Log]) -> list[Inverse]:
    """Return a regression for each set of effects; none if the records do not allow it."""
    found = []
    late = dead_time(joint, logs)
    columns, torque = _moving(joint, in_time(logs, late))
    for effects in SETS if len(torque) >= FEWEST else ():
        used = [0, 1, *(k for name in effects for k in PLACES[name])]
        values = np.linalg.lstsq(columns[:, used], torque, rcond=None)[0]
        value = dict(zip(used, values.tolist(), strict=True))
        own = {name: tuple(value[k] for k in PLACES[name]) for name in effects}
        own |= {} if late is None else {late.name: late.values}
        found.append(Inverse(max(value[0], 0.0), max(value[1], 0.0), own))
    return found


def spent(
    joint: Joint,
    logs: Sequence[Log],
    names: Sequence[str],
    wave: Spent | None = None,
    path: float = 0.0,
) -> list[Spent]:
    """Return the effects on which torque is clearly spent, cross-validated over stretches.

    A gain may be steady rather than alike in all stretches: that of a weight depends on the
    posture, and that of damping on how fast the motion is.

    Args:
        joint: The nominal joint.
        logs: The records.
        names: Candidate effects from `PLACES`.
        wave: Cogging that is known and taken out first.
        path: Path over which dry friction turns round.
    """
    columns, torque = _moving(joint, logs, wave, path)
    if len(torque) < BLOCKS * SHORTEST:
        return []
    asked, names = names, list(names)
    while names:
        full, fits = _predicted(columns, torque, names)
        weights = {}
        for name in names:
            less, _ = _predicted(columns, torque, _less(names, name))
            share, clear = gain(full, less)
            weights[name] = share, max(clear, steady_gain(full, less))
        weak = [n for n, (share, clear) in weights.items() if share < SPENT or clear < CLEAR]
        if not weak:
            break
        names.remove(min(weak, key=lambda n: weights[n][0]))
    alone = [_spent(joint, name, names, fits, weights[name][0]) for name in names]
    if not names or DRAG in names or DRAG not in asked:
        return alone
    error, fits = _predicted(columns, torque, [*names, DRAG])
    if error.sum() >= full.sum() or fits[:, -1].mean() < 0.0:
        return alone
    beside = (_spent(joint, one.name, [*names, DRAG], fits, one.share) for one in alone)
    return [new for old, new in zip(alone, beside, strict=True) if new.size > HALF * old.size]


def seen_in_torque(
    joint: Joint, logs: Sequence[Log], excluded: Collection[str] = ()
) -> dict[str, Spent]:
    """Return the effects on which torque is clearly spent, of those the record can identify.

    The regression has the others, too, and what the joint file lists: what they do must not pass
    for another effect. Of motion in one direction it has no offset: that is Coulomb friction there.
    Where the record does not tell damping from Coulomb friction, either stands for both.
    """
    late = dead_time(joint, logs)
    logs = in_time(logs, late)
    turns = joint.parameters.axis == "rotary"
    out = {"gravity"} if not turns or all(map(_runs_out, logs)) else set()
    out |= {"torque_offset"} if ONE_WAY.issubset(excluded) else set()
    names = [n for n in PLACES if n not in out]
    known = {n for name in joint.effects for n in (name, *HELD_IN.get(name, ()))}
    excluded = {*excluded, *known}
    wave = None if {"cogging"} & {*excluded, *joint.effects} else over_angle(joint, logs)
    alike = DRAGS if DRAGS.issubset(excluded) else frozenset()
    driven = any(log.command.any() or log.load.any() for log in logs)
    plain = alike or not driven or {"presliding"} & {*excluded, *joint.effects}
    path = 0.0 if plain else _path(joint, logs, wave)
    told = alike | {n for n in names if n not in excluded}
    told -= {DRAG} if logs[0].voltage else set()  # the tolerance of r is one of damping
    found = [one for one in spent(joint, logs, names, wave, path) if one.name in told]
    found = [_as_bristles(one, path) if path and one.name == "coulomb" else one for one in found]
    seen = {one.name: one for one in found if _new(joint, one)}
    beside = [one for one in (wave, late) if one is not None and one.name not in excluded]
    return seen | {one.name: one for one in beside}


def _path(joint: Joint, logs: Sequence[Log], wave: Spent | None) -> float:
    """Return the path over which dry friction turns round; 0 where that explains little more."""
    columns, torque = _moving(joint, logs, wave)
    if len(torque) < BLOCKS * SHORTEST:
        return 0.0
    plain = predicted(columns, torque)[0]
    travel = max(float(np.ptp(log.measured["q_m"])) for log in logs if "q_m" in log.measured)
    tried = {x: predicted(*_moving(joint, logs, wave, x))[0] for x in paths(travel)}
    best = min(tried, key=lambda x: tried[x].sum())
    if sum(ways(log.states[:, 0], best) for log in logs) < FEWEST_WAYS:
        return 0.0
    share, clear = gain(tried[best], plain)
    clearly = max(clear, steady_gain(tried[best], plain)) >= CLEAR
    return float(best) if share >= BENT and clearly else 0.0


def _as_bristles(dry: Spent, path: float) -> Spent:
    """Return dry friction over a path as presliding: its level, and the bristles' stiffness."""
    level, deviation = dry.values[0], dry.deviations[0]
    values, deviations = (level, level / path), (deviation, deviation / path)
    return Spent("presliding", values, deviations, dry.share)


def feels_weight(joint: Joint, logs: Sequence[Log]) -> bool:
    """Return whether the torque shows a weight beside friction and a constant torque."""
    columns, torque = _moving(joint, logs)
    if len(torque) < BLOCKS * SHORTEST:
        return False
    beside = _less([*PLACES], "gravity")
    full, less = (_predicted(columns, torque, n)[0] for n in ([*PLACES], beside))
    share, clear = gain(full, less)
    return share >= SPENT and max(clear, steady_gain(full, less)) >= CLEAR


def leans(joint: Joint, logs: Sequence[Log]) -> bool:
    """Return whether something pushes beyond some angle alone, as the ground pushes a leg.

    Its mean over the motion looks like a weight.
    """
    columns, torque = _moving(joint, logs)
    if len(torque) < BLOCKS * SHORTEST or not torque.any():
        return False
    plain = columns[:, : PLACES["gravity"][-1] + 1]
    angle = np.arctan2(*(columns[:, k] for k in reversed(PLACES["gravity"])))
    less, _ = predicted(plain, torque)
    for edge in np.quantile(angle, EDGES):
        beyond = np.stack([angle > edge, np.maximum(angle - edge, 0.0)], axis=1)
        share, clear = gain(predicted(np.hstack([plain, beyond]), torque)[0], less)
        if share > PUSHED and clear >= CLEAR:
            return True
    return False


def is_inertia_alone_off(joint: Joint, logs: Sequence[Log]) -> bool:
    """Return whether the torque shows another inertia beside the friction that is stated.

    With another torque constant instead, inertia and friction would differ by the same factor.
    """
    own, file = body_group(joint.structure_row, "m"), joint.file
    inertia, damping = (sum(joint.parameters.get(f"{x}_{b}", 0.0) for b in own) for x in "Id")
    level = joint.effects.get("coulomb", {}).get("d_cm", 0.0)
    known = stated(file, "coulomb", "d_cm")
    others = {"coulomb", DELAY, *joint.effects}
    found = [x for x in inverse(joint, logs) if {*x.effects} <= others]
    fullest = max((len(x.effects) for x in found), default=0)  # one without a listed weight errs
    found = [x for x in found if len(x.effects) == fullest]
    pairs = []
    if isinstance(level, float) and level > 0.0 and known is not None and known.tolerance:
        pairs += [(one.inertia, one.effects["coulomb"][0] / level) for one in found]
    if damping > 0.0 and any(math.isfinite(tolerance_of(file, f"d_{b}", math.inf)) for b in own):
        pairs += [(one.inertia, one.damping / damping) for one in found]
    spread = min(tolerance_of(file, f"I_{b}", VAGUE) for b in own)
    return bool(pairs) and all(
        min(x, ratio) > 0.0
        and abs(math.log(x / inertia)) > max(OUTSIDE * spread, 2.0 * abs(math.log(ratio)))
        for x, ratio in pairs
    )


def swinging(joint: Joint, logs: Sequence[Log]) -> tuple[float, float] | None:
    """Return the weight (cosine, sine) of a body that swings by itself; None if it does not.

    A small torque hardly drives such a body, so that noise of its acceleration hides inertia and
    weight from a regression of the torque. A regression of the acceleration shows both.
    """
    columns, torque = _moving(joint, logs)
    if len(torque) < BLOCKS * SHORTEST:
        return None
    acceleration, pull = columns[:, 0], columns[:, 3:6]
    own = pull @ np.linalg.lstsq(pull, acceleration, rcond=None)[0]
    if np.var(acceleration - own) > SWINGS * np.var(acceleration):
        return None
    others = np.column_stack([torque, columns[:, 1:6]])
    ratios = np.linalg.lstsq(others, acceleration, rcond=None)[0]
    if ratios[0] <= 0.0:
        return None
    weight = -ratios[-2:] / ratios[0]
    if np.mean(torque**2) > SWINGS**2 * np.mean((pull[:, -2:] @ weight) ** 2):
        return None
    return float(weight[0]), float(weight[1])


def drag_law(joint: Joint, logs: Sequence[Log]) -> str:
    """Return how the drag departs from growing in proportion to the speed; "" if it does not."""
    columns, torque = _moving(joint, logs, squared=True)
    if len(torque) < BLOCKS * SHORTEST:
        return ""
    plain, bent_too = (predicted(x, torque) for x in (columns[:, :-1], columns))
    share, clear = gain(bent_too[0], plain[0])
    if share < SPENT or max(clear, steady_gain(bent_too[0], plain[0])) < LIKELY:
        return ""
    return "faster" if float(bent_too[1][:, -1].mean()) > 0.0 else "more slowly"


def _new(joint: Joint, one: Spent) -> bool:
    """Return whether an effect differs from what the datasheet states, as a regression finds both.

    More damping does, and another torque constant.
    """
    if one.name == "torque_constant":
        stated, spread = joint.parameters.k_t, tolerance_of(joint.file, "k_t", VAGUE)
        least = OUTSIDE * max(min(spread, VAGUE) * stated, one.deviations[0])
        return one.values[0] > 0.0 and abs(one.values[0] - stated) > least
    if one.name != "damping":
        return True
    own = [f"d_{b}" for b in body_group(joint.structure_row, "m")]
    known = {s: joint.parameters.get(s, 0.0) for s in own if joint.parameters.get(s, 0.0) > 0.0}
    allowed = OUTSIDE * sum(
        d * min(tolerance_of(joint.file, s, VAGUE), VAGUE) for s, d in known.items()
    )
    return one.values[0] - sum(known.values()) > max(allowed, OUTSIDE * one.deviations[0])


def _less(names: Sequence[str], name: str) -> list[str]:
    return [n for n in names if n != name]


def _spent(joint: Joint, name: str, names: Sequence[str], fits: Floats, share: float) -> Spent:
    places = dict(zip([0, *(k for n in names for k in PLACES[n])], fits.T, strict=True))
    own = np.stack([places[k] for k in PLACES[name]], axis=1)
    if name in BY_LOAD:
        absent = np.zeros(len(fits))
        own = _by_load(joint, name, *(places.get(PLACES[n][0], absent) for n in BY_LOAD))
    return Spent(name, tuple(own.mean(axis=0).tolist()), tuple(deviations(own).tolist()), share)


def _by_load(joint: Joint, name: str, off: Floats, lost: Floats) -> Floats:
    """Return the torque constant, or the friction per transmitted torque, of fits, shape (K, 1).

    Driving, a motor's torque T passes on T / (1 + mu), and braking T / (1 - mu).

    Args:
        joint: The nominal joint.
        name: The effect.
        off: By how much the torque constant seems to be off, relative to its nominal, shape (K,).
        lost: Share of the nominal torque that friction seems to take, shape (K,).
    """
    ratio = 1.0 + off
    if name == "load_friction":
        return (lost / ratio)[:, None]
    return (joint.parameters.k_t * (ratio - lost**2 / ratio))[:, None]


def _predicted(columns: Floats, torque: Floats, names: Sequence[str]) -> tuple[Floats, Floats]:
    """Return the mean square error of each stretch and the fits without it, one per row."""
    return predicted(columns[:, [0, *(k for n in names for k in PLACES[n])]], torque)


def _moving(
    joint: Joint,
    logs: Sequence[Log],
    wave: Spent | None = None,
    path: float = 0.0,
    *,
    squared: bool = False,
) -> tuple[Floats, Floats]:
    """Return regressors and torque over all records; empty if a required channel is missing.

    A last regressor is the square of the speed, with its sign, where that is asked for.
    """
    sprung = joint.structure_row.has_spring
    usable = [x for x in logs if "q_m" in x.measured and not (sprung and "tau" not in x.measured)]
    if not usable or any(log.voltage and "r" not in joint.parameters for log in usable):
        return np.zeros((0, WIDTH + squared)), np.zeros(0)
    parts = [_columns(joint, log, sprung, wave, path) for log in usable]
    columns, fine, square, torque = (np.concatenate(x) for x in zip(*parts, strict=True))
    if not torque.any():  # a joint that coasts spends what its inertia gives
        torque, columns[:, 0] = -motor_inertia(joint) * columns[:, 0], 0.0
    if not path:
        finer = columns.copy()
        finer[:, 2] = fine
        columns = min((columns, finer), key=lambda x: _left_by(x, torque))
    return (np.column_stack([columns, square]) if squared else columns), torque


def _left_by(columns: Floats, torque: Floats) -> float:
    """Return the squared error of a regression."""
    values = np.linalg.lstsq(columns, torque, rcond=None)[0]
    return float(np.sum((columns @ values - torque) ** 2))


def _columns(
    joint: Joint, log: Log, sprung: bool, wave: Spent | None, path: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the regressors where the joint moves, and the motor's torque.

    Returns:
        The regressors, shape (M, 8). The sign of the speed once more, averaged as torques are,
        shape (M,): it is sharper where motion is fast, and noise where the angle is coarse. The
        square of the speed with its sign, and the torque, shape (M,).
    """
    p = joint.parameters
    over = max(OVER, len(log) * log.dt / SLICES) if _runs_out(log) else OVER
    count = min(max(LEAST_SMOOTH, round(over / log.dt)) | 1, (len(log) - 1) | 1)
    motor = torque = p.k_t * p.n * log.command
    if log.voltage:
        torque = (torque - (p.k_t * p.n) ** 2 * log.speed) / p.r
    torque = torque - (felt_torque(log.measured["tau"], joint.file) if sprung else -log.load)
    if wave is not None:
        f, cosine, sine = wave.values
        turned = f * log.measured["q_m"]
        torque = torque + cosine * np.cos(turned) + sine * np.sin(turned)
    angle = log.measured["q_m"]
    rise, bend = np.gradient(angle, log.dt), np.diff(angle, 2, prepend=angle[0], append=angle[-1])
    turn = np.sign(log.speed)
    known = float(np.ptp(log.load) > 0.0 and not log.voltage)
    square = turn * log.speed**2
    channels = angle, rise, bend / log.dt**2, turn, square, torque, motor, np.abs(motor)
    q, v, a, fine, square, torque, motor, size = averaged(channels, count)
    usual = STUCK * float(np.sqrt(np.mean(v[log.whole] ** 2)))
    whole = binary_erosion(log.whole, iterations=count // 2, border_value=0)
    use = whole & (np.abs(v) > usual)
    dry = bent(q, path) if path else np.sign(v)
    beside = -known * motor, known * np.sign(v) * size
    columns = np.stack([a, v, dry, -np.ones_like(v), np.cos(q), np.sin(q), *beside], axis=1)
    return columns[use], fine[use], square[use], torque[use]


def _runs_out(log: Log) -> bool:
    """Return whether nothing drives a joint that moves in one direction, as a wheel that coasts."""
    return not log.command.any() and not log.load.any() and not np.ptp(np.sign(log.speed))
