"""Figures of a report, as SVG text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cjt_gym.datasheet.drawing import INK, canvas
from cjt_gym.datasheet.notation import drawn
from cjt_gym.training.evaluation.conditions import BANDWIDTH_HIGH, BANDWIDTH_LOW
from cjt_gym.training.evaluation.metrics import frequency_response
from cjt_gym.training.evaluation.rollout import Traces

COLOURS = ("#9a9a9a", "#d07c2e", "#1f5fa8", "#3d8f5f", "#8d4fa8")
WIDTH = 7.2


def learning_figure(progress: Sequence[Mapping[str, float]], levels: Mapping[str, float]) -> str:
    """Return the learning curve, with the validation errors of those that do not learn [N m]."""
    with canvas(WIDTH, 2.8) as (figure, written):
        axis: Any = figure.subplots()
        steps = np.array([row["steps"] for row in progress]) / 1e3
        names = {"validation_rmse": "policy, validation", "rmse": "policy, while exploring"}
        for (key, label), shape in zip(names.items(), ("o-", "-"), strict=True):
            colour = COLOURS[2] if key == "validation_rmse" else "#9fbddf"
            values = [row[key] for row in progress]
            axis.plot(steps, values, shape, color=colour, markersize=3, label=label)
        for (name, level), colour in zip(levels.items(), COLOURS, strict=False):
            axis.axhline(
                level,
                color=colour,
                linestyle="--",
                label=f"{drawn(name.replace('_', ' '))}, validation",
            )
        axis.set_ylim(bottom=0.0)
        axis.set_xlim(left=0.0)
        axis.set_xlabel("training steps [thousands]")
        axis.set_ylabel("tracking error, rms [N m]")
        axis.legend(loc="upper right", ncols=2)
        return written()


def traces_figure(tasks: Mapping[str, Mapping[str, Traces]]) -> str:
    """Return the first episode under every agent: torque above, error below."""
    with canvas(WIDTH, 4.4) as (figure, written):
        axes = figure.subplots(2, len(tasks), sharex=True, squeeze=False, height_ratios=(1.5, 1.0))
        for column, (task, agents) in enumerate(tasks.items()):
            upper, lower = axes[:, column]
            for (name, run), colour in zip(agents.items(), COLOURS, strict=False):
                upper.plot(run.t, run.tau[0], color=colour, label=drawn(name.replace("_", " ")))
                lower.plot(run.t, run.error[0], color=colour, linewidth=0.8)
            upper.plot(run.t, run.reference[0], color=INK, linewidth=0.8, label="reference")
            upper.set_title(task, fontsize=9)
            lower.set_xlabel("time [s]")
        axes[0, 0].set_ylabel("joint torque [N m]")
        axes[1, 0].set_ylabel("error [N m]")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        return written()


def response_figure(sweeps: Mapping[str, Traces]) -> str:
    """Return gain and phase from reference to joint torque of every agent."""
    with canvas(WIDTH, 3.6) as (figure, written):
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.5, 1.0))
        for (name, run), colour in zip(sweeps.items(), COLOURS, strict=False):
            f, response = frequency_response(run, BANDWIDTH_LOW, BANDWIDTH_HIGH)
            label = drawn(name.replace("_", " "))
            upper.semilogx(f, 20.0 * np.log10(np.abs(response)), color=colour, label=label)
            phase = np.rad2deg(np.unwrap(np.angle(response)))
            lower.semilogx(f, phase, color=colour)
        upper.axhline(-3.0, color=INK, linewidth=0.6, linestyle=":")
        upper.set_ylabel("gain [dB]")
        upper.legend(loc="lower left")
        lower.set_ylabel("phase [deg]")
        lower.set_xlabel("frequency [Hz]")
        return written()
