"""Candidates of the drive stage."""

from __future__ import annotations

from functools import partial

import numpy as np

from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.recorded.setting import Setting

OFTEN, NOISES = 0.95, 2.0
"""Share of the samples, and deviations of the measured current, below which a current that was
measured is no sign of a limit above it."""


def _reached(setting: Setting) -> float:
    """Return the current that the drive reached often [A], which no limit lies below."""
    if "i" not in setting.series or setting.command_unit != "A":
        return 0.0
    often = float(np.quantile(np.abs(setting.series["i"]), OFTEN))
    return often - NOISES * setting.std("i")


def drive_rows(setting: Setting) -> list[Candidate]:
    """Return the candidates of the drive."""
    touches = ("drive",) if "i" in setting.series else ("motor",)
    dt, unit = setting.series.dt, setting.command_unit
    peak = float(np.abs(setting.series["i_cmd"]).max()) or 1.0
    delay = Number("delay", "s", 0.0, 5.0 * dt, low=0.0, high=60.0 * dt)
    lag = Number("bandwidth", "Hz", 50.0, 1.5, log=True, low=0.5, high=0.45 / dt, shape=True)
    lowest = max(1e-3 * peak, min(_reached(setting), peak))
    limit = Number("i_max", unit, peak, 1.0, log=True, low=lowest, high=peak, shape=True)
    least, most = 1e-4 * peak, 0.5 * peak
    step = Number("resolution", unit, 0.05 * peak, 2.0, True, least, most, shape=True)

    row = partial(Candidate, stage="drive", touches=touches, family="drive")
    return [
        row(
            "command_delay",
            unknowns=(delay,),
            apply=lambda f, v: f.update(delay=f["delay"] + v["delay"]),
            starts=tuple((k * dt,) for k in (0.5, 1.5, 3.0, 6.0, 12.0)),
        ),
        row(
            "current_lag",
            unknowns=(lag,),
            apply=lambda f, v: f.update(lag=1.0 / (2.0 * np.pi * v["bandwidth"])),
            starts=((300.0,), (100.0,), (30.0,), (8.0,)),
        ),
        row(
            "current_saturation",
            unknowns=(limit,),
            apply=lambda f, v: f.update(i_max=min(f["i_max"], v["i_max"])),
            starts=tuple((x * peak,) for x in (0.97, 0.85, 0.6, 0.35, 0.18)),
        ),
        row(
            "command_quantization",
            unknowns=(step,),
            apply=lambda f, v: f.update(step=v["resolution"]),
            search="step",
        ),
    ]
