"""Whether the remainder is explained, which effects may be named, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from cjt_gym.gap.diagnosis import GapSize
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.stages.fit import Fit
from cjt_gym.gap.stages.heldout import HeldOut, Trial
from cjt_gym.gap.stages.merit import STRAIN
from cjt_gym.gap.stages.prune import Need

LEFT = 1.3
"""Normalised residual above which a stage is not explained."""
LEFT_SHARE = 0.005
"""Smallest share of its gap that must also be left."""
FIRM = 1.5
"""Log reduction of a residual above which an effect is confirmed despite a remainder."""
WEAK = 0.5
"""Log reduction below which an effect is not even named if there is a remainder."""
HELD_LEFT = 1.6
"""The same as LEFT for a held-out record, to which nothing was fitted."""
HELD_SHARE = 0.02
ONLY_HELD = "something that only the held-out record shows"
COARSE = 1.5
"""Factor on both if a channel is coarse, as rounding errors are not white noise."""
DOUBTFUL = 0.6
"""Worth of an effect on held-out data below which it is at most tentative."""
CLOSE = 0.2
"""Largest distance of its worth from 1 if there is a remainder."""
UNSEEN = 0.15
"""Error of a replay, relative to its signal, above which something is wrong with a spring and a
load that are not judged; tolerances of a few per cent cause about half of it."""


@dataclass(frozen=True)
class Leftover:
    """A stage that is not explained."""

    stage: str
    share: float  # share of its squared excess residual that is left
    text: str = ""  # what it looks like, if known


def leftovers(
    base: Fit, fit: Fit, needs: Sequence[Need], held: Sequence[HeldOut], coarse: bool
) -> tuple[Leftover, ...]:
    """Return the stages in which a material part of the gap is left, worst first.

    The remainder includes what a cause outside the effect table removes and what appears on a
    held-out record.

    Args:
        base: The fit without effects.
        fit: The fit with the needed effects.
        needs: What each of them is needed for.
        held: Its performance on held-out records.
        coarse: Whether a channel is coarser than specified.
    """
    found = []
    for effect, need in zip(fit.model.effects, needs, strict=True):
        if effect.outside:
            share = _share(base.mean_square, need.stage, need.without.mean_square[need.stage])
            found.append(Leftover(need.stage, share, effect.outside))
    levels: list[tuple[Mapping[str, float], Mapping[str, float], float, float, str]]
    levels = [(base.mean_square, fit.mean_square, LEFT, LEFT_SHARE, "")]
    levels += [(h.before, h.after, HELD_LEFT, HELD_SHARE, ONLY_HELD) for h in held]
    allowance = COARSE if coarse else 1.0
    for before, after, limit, least, text in levels:
        blamed = {item.stage for item in found}
        for name, ms in after.items():
            share = _share(before, name, ms)
            if name not in blamed and ms > (allowance * limit) ** 2 and share > least:
                found.append(Leftover(name, share, text))
    return tuple(sorted(found, key=lambda left: -left.share))


def _share(before: Mapping[str, float], stage: str, ms: float) -> float:
    excess = max(before[stage] - 1.0, ms - 1.0, 1e-12)
    return max(ms - 1.0, 0.0) / excess


def out_of_sight(
    setting: Setting, judged_stages: Sequence[str], gap: GapSize
) -> tuple[Leftover, ...]:
    """Return spring and load as unexplained if they are not judged and the replay is far off.

    An error below the sensor's noise is not.
    """
    free = setting.has_spring and not setting.structure.output_fixed
    seen = {"transmission", "load"} <= set(judged_stages)
    if not free or seen or gap.after < max(UNSEEN, gap.floor):
        return ()
    share = min(gap.after / max(gap.before, gap.after), 1.0)
    return (Leftover("transmission", share, "the spring or the load, which nothing tells apart"),)


def untouched(left: Sequence[Leftover]) -> tuple[Leftover, ...]:
    """Return the remainder if nothing is named: the whole gap of each of these stages."""
    return tuple(replace(item, share=1.0) for item in left)


def status(
    need: Need, touches: Sequence[str], left: Sequence[Leftover], trial: Trial | None
) -> str | None:
    """Return "confirmed" or "tentative" for an effect, None where it should not be named.

    An effect in explained stages is confirmed. If there is a remainder, it could be the shadow of
    a missing cause, which also acts on held-out data: one that removes little is not named, unless
    it relieves the datasheet. The others must prove their worth on held-out data or, if none
    excite them, must have removed a large part of the residual.
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
    """Return the verdict for a number of named effects and the unexplained stages."""
    if left:
        return "partly_explained" if named else "unexplained"
    return "explained" if named else "no_gap"
