"""Bars and strips of a report: the gap's steps, stages, regimes, confidences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from matplotlib.axes import Axes

from cjt_gym.gap.diagnosis import GapSize, StageGap
from cjt_gym.gap.evidence import Regime, Step
from cjt_gym.gap.report.drawing import AFTER, BEFORE, INK, PAPER, SOFT, legend, log_x, svg
from cjt_gym.gap.report.words import (
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
WIDTH, AROUND = 5.0, 0.5
"""Width of bars, and height of what is around them [inch]."""


def waterfall(steps: Sequence[Step], gap: GapSize) -> str:
    """Return the replay error from the nominal joint to the explained one, above the floor."""

    def paint(axes: Axes) -> None:
        for k, step in enumerate(steps):
            _draw_step(axes, k, step, steps[k - 1].error if k else None)
        _write_row(axes, len(steps), "Noise floor", noise_floor(gap), SOFT)
        axes.axvline(gap.floor, color=SOFT, linestyle="--", linewidth=1.2)
        axes.set_ylim(len(steps) + 0.1, -0.6)
        axes.set_yticks([])
        axes.set_xlim(0.0, 1.02 * max([step.high for step in steps] + [gap.floor]))
        axes.xaxis.set_major_formatter(lambda x, _: percent(x))
        axes.set_xlabel("replay error, of the signal")
        axes.spines["left"].set_visible(False)

    height = AROUND + 0.45 * (len(steps) + 0.7)
    return f"<figure class=bars>{svg(paint, 'Replay error, step by step', WIDTH, height)}</figure>"


def _draw_step(axes: Axes, row: int, step: Step, last: float | None) -> None:
    axes.barh(row, step.error, 0.4, color=BEFORE if last is None else AFTER)
    if last is not None and last > step.error:
        removed: Any = {"facecolor": "none", "edgecolor": AFTER, "hatch": "////", "linewidth": 0.0}
        axes.barh(row, last - step.error, 0.4, step.error, **removed)
    middle, half = 0.5 * (step.low + step.high), 0.5 * (step.high - step.low)
    axes.errorbar(middle, row, xerr=half, color=INK, capsize=3.0)
    name = STEPS.get(step.name) or f"+ {effect_name(step.name, step.body, step.channel)}"
    _write_row(axes, row, name, percent(step.error))


def _write_row(axes: Axes, row: int, name: str, value: str, colour: str = INK) -> None:
    """Write above a bar what it is, and its value at the end of the axes."""
    look: Any = {"transform": axes.get_yaxis_transform(), "verticalalignment": "bottom"}
    behind = {"facecolor": PAPER, "edgecolor": "none", "pad": 0.6}
    axes.text(0.0, row - 0.26, name, color=colour, bbox=behind, **look)
    look["horizontalalignment"] = "right"
    axes.text(1.0, row - 0.26, value, color=colour, weight="bold", bbox=behind, **look)


def stage_bars(stages: Mapping[str, StageGap], explained: bool) -> str:
    """Return each stage's residual on a logarithmic scale, on which 1 is noise.

    Returns nothing where no stage was judged.

    Args:
        stages: The stages.
        explained: Whether the residuals after are shown, too.
    """
    shown = {name: s for name, s in stages.items() if s.before > 0.0 and s.after > 0.0}
    shown = {n: s for n, s in shown.items() if n != "sensing" or s.significant}
    if not shown:
        return ""

    def paint(axes: Axes) -> None:
        _scale_stages(axes, shown)
        for row, stage in enumerate(shown.values()):
            _draw_stage(axes, row, stage, explained)
        if explained:
            legend(axes)

    height = AROUND + 0.3 * (len(shown) + explained)
    return f"<figure class=bars>{svg(paint, 'Residual of each stage', WIDTH, height)}</figure>"


def _scale_stages(axes: Axes, stages: Mapping[str, StageGap]) -> None:
    """Give the axes their scales and names, and the line of a perfect model."""
    sizes = [1.0] + [x for s in stages.values() for x in (s.before, s.after)]
    low, high = min(0.7, 0.9 * min(sizes)), max(3.0, 1.3 * max(sizes))
    axes.set(xlim=(low, high), ylim=(len(stages) - 0.5, -0.5), xlabel="residual, 1 = noise")
    log_x(axes)
    marks = [f"{n}: {'gap' if s.significant else 'no gap'}" for n, s in stages.items()]
    axes.set_yticks(range(len(stages)), marks, color=INK)
    for label, stage in zip(axes.get_yticklabels(), stages.values(), strict=True):
        label.set_fontweight("bold" if stage.significant else "normal")
    axes.axvline(1.0, color=SOFT, linestyle="--", linewidth=1.2)


def _draw_stage(axes: Axes, row: int, stage: StageGap, explained: bool) -> None:
    shown = {"datasheet joint": (stage.before, BEFORE)}
    if explained:
        shown["with the named effects"] = stage.after, AFTER
        axes.plot([stage.before, stage.after], [row, row], color=SOFT, alpha=0.35, linewidth=3.0)
    for label, (size, colour) in shown.items():
        dot: Any = {"markersize": 8.0, "markeredgecolor": PAPER, "clip_on": False}
        axes.plot(size, row, "o", color=colour, label="" if row else label, **dot)
    value = " → ".join(number(size, 2) for size, _ in shown.values())
    axes.text(1.02, row, value, transform=axes.get_yaxis_transform(), va="center", weight="bold")


def regime_strips(before: Sequence[Regime], after: Sequence[Regime] | None) -> str:
    """Return for each variable how a stage's gap is spread over it, and what is left of it."""
    strips: dict[str, list[tuple[Regime, float | None]]] = {}
    remains: Sequence[Regime | None] = [None] * len(before) if after is None else after
    for regime, rest in zip(before, remains, strict=True):
        left = None if rest is None else rest.share
        strips.setdefault(regime.variable, []).append((regime, left))
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
