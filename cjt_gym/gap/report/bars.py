"""Bars and strips of a report, as plain HTML: the gap's steps, stages, regimes, confidences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

from cjt_gym.gap.diagnosis import GapSize, StageGap
from cjt_gym.gap.evidence import Regime, Step
from cjt_gym.gap.report.words import (
    MINUS,
    SPACE,
    effect_name,
    noise_floor,
    number,
    percent,
    quantity,
)

VARIABLES: Mapping[str, str] = {
    "dq_m": "motor velocity",
    "dq_l": "load velocity",
    "q_m": "motor position",
    "q_l": "load position",
    "tau": "transmitted torque",
    "i": "current",
    "i_cmd": "command",
    "frequency": "frequency",
    "cycles_per_rev": "cycles over the angle",
    "t": "time",
}
STEPS: Mapping[str, str] = {
    "nominal": "Datasheet joint",
    "tolerances": "+ values fitted within tolerance",
}


def waterfall(steps: Sequence[Step], gap: GapSize) -> str:
    """Return the replay error from the nominal joint to the explained one, above the floor."""
    top = 1.05 * max([step.high for step in steps] + [gap.floor])
    rows, last = [], None
    for step in steps:
        name = STEPS.get(step.name) or f"+ {effect_name(step.name, step.body, step.channel)}"
        style = "before" if step.name == "nominal" else "after"
        rows.append(_step(name, style, step, last, top))
        last = step.error
    floor = (
        f"<div class='row floor'><div class=name>Noise floor</div><div class=track></div>"
        f"<div class=value>{noise_floor(gap)}</div></div>"
    )
    at = f"--at:{gap.floor / top:.2%}"
    texts = "".join(
        f"<span style='left:{k / 4:.2%}'>{percent(k / 4 * top)}</span>" for k in (1, 2, 3)
    )
    axis = _axis("replay error, of the signal", texts)
    return f"<div class='bars waterfall' style='{at}'>{''.join(rows)}{floor}{axis}</div>"


def _axis(label: str, texts: str) -> str:
    """Return the axis below bars: what it is, and its ticks."""
    return (
        f"<div class='row axis'><div class=name>{escape(label)}</div>"
        f"<div class=track>{texts}</div></div>"
    )


def _step(name: str, style: str, step: Step, last: float | None, top: float) -> str:
    width, low = f"{step.error / top:.2%}", f"{step.low / top:.2%}"
    spread = f"{(step.high - step.low) / top:.2%}"
    ghost = ""
    if last is not None and last > step.error:
        ghost = f"<i class=ghost style='left:{width};width:{(last - step.error) / top:.2%}'></i>"
    change = "" if last is None else f" <small>{_change(last, step.error)}</small>"
    return (
        f"<div class=row><div class=name>{escape(name)}</div><div class=track>"
        f"<i class='fill {style}' style='width:{width}'></i>{ghost}"
        f"<i class=whisker style='left:{low};width:{spread}'></i></div>"
        f"<div class=value>{percent(step.error)}{change}</div></div>"
    )


def _change(last: float, now: float) -> str:
    change = 100.0 * (now - last)
    sign = "+" if change > 0.0 else MINUS
    return f"{sign}{number(abs(change), 2)} points" if abs(change) >= 0.005 else "±0 points"


def stage_bars(stages: Mapping[str, StageGap], explained: bool) -> str:
    """Return each stage's residual on a logarithmic scale, on which 1 is noise.

    Args:
        stages: The stages.
        explained: Whether the residuals after are shown, too.
    """
    shown = {name: s for name, s in stages.items() if s.before > 0.0 and s.after > 0.0}
    shown = {n: s for n, s in shown.items() if n != "sensing" or s.significant}
    sizes = [1.0] + [x for s in shown.values() for x in (s.before, s.after)]
    low, high = min(0.7, 0.9 * min(sizes)), max(3.0, 1.3 * max(sizes))

    def at(value: float) -> float:
        return math.log(max(value, low) / low) / math.log(high / low)

    rows = [
        _stage(name, stage, at(stage.before), at(stage.after) if explained else None)
        for name, stage in shown.items()
    ]
    ticks = [t for k in range(6) for t in (10.0**k, 3 * 10.0**k) if low <= t <= high]
    texts = "".join(f"<span style='left:{at(t):.2%}'>{t:g}</span>" for t in ticks)
    axis = _axis("residual, 1 = noise", texts)
    return f"<div class='bars stages' style='--at:{at(1.0):.2%}'>{''.join(rows)}{axis}</div>"


def _stage(name: str, stage: StageGap, before: float, after: float | None) -> str:
    mark = "<b>gap</b>" if stage.significant else "no gap"
    dots, value = f"<i class='dot before' style='left:{before:.2%}'></i>", number(stage.before, 2)
    if after is not None:
        low, width = min(before, after), abs(before - after)
        dots = (
            f"<i class=link style='left:{low:.2%};width:{width:.2%}'></i>{dots}"
            f"<i class='dot after' style='left:{after:.2%}'></i>"
        )
        value += f" → {number(stage.after, 2)}"
    return (
        f"<div class=row><div class=name>{escape(name)} <small>{mark}</small></div>"
        f"<div class=track>{dots}</div><div class=value>{value}</div></div>"
    )


def regime_strips(before: Sequence[Regime], after: Sequence[Regime] | None) -> str:
    """Return for each variable how a stage's gap is spread over it, and what is left of it."""
    strips: dict[str, list[tuple[Regime, float | None]]] = {}
    left: Sequence[float | None] = (
        [None] * len(before) if after is None else [r.share for r in after]
    )
    for regime, share in zip(before, left, strict=True):
        strips.setdefault(regime.variable, []).append((regime, share))
    known = list(VARIABLES)
    ordered = sorted(strips, key=lambda name: known.index(name) if name in known else len(known))
    return f"<div class=strips>{''.join(_strip(name, strips[name]) for name in ordered)}</div>"


def _strip(variable: str, bins: Sequence[tuple[Regime, float | None]]) -> str:
    most, left = max(bins, key=lambda pair: pair[0].share)
    top = max(max(regime.share, rest or 0.0) for regime, rest in bins) or 1.0
    columns = "".join(_column(regime, rest, top, regime is most) for regime, rest in bins)
    half = bins[len(bins) // 2][0]
    middle = half.low if len(bins) % 2 == 0 else 0.5 * (half.low + half.high)
    ends = (bins[0][0].low, middle, bins[-1][0].high)
    axis = "".join(f"<span>{number(v, 2)}</span>" for v in ends)
    name = VARIABLES.get(variable, variable)
    return (
        f"<div class=strip><h4>{escape(name)} <small>[{escape(most.unit)}]</small></h4>"
        f"<div class=up>share of the gap, up to {_whole(top)}</div>"
        f"<div class=columns>{columns}</div><div class=ends>{axis}</div>"
        f"<p>{_shares(most, left)}</p></div>"
    )


def _column(regime: Regime, left: float | None, top: float, most: bool) -> str:
    bars = f"<i class=before style='height:{regime.share / top:.2%}'></i>"
    if left is not None:
        bars += f"<i class=after style='height:{left / top:.2%}'></i>"
    return f"<span{' class=most' if most else ''} title='{_shares(regime, left)}'>{bars}</span>"


def _shares(regime: Regime, left: float | None) -> str:
    rest = "" if left is None else f", {_whole(left)} left"
    return escape(f"{_whole(regime.share)} in {_range(regime)}{rest}", quote=True)


def _whole(share: float) -> str:
    """Return a share in whole per cent."""
    if 0.0 < share < 0.005:
        return f"less than 1{SPACE}%"
    return f"{100.0 * share:.0f}{SPACE}%"


def _range(regime: Regime) -> str:
    return f"{number(regime.low, 2)} … {quantity(regime.high, regime.unit, 2)}".replace(" ", SPACE)


def confidence_bar(confidence: float) -> str:
    """Return a confidence as a small bar with its number."""
    return (
        f"<div class=confidence><i style='width:{confidence:.0%}'></i></div>"
        f"<span class=figure>{min(confidence, 0.999):.2f}</span>"
    )
