"""Candidates of the torque sensor."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.candidates.candidate import Apply, Candidate
from cjt_gym.gap.candidates.number import Number, Starts
from cjt_gym.gap.recorded.setting import Setting


def sensing_rows(setting: Setting) -> list[Candidate]:
    """Return the candidates of the torque sensor."""
    touches = ("motor", "transmission", "load")
    dt = setting.series.dt
    gain = Number("gain", "-", 1.0, 0.3, log=True, low=0.05, high=20.0)
    bias = Number("bias", "N m", 0.0, max(float(np.std(setting.series["tau"])), 1e-9))
    late = Number("delay", "s", 0.0, 3.0 * dt, low=0.0, high=60.0 * dt)

    def row(name: str, unknown: Number, apply: Apply, starts: Starts) -> Candidate:
        return Candidate(
            name,
            "sensing",
            (unknown,),
            apply,
            touches,
            channel="tau",
            starts=starts,
            family="sensing",
        )

    return [
        row("torque_gain", gain, lambda f, v: f.update(gain=f["gain"] * v["gain"]), ((1.0,),)),
        row("torque_bias", bias, lambda f, v: f.update(tau_0=f["tau_0"] + v["bias"]), ((0.0,),)),
        row(
            "torque_delay",
            late,
            lambda f, v: f.update(late=f["late"] + v["delay"]),
            tuple((k * dt,) for k in (0.3, 1.0, 3.0, 8.0)),
        ),
    ]
