"""Is what remains explained? What may be named, how firmly, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from cjt_gym.gap.fit import Fit
from cjt_gym.gap.heldout import HeldOut, Trial
from cjt_gym.gap.prune import Need
from cjt_gym.gap.select import STRAIN

LEFT = 1.3
"""Normalised residual above which a stage is not explained."""
LEFT_SHARE = 0.005
"""And least share of its gap that must be left."""
FIRM = 1.5
"""Part of a residual, in log, from which an effect is confirmed although something is left."""
WEAK = 0.5
"""Part of it below which an effect is not even named where something is left."""
HELD_LEFT = 1.6
"""The same as LEFT on a held-out record, to which nothing was fitted."""
HELD_SHARE = 0.02
COARSE = 1.5
"""Factor on both where a channel is coarse, whose rounding errors are no white noise."""
DOUBTFUL = 0.6
"""Worth of an effect on held-out data below which it is no more than tentative."""
CLOSE = 0.2
"""How far from 1 its worth may be where something is left."""


@dataclass(frozen=True)
class Leftover:
    """A stage that is not explained.

    Attributes:
        stage: Its name.
        share: Share of its squared excess residual that is left.
        text: What it looks like, where that is known.
    """

    stage: str
    share: float
    text: str = ""


def leftovers(
    base: Fit, fit: Fit, needs: Sequence[Need], held: Sequence[HeldOut], coarse: bool
) -> tuple[Leftover, ...]:
    """Return the stages in which a material part of the gap is left, the worst first.

    What a cause outside the effect table takes away is left, too, and so is what comes up on a
    held-out record.

    Args:
        base: The fit without effects.
        fit: The fit with those that are needed.
        needs: What each of them is needed for.
        held: What it is worth on held-out records.
        coarse: Whether a channel is coarser than specified.
    """
    found = []
    for effect, need in zip(fit.model.effects, needs, strict=True):
        if effect.outside:
            share = _share(base.mean_square, need.stage, need.without.mean_square[need.stage])
            found.append(Leftover(need.stage, share, effect.outside))
    levels: list[tuple[Mapping[str, float], Mapping[str, float], float, float]]
    levels = [(base.mean_square, fit.mean_square, LEFT, LEFT_SHARE)]
    levels += [(h.before, h.after, HELD_LEFT, HELD_SHARE) for h in held]
    allowance = COARSE if coarse else 1.0
    for before, after, limit, least in levels:
        blamed = {item.stage for item in found}
        for name, ms in after.items():
            share = _share(before, name, ms)
            if name not in blamed and ms > (allowance * limit) ** 2 and share > least:
                found.append(Leftover(name, share))
    return tuple(sorted(found, key=lambda left: -left.share))


def _share(before: Mapping[str, float], stage: str, ms: float) -> float:
    excess = max(before[stage] - 1.0, ms - 1.0, 1e-12)
    return max(ms - 1.0, 0.0) / excess


def untouched(left: Sequence[Leftover]) -> tuple[Leftover, ...]:
    """Return what is left where nothing is named: of each of these stages, the whole gap."""
    return tuple(replace(item, share=1.0) for item in left)


def status(
    need: Need, touches: Sequence[str], left: Sequence[Leftover], trial: Trial | None
) -> str | None:
    """Return "confirmed" or "tentative" for an effect, None where it should not be named.

    An effect in stages that are explained is confirmed. Where something is left, it could be the
    shadow of what is missing, which held-out data have, too: one that takes little away is not
    named, unless the datasheet speaks for it. The others must be worth on held-out data what they
    say, or, where there are none that excite them, they must have taken a large part of the
    residual.
    """
    open_stages = {item.stage for item in left}
    shadow = bool(open_stages & set(touches))
    doubtful = trial is not None and trial.worth < DOUBTFUL
    spares = need.strain >= STRAIN and trial is not None and not doubtful
    if shadow and need.log_share < WEAK and not spares:
        return None
    if doubtful:
        return "tentative"
    if not shadow:
        return "confirmed"
    if trial is not None:
        return "confirmed" if abs(trial.worth - 1.0) < CLOSE else "tentative"
    if need.stage not in open_stages:
        return "confirmed"
    if need.log_share >= FIRM:
        return "confirmed"
    return "tentative"


def verdict(named: int, left: Sequence[Leftover]) -> str:
    """Return the verdict for a number of named effects and the stages that are left over."""
    if left:
        return "partly_explained" if named else "unexplained"
    return "explained" if named else "no_gap"
