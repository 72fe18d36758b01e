"""Candidates derived from rows of the effect table alone: user-defined effects."""

from __future__ import annotations

from collections.abc import Sequence

from cjt_gym.gap.horizons.fitting.terms import LIKELY
from cjt_gym.gap.horizons.prediction.model import Draft, Free, Put, Scales, Term
from cjt_gym.joint import Joint
from cjt_gym.joint.configure import EffectValue, typical_value
from cjt_gym.joint.effects import Effect, EffectParameter, own_effects

STEP = 0.25
"""Step of a search, relative to its start."""
SHARE = 0.2
"""Fraction of a record's typical magnitudes from which a search starts."""


def own_terms(joint: Joint, scales: Scales) -> list[Term]:
    """Return user-defined effects that may act in a joint and are not listed in its file.

    The numbers in a row's `size` are free within their ranges; the others keep their usual values.
    A registered effect is a suspect, and so rated as likely as dry friction.
    """
    return [
        _term(row, joint, scales)
        for row in own_effects()
        if row.name not in joint.effects and row.acts_in(joint.structure_row, joint.drive)
    ]


def _term(row: Effect, joint: Joint, scales: Scales) -> Term:
    free = [p for p in row.parameters if p.symbol in row.size and not p.series]
    off = tuple(_off(p, joint) for p in free)
    reach = [_reach(p, joint, scales) for p in free]
    numbers = tuple(
        Free(p.symbol, p.unit, at, STEP * size, low=p.low, high=p.high)
        for p, at, size in zip(free, off, reach, strict=True)
    )
    signs = (1.0, -1.0) if any(p.low < at for p, at in zip(free, off, strict=True)) else (1.0,)
    starts = tuple(
        tuple(at + sign * size for at, size in zip(off, reach, strict=True)) for sign in signs
    )
    usual = {
        p.symbol: typical_value(p, joint.parameters) if p.default is None else p.default
        for p in row.parameters
        if p not in free
    }
    put = _writer(row.name, tuple(p.symbol for p in free), usual)
    return Term(row.name, numbers, put, starts=starts, nominal=off, factor=LIKELY)


def _off(parameter: EffectParameter, joint: Joint) -> float:
    if parameter.relative_to is not None:
        return joint.parameters.get(parameter.relative_to, 0.0)
    return parameter.neutral or 0.0


def _reach(parameter: EffectParameter, joint: Joint, scales: Scales) -> float:
    """Return the offset of a parameter from its neutral value at which a search starts."""
    large = {
        "N m": scales.torque,
        "N m s/rad": scales.torque / scales.speed,
        "N m/rad": scales.torque / scales.travel,
        "rad": scales.travel,
        "rad/s": scales.speed,
    }.get(parameter.unit)
    if large is not None:
        return SHARE * large
    typical = typical_value(parameter, joint.parameters)
    differs = typical - _off(parameter, joint) if isinstance(typical, float | int) else 0.0
    return abs(differs) or SHARE * (parameter.high - parameter.low)


def _writer(name: str, symbols: Sequence[str], usual: dict[str, EffectValue]) -> Put:
    def put(draft: Draft, values: Sequence[float]) -> None:
        draft.row(name).update(usual | dict(zip(symbols, values, strict=True)))

    return put
