"""The figures of a sheet as SVG: one joint in full, several laid over each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from cjt_gym.datasheet import plots
from cjt_gym.datasheet.drawing import HALF, canvas
from cjt_gym.datasheet.notation import drawn
from cjt_gym.joint import JointParameters

Joints = Sequence[JointParameters]


def alone(draw: Callable[..., None], *arguments: Any) -> str:
    """Return a figure with one plot: what a function of `plots` draws."""
    with canvas() as (figure, written):
        draw(figure.subplots(), *arguments)
        return written()


def efficiency_map(joints: Joints) -> str:
    """Return the efficiency over the whole plane, one map per joint."""
    columns = min(len(joints), 3)
    rows = -(-len(joints) // columns)
    width = HALF if len(joints) == 1 else 2.0 * HALF
    with canvas(width, 2.55 if len(joints) == 1 else 2.0 * rows + 0.3) as (figure, written):
        grid = figure.subplots(rows, columns, squeeze=False)
        top, shown = plots.highest_shade(joints), None
        for axes, p in zip(grid.ravel(), joints, strict=False):
            shown = plots.efficiency_map(axes, p, top)
            axes.set_title(drawn(p.name.replace("_", " ")) if len(joints) > 1 else "")
        for axes in grid[:, 1:].ravel():
            axes.set_ylabel("")
        for axes in grid.ravel()[len(joints) :]:
            axes.set_visible(False)
        assert shown is not None
        figure.colorbar(shown, ax=grid, label="efficiency [%]", aspect=25, pad=0.02)
        return written()


def heat(joints: Joints) -> str:
    """Return how long torques can be held, and where temperatures end."""
    with canvas() as (figure, written):
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1.0))
        plots.time_held(upper, joints)
        upper.set_xlabel("")
        plots.final_temperature(lower, joints)
        return written()


def with_scale(draw: Callable[..., Any], label: str, joints: Joints) -> str:
    """Return a figure of one joint with a plot whose colours have a scale of that name."""
    with canvas() as (figure, written):
        axes = figure.subplots()
        shown = draw(axes, joints[0])
        figure.colorbar(shown, ax=axes, label=label, aspect=25, pad=0.02)
        return written()
