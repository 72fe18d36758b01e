"""What no diagnosis confirms of a record that cannot identify it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np

from cjt_gym.gap.check.faults import FACTOR, ONE_INSTANT, OTHERS, SCALES, SLOPES
from cjt_gym.gap.diagnosis import LEVELLESS, Diagnosis, NamedEffect
from cjt_gym.gap.horizons.inverse import DRAGS, ONE_WAY
from cjt_gym.gap.horizons.model import MEASURES
from cjt_gym.gap.horizons.rows import WINDINGS

SYMMETRIC = {"coulomb_asym": "coulomb", "viscous_asym": "damping"}
"""Laws that differ between the directions, and what they are if the record shows no difference."""
UNSOUND = {
    ONE_INSTANT: "channels of one row belong to different instants",
    SLOPES: "a velocity contradicts its angle, or the clock is wrong",
    FACTOR: "a channel seems to have another unit or side",
    SCALES: "a torque seems to have another unit, scale or side",
    OTHERS: "something other than the motor moves the joint as well",
}
"""Faults of a log, by their remedies, beside which only effects of the sensors are confirmed."""
DISTORTED = frozenset({FACTOR, SCALES})
"""Those beside which none of the sensors are either: noise and steps have the wrong unit, too."""
VAGUELY, OUT_OF_STEP = 0.1, 1.0
"""Width of a frequency's 95 % interval, relative to it, above which no wave was seen to repeat, and
in cycles over all that the joint turned, above which its ends are out of step. That of cogging on
five real records, of three to fifteen periods, was 0.01 to 0.05 of the frequency."""
HARDLY = 0.05
"""Relative difference of friction in the two directions up to which it is not confirmed as
asymmetric: of equal friction in both, errors of the model have made 2 %."""
QUICK = "it may fade as fast as any winding could, as what is no heat does"
BESIDE_ANOTHER = "the law of the friction beside it stays open"
"""Doubt of damping beside Stribeck friction without a level or beside friction that perhaps depends
on the direction."""


def allowed_by(first: Diagnosis, excluded: dict[str, str]) -> Diagnosis:
    """Return a diagnosis that confirms no effect that the record cannot identify.

    Dry friction is not confirmed either where motion in one direction hides an offset or where
    viscous friction cannot be told from it, nor Stribeck friction of which none may be left at
    speed, nor a torque over the angle whose frequency stays open, nor friction as asymmetric whose
    two directions hardly differ, nor heat that fades at once, nor a delay shorter than the record
    could show. Beside the faults of `UNSOUND` only effects of the sensors are, beside those of
    `DISTORTED` none.
    """
    advice = () if first.examination is None else first.examination.advice
    why = dict.fromkeys(excluded, "check says that this record cannot tell it")
    if excluded.keys() >= ONE_WAY:
        why.setdefault("coulomb", "motion in one direction does not tell it from an offset")
    elif "damping" in excluded:
        why.setdefault("coulomb", "this record does not tell it from viscous friction")
    open_ = with_rivals(first.effects, excluded)
    turned = _turned(first)
    open_ = [e.doubted("its frequency stays open") if _is_vague(e, turned) else e for e in open_]
    open_ = [_perhaps_symmetric(e) for e in open_]
    skewed = any(e.name == "viscous_asym" and e.status == "tentative" for e in open_)
    if skewed or any(_falls_to_nothing(e) for e in open_):
        open_ = [e.doubted(BESIDE_ANOTHER) if e.name == "damping" else e for e in open_]
    open_ = [e.doubted(LEVELLESS) if _falls_to_nothing(e) else e for e in open_]
    open_ = [e.doubted(QUICK) if _is_quick(e) else e for e in open_]
    least = {} if first.examination is None else first.examination.smallest
    open_ = [e.doubted(_too_short(least[e.name][0])) if _is_short(e, least) else e for e in open_]
    effects = tuple(e.doubted(why[e.name]) if e.name in why else e for e in open_)
    for fault, said in UNSOUND.items():
        if fault in advice:
            spared = () if fault in DISTORTED else MEASURES
            effects = tuple(e if e.name in spared else e.doubted(said) for e in effects)
    return replace(first, effects=effects)


def with_rivals(effects: Iterable[NamedEffect], excluded: Collection[str]) -> list[NamedEffect]:
    """Return effects, friction with what this record does not tell from it.

    Motion in one direction may hide an offset; few or noisy speeds tell no damping from Coulomb
    friction.
    """
    hidden = {"torque_offset"} if ONE_WAY.issubset(excluded) else set()
    drags = DRAGS if DRAGS.issubset(excluded) else frozenset()
    rivals = {"coulomb": hidden | drags - {"coulomb"}, "damping": drags - {"damping"}}
    return [e.or_else(rivals.get(e.name, ())) for e in effects]


def _falls_to_nothing(effect: NamedEffect) -> bool:
    """Return whether Stribeck friction may vanish at speed, which dry friction does not."""
    levels = [one for symbol, one in effect.parameters.items() if symbol.startswith("d_c")]
    return effect.name == "stribeck" and any(one.low <= 0.0 for one in levels)


def _is_quick(effect: NamedEffect) -> bool:
    """Return whether heat may fade as fast as any winding could."""
    time = effect.parameters.get("T_thw")
    return time is not None and time.low <= WINDINGS[0]


def _is_short(effect: NamedEffect, least: Mapping[str, tuple[float, str]]) -> bool:
    """Return whether a delay is one that damping and stiffness within their tolerances make."""
    delay = effect.parameters.get("delay")
    return delay is not None and effect.name in least and delay.value < least[effect.name][0]


def _too_short(least: float) -> str:
    return f"check says that this record shows delays from {1e3 * least:.2g} ms on"


def _turned(first: Diagnosis) -> float:
    """Return the revolutions within the records, or metres; 0 if no angle shows them."""
    channels = {} if first.examination is None else first.examination.channels
    angle = channels.get("q_m") or channels.get("q_l")
    if angle is None:
        return 0.0
    return angle.span / (2.0 * np.pi) if angle.unit == "rad" else angle.span


def _is_vague(effect: NamedEffect, turned: float) -> bool:
    """Return whether the frequency of a torque over the angle is hardly determined."""
    f = effect.parameters.get("f")
    if f is None:
        return False
    width = f.high - f.low
    return width > VAGUELY * abs(f.value) or width * turned > OUT_OF_STEP


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
