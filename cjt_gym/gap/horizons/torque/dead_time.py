"""How long after its command a motor's torque acts, as a regression on the motion shows.

Where a controller imposes the motion, predictions hardly depend on the instant at which a torque
acts. The torque itself does: it turns round with the friction and rises with the acceleration, and
a regression on the motion leaves least of it if its command stands where it acted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion

from cjt_gym.gap.horizons.prediction.log import LEAST_SMOOTH, STUCK, Log
from cjt_gym.gap.horizons.torque.averaged import averaged
from cjt_gym.gap.horizons.torque.bristles import bent
from cjt_gym.gap.horizons.torque.cross_validated import (
    BLOCKS,
    CLEAR,
    SHORTEST,
    Spent,
    gain,
    predicted,
    steady_gain,
)
from cjt_gym.joint import Joint
from cjt_gym.joint.between_rows import until_next
from cjt_gym.joint.kernel.arrays import Floats

DELAY = "command_delay"
KEPT = 4
"""Results that are kept: several parts of a diagnosis ask for the same one."""
OVER = 0.03
"""Time over which torque and motion are averaged [s]."""
LONGEST, EARLIEST = 0.1, 4
"""Longest delay that is tried [s], and rows by which a motion ahead of its torque is tried."""
HELD, LEAST, WITHIN = 0.5, 0.85, 0.25
"""Rows by which a torque that is held from row to row is late on the mean, rows from which on more
is a delay rather than the instant at which rows are written, and the standard deviation of one. On
four motors by voltage whose dead times others found to be 3, 1, 1 and 0 rows it came out as 2.96,
0.95, 0.96 and -0.03."""
SAME, COMPARABLE = 0.3, 1.2
"""Relative difference up to which delays agree that are found with friction that turns round at
once and over several paths, and the squared error up to which they are compared, relative to the
least."""
AT_ONCE = 2
"""Laws of friction that turns round at once: sharply and not."""
PATHS = np.geomspace(1e-4, 0.3, 30)
SHORT = 1e-3
"""Paths over which friction may turn round, as shares of the travel, and those that only a
regression without a delay may have: such friction is that of the sign a little later."""
REMOVED = 0.2
"""Least share of the squared error that a delay must remove. On a joint where it was 0.16, the
delay was off by four rows."""
LIGHTER = 0.1
"""Least inertia at a delay, relative to the one without, which is larger where friction is ahead of
the motion: where a delay stood for friction over a path, it was a seventieth."""
LEFT = 0.5
"""Largest share of the torque's variance that the regression may leave."""


class _Scan(NamedTuple):
    """A regression at many delays: its squared errors, shape (K,), and its columns."""

    errors: Floats
    columns: Floats


def dead_time(joint: Joint, logs: Sequence[Log]) -> Spent | None:
    """Return the dead time of the command of a joint without a spring, if its torque shows one."""
    if not _tells(joint, logs):
        return None
    p = joint.parameters
    unit = p.k_t * p.n / (p.r if logs[0].voltage else 1.0)
    return _dead_time(tuple(logs), unit, unit * p.k_t * p.n if logs[0].voltage else 0.0)


@lru_cache(maxsize=KEPT)
def _dead_time(logs: tuple[Log, ...], unit: float, back_emf: float) -> Spent | None:
    """Return the dead time of logs whose command is worth a torque [N m/A or N m/V]."""
    step = max(log.dt for log in logs)
    last = max(round(LONGEST / step), EARLIEST)
    times = np.asarray(step * np.arange(-EARLIEST, last + 1))
    travel = max(float(np.ptp(log.measured["q_m"])) for log in logs)
    parts = [_moving(log, unit, back_emf, times, travel * PATHS) for log in logs]
    motion, dry, torques = (np.concatenate(x) for x in zip(*parts, strict=True))
    if len(motion) < BLOCKS * SHORTEST:
        return None
    scans = [_scan(np.column_stack([motion, x]), torques) for x in dry.T]
    long = [
        *scans[:AT_ONCE],
        *(x for x, way in zip(scans[AT_ONCE:], PATHS, strict=True) if way >= SHORT),
    ]
    best = min(long, key=lambda scan: scan.errors.min())
    plain = min(scans, key=lambda scan: scan.errors[EARLIEST])
    k = int(np.argmin(best.errors))
    rivals = [x for x in long if x.errors.min() <= COMPARABLE * best.errors[k]]
    late = times[k]
    apart = max(abs(times[int(np.argmin(x.errors))] - late) for x in rivals)
    if apart > max(step, SAME * late) or not EARLIEST < k < len(times) - 1:
        return None
    full, fits = predicted(best.columns, torques[:, k])
    less, before = predicted(plain.columns, torques[:, EARLIEST])
    share, clear = gain(full, less)
    left = float(full.mean() / max(np.var(torques[:, k]), 1e-300))
    shown = share >= REMOVED and max(clear, steady_gain(full, less)) >= CLEAR and left <= LEFT
    inertia, earlier = (float(x[:, 0].mean()) for x in (fits, before))
    rows = _lowest(best.errors, k) - EARLIEST - HELD
    if not shown or inertia <= LIGHTER * max(earlier, 0.0) or rows < LEAST:
        return None
    return Spent(DELAY, (rows * step,), (WITHIN * step,), share)


def in_time(logs: Sequence[Log], late: Spent | None) -> list[Log]:
    """Return logs whose commands stand where they act, for regressions of the torque."""
    if late is None:
        return list(logs)
    rows = [-late.values[0] / log.dt for log in logs]
    return [
        replace(log, command=until_next(log.command, k)) for log, k in zip(logs, rows, strict=True)
    ]


def _tells(joint: Joint, logs: Sequence[Log]) -> bool:
    """Return whether the records have a command and a motion of one body whose delay is unknown."""
    shape = joint.structure_row
    if shape.size > 1 or shape.output_fixed or DELAY in joint.effects:
        return False
    if any("q_m" not in log.measured or log.drive == "i" for log in logs):
        return False
    volts = logs[0].voltage and "r" not in joint.parameters
    return not volts and any(np.ptp(log.command) > 0.0 for log in logs)


def _scan(columns: Floats, torques: Floats) -> _Scan:
    """Return how much regressions leave of torques of shape (M, K)."""
    basis = np.linalg.qr(columns)[0]
    errors = np.sum(torques**2, axis=0) - np.sum((basis.T @ torques) ** 2, axis=0)
    return _Scan(errors, columns)


def _lowest(errors: Floats, k: int) -> float:
    """Return where a parabola through an error that is least and its neighbours is lowest."""
    before, least, after = errors[k - 1 : k + 2]
    return float(k + 0.5 * (before - after) / (before - 2.0 * least + after))


def _moving(
    log: Log, unit: float, back_emf: float, times: Floats, lengths: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return motion, dry friction and the motor's torque at each delay.

    Motion near rest counts, as friction turns round there.

    Returns:
        Acceleration, velocity, one, cosine and sine of the angle, shape (M, 5); friction that turns
        round at once, sharply or not, and over each path, shape (M, 2 + P); torques, shape (M, K).
    """
    q, speed = log.measured["q_m"], log.speed
    count = max(LEAST_SMOOTH, round(OVER / log.dt)) | 1
    driven = unit * np.stack([until_next(log.command, -x / log.dt) for x in times], axis=1)
    torques = driven + (log.load - back_emf * speed)[:, None]
    slow = STUCK * float(np.sqrt(np.mean(speed[log.whole] ** 2)))
    laws = [np.sign(speed), np.tanh(speed / max(slow, 1e-300))]
    laws += [bent(log.states[:, 0], x) for x in lengths]
    channels = q, np.gradient(q, log.dt), np.gradient(np.gradient(q, log.dt), log.dt)
    q, v, a, torques, dry = averaged((*channels, torques, np.stack(laws, axis=1)), count)
    use = binary_erosion(log.whole, iterations=count // 2, border_value=0)
    motion = np.stack([a, v, np.ones_like(v), np.cos(q), np.sin(q)], axis=1)
    return motion[use], dry[use], torques[use]
