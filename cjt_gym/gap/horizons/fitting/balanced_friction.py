"""Joints in which dry friction all but balances the torque.

Where a log has one torque and one speed, any dry friction predicts it if damping takes the rest. If
friction takes nearly all, a little more torque moves the joint far faster, which no log has shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.horizons.fitting.fit import MOTION
from cjt_gym.gap.horizons.prediction.forward import CHANNELS, Forecast
from cjt_gym.gap.horizons.prediction.log import Log
from cjt_gym.gap.horizons.prediction.model import Term
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.prediction.windows import Windows
from cjt_gym.joint import Joint

LEVEL, DRIVEN = 0.05, 0.75
"""Relative difference of the quartiles of the input in a direction up to which it has one level,
and least share of the samples in which there is an input. A level in each direction is no more than
one: friction that differs with the direction balances both."""
MORE, FAR = 0.1, 20.0
"""Relative increase of the input, and the relative change of the motion, as a multiple of that,
above which a balance is delicate: on two real logs of one voltage it was 172 and 2200, on 44 others
up to 6.4."""
MOST = 0.6
"""Largest share of the peak torque that dry friction takes then; on those two logs it takes 0.5 and
0.67."""
DRY = ("d_c", "d_s")
"""How the symbols of dry friction begin."""


def is_delicate(windows: Windows, joint: Joint) -> bool:
    """Return whether more than the one torque of the records would move a joint much farther."""
    if joint.structure_row.output_fixed or not _has_one_level(windows.logs):
        return False
    moved = known = 0.0
    for group in windows.groups:
        log = windows.logs[group.log]
        if group.horizons == (WHOLE,) or MOTION not in log.measured:
            continue
        lengths, column = np.full(len(group.starts), group.length), CHANNELS[MOTION]
        one, more = (
            Forecast(joint, some).windows(group.starts, lengths, np.zeros_like(lengths))
            for some in (log, _driven_more(log))
        )
        angle = log.measured[MOTION]
        travel = angle[group.starts + group.length - 1] - angle[group.starts]
        known += float(group.weights @ travel**2)
        moved += float(group.weights @ (more[:, -1, column] - one[:, -1, column]) ** 2)
    return bool(moved > (MORE * FAR) ** 2 * known)


def _has_one_level(logs: Sequence[Log]) -> bool:
    """Return whether the input of some logs has one magnitude in each direction, and hardly rests.

    Half of the samples of a direction may be beside it.
    """
    u = np.concatenate([log.command for log in logs])
    least = LEVEL * np.abs(u).max()
    sides = [x for x in (u[u > least], -u[u < -least]) if len(x)]
    ends = [np.quantile(x, (0.25, 0.75)) for x in sides]
    driven = sum(len(x) for x in sides) >= DRIVEN * len(u)
    return bool(driven and all(high - low <= LEVEL * high for low, high in ends))


def limited(terms: Sequence[Term], peak: float) -> list[Term]:
    """Return terms whose dry friction takes no more than a share of the peak torque.

    The scale of all torques stays that of the datasheet, and there is no offset: either would take
    the rest.
    """
    most = MOST * peak
    return [
        replace(
            term,
            numbers=tuple(
                replace(n, high=min(n.high, most)) if n.symbol[:3] in DRY else n
                for n in term.numbers
            ),
        )
        for term in terms
        if term.name not in ("torque_constant", "torque_offset")
    ]


def _driven_more(log: Log) -> Log:
    """Return a log with more input."""
    factor = 1.0 + MORE
    return replace(log, command=factor * log.command, acting=factor * log.acting)
