"""Signals that a report plots for a joint judged by its predictions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.evidence import Evidence
from cjt_gym.gap.horizons.prediction.forward import CHANNELS, Forecast
from cjt_gym.gap.horizons.prediction.log import Log
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.prediction.windows import Group, Windows
from cjt_gym.gap.horizons.selection.judgement import Judgement
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

KEYS = ("measured", "before", "after")


def pictured(judged: Judgement, first: Evidence) -> Evidence:
    """Return evidence with the predictions of datasheet and answer on held-out data.

    The residuals and maps of the stages belong to another joint and are omitted, and so is what is
    left in each regime; where the datasheet errs they show as well.

    Args:
        judged: The judgement.
        first: Evidence of the stages, whose sources are kept.
    """
    groups = _drawn(judged.case.test)
    log = judged.case.test.logs[groups[0].log]
    parts = [_stretches(judged, log, group) for group in groups]
    signals = {
        channel: {key: np.concatenate([part[channel][key] for part in parts]) for key in KEYS}
        for channel in log.measured
    }
    return Evidence(
        regimes={stage: (before, ()) for stage, (before, _) in first.regimes.items()},
        replays=signals, replay_dt=log.dt, restarted=groups[0].length * log.dt,
        source=first.source,
    )  # fmt: skip


def _stretches(judged: Judgement, log: Log, group: Group) -> dict[str, dict[str, Floats]]:
    """Return measured and predicted signals of consecutive windows, by channel."""
    starts = _apart(group)
    rows = starts[:, None] + np.arange(group.length)
    joints = (judged.case.joint, judged.joint)
    before, after = (_predicted(joint, log, group, starts) for joint in joints)
    return {
        channel: {
            "measured": log.measured[channel][rows].reshape(-1),
            "before": before[..., CHANNELS[channel]].reshape(-1),
            "after": after[..., CHANNELS[channel]].reshape(-1),
        }
        for channel in log.measured
    }


def _drawn(windows: Windows) -> list[Group]:
    """Return the windows of one record to plot: whole pieces, or else the longest windows."""
    whole = [g for g in windows.groups if g.horizons == (WHOLE,)]
    if whole:
        return [g for g in whole if g.log == whole[0].log]
    return [max(windows.groups, key=lambda g: (g.length, len(g.starts)))]


def _apart(group: Group) -> NDArray[np.int64]:
    """Return the starts of non-overlapping windows."""
    kept: list[int] = []
    for start in np.sort(group.starts).tolist():
        if not kept or start >= kept[-1] + group.length:
            kept.append(start)
    return np.array(kept)


def _predicted(joint: Joint, log: Log, group: Group, starts: NDArray[np.int64]) -> Floats:
    """Return a joint's predictions in windows, shape (W, length, 3); 0 where not finite."""
    order = np.argsort(group.starts)
    leads = group.leads[order][np.searchsorted(group.starts[order], starts)]
    lengths = np.full(len(starts), group.length)
    return np.nan_to_num(Forecast(joint, log).windows(starts, lengths, leads))
