"""What no diagnosis confirms of a record that cannot identify it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain, groupby

import numpy as np

from cjt_gym.gap.check.faults import FACTOR, ONE_INSTANT, OTHERS, SCALES, SLOPES, UNITS
from cjt_gym.gap.diagnosis import LEVELLESS, Diagnosis, NamedEffect
from cjt_gym.gap.horizons.fitting.terms import WINDINGS
from cjt_gym.gap.horizons.prediction.model import MEASURES, SKEW
from cjt_gym.gap.horizons.torque.inverse import DRAGS, ONE_WAY
from cjt_gym.joint import EFFECTS

SYMMETRIC = {"coulomb_asym": "coulomb", "viscous_asym": "damping"}
"""Laws that differ between the directions, and what they are if the record shows no difference."""
UNSOUND = {
    ONE_INSTANT: "channels of one row belong to different instants",
    SLOPES: "a velocity contradicts its angle, or the clock is wrong",
    FACTOR: "a channel seems to have another unit or side",
    UNITS: "a channel seems to have another unit, sign or side",
    SCALES: "a torque seems to have another unit, scale or side",
    OTHERS: "something other than the motor moves the joint as well",
}
"""Faults of a log, by their remedies, beside which only effects of the sensors are confirmed."""
DISTORTED = frozenset({FACTOR, SCALES, UNITS})
"""Those beside which none of the sensors are either: noise and steps have the wrong unit, too."""
VAGUELY, OUT_OF_STEP = 0.1, 1.0
"""Width of a frequency's 95 % interval, relative to it, above which no wave was seen to repeat, and
in cycles over all that the joint turned, above which its ends are out of step. That of cogging on
five real records, of three to fifteen periods, was 0.01 to 0.05 of the frequency."""
STRAIGHT = 0.5
"""Angle up to which a weight pulls like a spring beside the joint [rad]: the sine of an angle is a
line there but for 3 % of the weight."""
HARDLY = 0.05
"""Relative difference of friction in the two directions up to which it is not confirmed as
asymmetric: of equal friction in both, errors of the model have made 2 %."""
FAR_OFF = 4.0
"""Ratio to its datasheet value, or the inverse, above which a value may as well have another unit:
turns, degrees or revolutions a minute make 6.3, 57 or 9.5, a forgotten gear its ratio or the square
of that. Of the values confirmed on 115 real cases none was off by more than 2.5."""
FALLING = 4.0
"""Ratio of the ends of the interval of the speed over which friction falls, above which that is
open: at once it is a breakaway torque, and over all speeds less damping. Of friction that falls on
simulated logs it was at most 1.6."""
CREEP = 0.01
"""Share of motion back, in motion that is one-way otherwise, from which friction that turns round
there with a weight or an offset in it distorts what else is fitted: damping of a vertical axis, of
whose samples 9 % crept back, was 15 N s/m for 6 at most."""
INERTIAS = frozenset({"I_m", "I_g", "I_l"})
BESIDE_ANOTHER = "the law of the friction beside it stays open"
"""Doubt of damping beside Stribeck friction without a level or beside friction that perhaps depends
on the direction."""


def allowed_by(first: Diagnosis, excluded: dict[str, str]) -> Diagnosis:
    """Return a diagnosis that confirms no effect that the record cannot identify.

    Dry friction is not confirmed either where motion in one direction hides an offset or where
    viscous friction cannot be told from it, nor friction as asymmetric whose two directions hardly
    differ, nor one of several that differ with it and fit alike, nor what something else may look
    like; see `MIMICKED`. Of effects that explain as much the surer come first. Beside the faults of
    `UNSOUND` only effects of the sensors are, beside those of `DISTORTED` none.
    """
    advice = () if first.examination is None else first.examination.advice
    why = dict.fromkeys(excluded, "check says that this record cannot tell it")
    if excluded.keys() >= ONE_WAY:
        why.setdefault("coulomb", "motion in one direction does not tell it from an offset")
    elif "damping" in excluded:
        why.setdefault("coulomb", "this record does not tell it from viscous friction")
    open_ = with_rivals(first.effects, excluded)
    open_ = [_perhaps_symmetric(e) for e in open_]
    view = _View.of(first, one_way=excluded.keys() >= ONE_WAY)
    skewed = any(e.name == "viscous_asym" and e.status == "tentative" for e in open_)
    turned = view.creeps and any(e.name == "coulomb" for e in open_)
    if skewed or turned or any(_falls_to_nothing(e, view) for e in open_):
        open_ = [e.doubted(BESIDE_ANOTHER) if e.name == "damping" else e for e in open_]
    for has, said, rivals in MIMICKED:
        open_ = [e.or_else(rivals).doubted(said) if has(e, view) else e for e in open_]
    effects = tuple(e.doubted(why[e.name]) if e.name in why else _alone(e) for e in open_)
    for fault, said in UNSOUND.items():
        if fault in advice:
            spared = () if fault in DISTORTED else MEASURES
            effects = tuple(e if e.name in spared else e.doubted(said) for e in effects)
    alike = (group for _, group in groupby(effects, key=lambda e: e.gap_removed))
    surer = (sorted(group, key=lambda e: e.status != "confirmed") for group in alike)
    return replace(first, effects=tuple(chain.from_iterable(surer)))


def with_rivals(effects: Iterable[NamedEffect], excluded: Collection[str]) -> list[NamedEffect]:
    """Return effects, friction with what this record does not tell from it.

    Motion in one direction may hide an offset; few or noisy speeds tell no damping from Coulomb
    friction.
    """
    hidden = {"torque_offset"} if ONE_WAY.issubset(excluded) else set()
    drags = DRAGS if DRAGS.issubset(excluded) else frozenset()
    rivals = {"coulomb": hidden | drags - {"coulomb"}, "damping": drags - {"damping"}}
    return [e.or_else(rivals.get(e.name, ())) for e in effects]


def _alone(effect: NamedEffect) -> NamedEffect:
    """Return an effect, tentative where another that differs with the direction fits alike."""
    others = [name for name in effect.confusable_with if {name, effect.name} <= SKEW]
    return effect.doubted(f"{' or '.join(others)} may take its place") if others else effect


@dataclass(frozen=True)
class _View:
    """What a record shows of motion.

    Attributes:
        travel: Largest range of an angle, [rad] or [m].
        turns: Whether that is in [rad].
        one_way: Whether it shows motion in one direction only.
        creeps: Whether that goes back a little.
        smallest: Smallest visible size of each effect.
        stated: Parameters of the joint file, by symbol.
    """

    travel: float
    turns: bool
    one_way: bool
    creeps: bool
    smallest: Mapping[str, tuple[float, str]]
    stated: Mapping[str, float]

    @classmethod
    def of(cls, first: Diagnosis, *, one_way: bool) -> _View:
        """Return what the examined records of a diagnosis show."""
        exam = first.examination
        stated = {symbol: q.number for symbol, q in first.joint.parameters.quantities.items()}
        if exam is None:
            return cls(0.0, True, one_way, False, {}, stated)
        angle = exam.channels.get("q_m") or exam.channels.get("q_l")
        load = exam.channels.get("q_l") or angle
        turns = angle is not None and angle.unit == "rad"
        travel = max((one.span for one in (angle, load) if one is not None), default=0.0)
        creeps = one_way and exam.back > CREEP
        return cls(travel, turns, one_way, creeps, exam.smallest, stated)


def _may_be_nothing(effect: NamedEffect, view: _View) -> bool:
    """Return whether the intervals of all sizes of an effect include that it is not there."""
    row, sizes = EFFECTS[effect.name], []
    for number in row.parameters:
        found = effect.parameters.get(number.symbol)
        if found is not None and number.symbol in row.size:
            none = view.stated.get(number.symbol, 0.0) if number.replaces else number.neutral or 0.0
            sizes.append(found.low <= none <= found.high)
    return bool(sizes) and all(sizes)


def _falls_to_nothing(effect: NamedEffect, _: _View) -> bool:
    """Return whether Stribeck friction may vanish at speed, which dry friction does not."""
    levels = [one for symbol, one in effect.parameters.items() if symbol.startswith("d_c")]
    return effect.name == "stribeck" and any(one.low <= 0.0 for one in levels)


def _falls_anywhere(effect: NamedEffect, _: _View) -> bool:
    """Return whether it is open over which speed Stribeck friction falls."""
    speed = effect.parameters.get("v_s")
    return effect.name == "stribeck" and speed is not None and speed.high > FALLING * speed.low


def _is_one_sided(effect: NamedEffect, _: _View) -> bool:
    """Return whether dry friction may be none in one direction, which no bearing has."""
    return effect.name == "coulomb_asym" and any(x.low <= 0.0 for x in effect.parameters.values())


def _is_vague(effect: NamedEffect, view: _View) -> bool:
    """Return whether the frequency of a torque over the angle is hardly determined."""
    f = effect.parameters.get("f")
    if f is None:
        return False
    width = f.high - f.low
    turned = view.travel / (2.0 * np.pi) if view.turns else view.travel
    return width > VAGUELY * abs(f.value) or width * turned > OUT_OF_STEP


def _is_of_friction(effect: NamedEffect, view: _View) -> bool:
    """Return whether friction that changes with the angle would look like a torque over it."""
    return effect.name == "cogging" and view.one_way


def _pulls_straight(effect: NamedEffect, view: _View) -> bool:
    """Return whether a weight pulls like a spring over so small an angle."""
    return effect.name == "gravity" and view.turns and 0.0 < view.travel < STRAIGHT


def _is_quick(effect: NamedEffect, _: _View) -> bool:
    """Return whether heat may fade as fast as any winding could."""
    time = effect.parameters.get("T_thw")
    return time is not None and time.low <= WINDINGS[0]


def _is_short(effect: NamedEffect, view: _View) -> bool:
    """Return whether a delay is one that damping and stiffness within their tolerances make."""
    delay, least = effect.parameters.get("delay"), view.smallest.get(effect.name)
    return delay is not None and least is not None and delay.value < least[0]


def _is_far_off(effect: NamedEffect, view: _View) -> bool:
    """Return whether a value of the datasheet is off by what another unit or side would make.

    Of an inertia all bodies count: where they move as one, that of one stands for all.
    """
    for number in EFFECTS[effect.name].parameters:
        found, stated = effect.parameters.get(number.symbol), view.stated.get(number.symbol, 0.0)
        if found is None or not number.replaces or stated <= 0.0:
            continue
        others = sum(view.stated.get(s, 0.0) for s in INERTIAS - {number.symbol})
        beside = others if number.symbol in INERTIAS else 0.0
        ratio = (found.value + beside) / (stated + beside)
        if not 1.0 / FAR_OFF < ratio < FAR_OFF:
            return True
    return False


MIMICKED: tuple[tuple[Callable[[NamedEffect, _View], bool], str, tuple[str, ...]], ...] = (
    (_may_be_nothing, "its interval includes its absence", ()),
    (_is_one_sided, "an offset beside equal friction looks alike", ("coulomb", "torque_offset")),
    (_is_vague, "its frequency stays open", ()),
    (_is_of_friction, "in one direction friction that changes with the angle looks alike", ()),
    (_pulls_straight, "over so small an angle a spring to the frame pulls alike", ("contact",)),
    (_falls_to_nothing, LEVELLESS, ()),
    (_falls_anywhere, "over which speed it falls stays open", ("coulomb",)),
    (_is_quick, "it may fade as fast as any winding could, as what is no heat does", ()),
    (_is_far_off, "so far off, a unit, a side or a gear ratio may be wrong instead", ()),
    (_is_short, "check says that this record shows longer delays only", ()),
)
"""What else may look like an effect: when, in words, and the effects of the table that do."""


def _perhaps_symmetric(effect: NamedEffect) -> NamedEffect:
    """Return an effect, tentative where its two directions may be the same."""
    if effect.name not in SYMMETRIC or len(effect.parameters) != 2:
        return effect
    one, two = effect.parameters.values()
    spread = 0.5 * np.hypot(one.high - one.low, two.high - two.low)
    hardly = HARDLY * max(abs(one.value), abs(two.value))
    if abs(one.value - two.value) > max(spread, hardly):
        return effect
    plain = SYMMETRIC[effect.name]
    doubted = effect.doubted(f"{plain} may take its place: the two directions hardly differ")
    return doubted.or_else([plain])
