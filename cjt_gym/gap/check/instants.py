"""Whether the channels of one row belong to the same instant.

In most logs a row holds a command and the measurements taken before it acted, so that the current
lags by one row even if the drive has no dead time. A larger lag may be due to the drive or the log;
if it cannot be the drive, it is a fault of the log. Other logs hold a command and what was measured
after it acted.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from cjt_gym.gap.check.balance import factors, left_over
from cjt_gym.gap.check.channels import FEW_COUNTS
from cjt_gym.gap.check.clock import even
from cjt_gym.gap.check.encoders import angles_in_step
from cjt_gym.gap.check.pieces import smooth
from cjt_gym.gap.check.view import View
from cjt_gym.gap.recorded.series import SLOW
from cjt_gym.joint import JointFile, Structure
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record

LATE = 0.7
"""Lag of the current above which it is reported, in samples."""
USUAL = 1.5
"""Largest lag of a current after its command without dead time, in samples."""
MOST_LATE = 40
"""Largest lag of a current after its command that is searched, in samples."""
LONGEST = 0.03
"""Longest plausible dead time of a drive [s]."""
ALIKE = 0.3
"""Least correlation of changes for a current to follow its command."""
ROWS = 0.7
"""Largest ratio of the mean square residual with a lag in rows to that with a lag in time."""
SAME_ROW = 0.5
"""Share of a current's mean square beyond its past and past commands that the command of its row
leaves if it acted before."""
UNKNOWN = 1e-3
"""Least share of a current's deviation that its past leaves for that to be judged."""
BETWEEN_ROWS = (0.0, 0.25, 0.5, 0.75)
"""Lags between two rows that are tried, in rows; up to the first of them a current is in time."""
IN_TIME = 0.5
"""Largest mean square by which a current in time misses the command of its row, relative to that by
which it misses the command before."""
TELLS = 0.01
"""Least relative difference of what currents leave of a motion for it to tell which one acts."""
PROMPT = 0.5
"""Share of the command of its row in a current that answers at once."""
BETWEEN = -0.05
"""Share of a command below which a current follows one between two rows, of a loop that is faster
than its log, which is interpolated: the shares of a lag fall and stay positive."""
EARLIER = 3
"""Number of past commands."""
SHIFTS = np.arange(-12.0, 24.01, 0.5)
"""Candidate shifts between motion and torque, in samples."""
EXPLAINED = 0.5
"""Largest relative residual of a motion's balance for its instants to be judged."""
CLEARLY = 0.5
"""Largest mean square residual with the best shift, relative to that without a shift."""
HEAVY = 0.5
"""Least inertia at the best shift, relative to that without a shift."""
ONE_SINE = 0.3
"""Relative residual of an acceleration that is proportional to the angle below which a motion is
a single sine."""
APART = 1.5
"""Least reported shift, in samples."""
WHOLE = 0.1
"""Distance of an interval from a whole multiple of the usual one, in these, up to which rows are
lost rather than late."""
SHORT = 0.1
"""Quantile of the intervals that is that of a log without lost rows."""
WHAT_TO_DO = "samples_late in the mapping puts its values into the rows of their instants"


def current_and_command(view: View) -> tuple[list[str], list[str]]:
    """Return faults and remarks on the instants of i and i_cmd."""
    if "i" not in view or "i_cmd" not in view:
        return [], []
    if view.channels["i"].unit != view.channels["i_cmd"].unit:
        return [], []
    if (off := misplaced(max(view.records, key=len))) is not None:
        name, rows = off
        beside = "the measurements" if name == "i_cmd" else "the current"
        return [], [
            "i answers i_cmd in the command's own row: the log writes each command beside "
            f"{beside} after it acted. A diagnosis takes this into account; a mapping does, with "
            f"samples_late = {rows} for {name}."
        ]
    lag = _lag(view.stretches[0])
    if lag is None or abs(lag) <= LATE:
        return [], []
    if lag < 0.0:
        rows = max(round(-lag), 1)
        return [
            f"i leads i_cmd by {-lag:.2g} samples: the two columns are swapped, or their rows "
            f"belong to different instants. Map them the other way round, or i_cmd with "
            f"samples_late = {rows}, or i with samples_late = {-rows}."
        ], []
    if (rows := _rows(max(view.records, key=len))) > 1:
        return [
            f"i follows i_cmd by {rows} rows whatever their duration: their rows belong to "
            f"different instants. Map i_cmd with samples_late = {1 - rows}."
        ], []
    said = f"i follows i_cmd by {_samples(lag)} ({1e3 * lag * view.dt:.2g} ms)"
    if lag <= USUAL:
        return [], [
            f"{said}, as in a log that writes each command beside the measurements before it."
        ]
    if lag * view.dt > LONGEST:
        return [
            f"{said}, longer than a drive takes: their rows belong to different instants. Map i "
            f"with samples_late = {round(lag) - 1}."
        ], []
    return [], [
        f"{said}: a dead time of the drive, or rows in which command and measurement belong to "
        f"different instants; {WHAT_TO_DO}."
    ]


def answers_in_its_row(record: Record) -> bool:
    """Return whether a current knows the command of its own row, beyond its past and theirs."""
    if not {"i", "i_cmd"} <= set(record.columns):
        return False
    i, command = _where_none_is_lost(record), record["i_cmd"]
    now, rows = slice(EARLIER, None), len(i) - EARLIER
    past = [i[EARLIER - 1 : -1]]
    past += [command[EARLIER - k : EARLIER - k + rows] for k in range(1, EARLIER + 1)]
    good = np.isfinite(np.stack([i[now], command[now], *past])).all(axis=0)
    if good.sum() < 10 * EARLIER:
        return False
    past, y = [x[good] for x in (*past, np.ones(rows))], i[now][good]
    both = [*past, command[now][good]]
    without = left_over(y, past)
    shown = without > UNKNOWN * np.std(y) and left_over(y, both) ** 2 < SAME_ROW * without**2
    return bool(shown and factors(y, both)[-1] > 0.0) or _is_in_time(i, command)


def _where_none_is_lost(record: Record) -> Floats:
    """Return the current, NaN in rows before which others of an even log were lost.

    The commands that acted between are lost with them, and that of the row itself is nearest.
    """
    steps = np.diff(record.t)
    steps = steps / np.quantile(steps, SHORT)  # half of all rows may be lost
    lost = (steps > 1.5) & (np.abs(steps - np.round(steps)) < WHOLE)
    after = np.convolve(np.append(0.0, lost), np.ones(EARLIER))[: len(record)] > 0.0
    return np.where(after, np.nan, record["i"])


def _is_in_time(i: Floats, command: Floats) -> bool:
    """Return whether a current is in time with the command of its row, not with an earlier one.

    Past commands foretell a smooth one, so that only the instants tell which of them acts.
    """
    now, least = slice(EARLIER, None), len(i) - EARLIER
    late = [command[EARLIER - k : EARLIER - k + least] for k in range(EARLIER + 1)]
    good = np.isfinite(np.stack([i[now], *late])).all(axis=0)
    y, late = i[now][good], [x[good] for x in late]
    if len(y) < 10 * EARLIER or not np.std(y) > 0.0:
        return False
    one, left = np.ones(len(y)), []
    for k, share in itertools.product(range(EARLIER), BETWEEN_ROWS):
        held = (1.0 - share) * late[k] + share * late[k + 1]
        left.append(left_over(y, [held, one]) if factors(y, [held, one])[0] > 0.0 else np.inf)
    first, next_row = left[0] ** 2, left[len(BETWEEN_ROWS)] ** 2
    return int(np.argmin(left)) <= 1 and bool(first < IN_TIME * next_row)


def misplaced(record: Record) -> tuple[str, int] | None:
    """Return the channel, i or i_cmd, that is one row late (1) or early (-1), or None."""
    if not answers_in_its_row(record):
        return None
    if not {"q_m", "dq_m"} & set(record.columns):
        return "i_cmd", 1
    shares = _shares(record)
    if _is_in_time(_where_none_is_lost(record), record["i_cmd"]):
        shares = np.eye(len(shares))[0]  # those of smooth commands are not told apart
    elif shares[1] > shares[0] or min(shares[:-1]) < BETWEEN:
        return None
    left = _left_by_currents(record, shares)
    if record.dt < SLOW and max(left.values()) < (1.0 + TELLS) * min(left.values()):
        return "i", -1  # measured before the command, as in most logs, for all that motion tells
    prompt = shares[0] > PROMPT * np.abs(shares[:-1]).sum()
    if prompt and left["mean"] <= min(left["after"], left["before"]):
        return None
    return ("i_cmd", 1) if left["after"] < left["before"] else ("i", -1)


def _left_by_currents(record: Record, shares: Floats) -> dict[str, float]:
    """Return what is left of the motion's change of speed beside each current that may cause it.

    Over two rows the speed changes by what the currents in between add. They are those of these
    rows if all of them are read after the command, else those of one row earlier; a fast current is
    the one at the end of a row, a slow one the mean of both ends. The mean is also what counts
    where a current answers at once in a log that is slower than the commands.
    """
    current = _without_noise(record, shares)
    if "q_m" in record:
        q = record["q_m"]
        change, motion = np.diff(q[1:], 2), [q[2:-1], q[3:] - q[1:-2], np.sign(q[3:] - q[1:-2])]
        motion += [record["tau"][2:-1]] if "tau" in record else []
    else:
        v = record["dq_m"]
        change, motion = v[3:] - v[1:-2], [v[2:-1], np.sign(v[2:-1])]
    fast = current[2:-1] + current[3:], current[1:-2] + current[2:-1]
    slow = fast[0] + fast[1], current[:-3] + 2.0 * current[1:-2] + current[2:-1]
    good = np.isfinite(np.stack([change, *motion, *fast, *slow])).all(axis=0)
    others = [x[good] for x in (*motion, np.ones(len(good)))]
    ends, means = (
        [left_over(change[good], [*others, x[good]]) for x in both] for both in (fast, slow)
    )
    return {"after": min(ends[0], means[0]), "before": min(ends[1], means[1]), "mean": means[0]}


def _shares(record: Record) -> Floats:
    """Return the shares of the commands of a row and those before it in its current, and a rest."""
    columns, i = _commands(record), record["i"]
    good = np.isfinite(columns).all(axis=1) & np.isfinite(i)
    return np.asarray(np.linalg.lstsq(columns[good], i[good], rcond=None)[0])


def _commands(record: Record) -> Floats:
    """Return the commands of each row and of those before it, and ones, shape (N, EARLIER + 2)."""
    command = record["i_cmd"]
    past = [np.append(np.full(k, np.nan), command[: len(command) - k]) for k in range(EARLIER + 1)]
    return np.column_stack([*past, np.ones(len(command))])


def _without_noise(record: Record, shares: Floats) -> Floats:
    """Return a current as far as it follows from the commands up to its row, shape (N,)."""
    return np.asarray(_commands(record) @ shares)


def in_step(
    records: Sequence[Record], held: Sequence[Record], file: JointFile, shape: Structure
) -> tuple[list[Record], list[Record]]:
    """Return records and held-out records whose rows hold values of the same instant.

    The angle of the load moves to the instants of the motor's. Where a current answers its command
    in the command's own row, the commands move to the row before if the motion answers there, too;
    otherwise the currents move to the next. Where both answer at once, as in a log that is slower
    than the loop, nothing moves.
    """
    both = angles_in_step(records, held, file, shape)
    off = misplaced(max((record for some in both for record in some), key=len))
    if off is None:
        return both
    name, rows = off
    moved = [[_moved(r, name, rows) if name in r else r for r in some] for some in both]
    return moved[0], moved[1]


def _moved(record: Record, name: str, late: int) -> Record:
    """Return a record without one row, a channel of which is late by one row, or early (-1)."""
    x = record[name]
    if late > 0:
        return record.with_columns({name: np.append(x[1:], x[-1])}).slice(0, len(x) - 1)
    return record.with_columns({name: np.insert(x[:-1], 0, x[0])}).slice(1, len(x))


def _leads_its_command(view: View) -> bool:
    """Return whether the measured current comes before its command."""
    if not {"i", "i_cmd"} <= view.channels.keys():
        return False
    lag = _lag(view.stretches[0])
    return lag is not None and lag < -LATE


def motion_and_torque(view: View) -> tuple[list[str], list[str]]:
    """Return faults and remarks on the instants of motion and torque."""
    shift = _shift(view)
    if shift is None or abs(shift) < APART or view.drive is None:
        return [], []
    assert view.motor_angle is not None
    motion, torque = view.motor_angle, view.drive
    angle = view.channels[motion]
    if motion.startswith("q_") and angle.span < FEW_COUNTS * angle.resolution:
        return [], []
    if _leads_its_command(view):  # what is taken for the current may be the command
        return [], []
    time = f"{_samples(abs(shift))} ({1e3 * abs(shift) * view.dt:.2g} ms)"
    if shift < 0.0:
        rows = round(-shift)
        return [
            f"{motion} leads the torque of {torque} by {time}: their rows belong to "
            f"different instants. Map {torque} with samples_late = {rows}."
        ], []
    said = f"{motion} follows the torque of {torque} by {time}"
    if torque == view.command:
        return [], [
            f"{said}: a dead time of the drive, or of the measurement, or rows of different "
            f"instants; {WHAT_TO_DO}."
        ]
    return [
        f"{said}, although both are measured: their rows belong to different instants. Map "
        f"{motion} with samples_late = {round(shift)}."
    ], []


def _lag(piece: dict[str, Floats]) -> float | None:
    """Return the lag of a current after its command in samples; None if it does not follow."""
    x, y = np.diff(piece["i_cmd"]), np.diff(piece["i"])
    most = min(MOST_LATE, len(x) // 4)
    lags = np.arange(-most, most + 1)
    alike = np.array([_alike(x, y, int(lag)) for lag in lags])
    if len(alike) and -alike.min() > alike.max():
        alike = -alike  # its sign is turned
    if not len(alike) or not np.isfinite(alike).all() or alike.max() < ALIKE:
        return None
    best = int(np.argmax(alike))
    lag = float(lags[best])
    if 0 < best < len(alike) - 1:
        low, top, high = alike[best - 1 : best + 2]
        bend = low - 2.0 * top + high
        lag += float(0.5 * (low - high) / bend) if bend else 0.0
    return lag


def _alike(x: Floats, y: Floats, lag: int) -> float:
    a, b = (x[: len(x) - lag], y[lag:]) if lag >= 0 else (x[-lag:], y[: len(y) + lag])
    power = float((a @ a) * (b @ b))
    return float(a @ b) / np.sqrt(power) if power > 0.0 else 0.0


def _rows(record: Record) -> int:
    """Return the lag of a current in rows if it is a number of rows, not a time; else 0.

    Only uneven sampling shows the difference: a dead time spans fewer rows where rows take longer.
    """
    t, i, command = record.t, record["i"], record["i_cmd"]
    if even(np.diff(t)):
        return 0
    good = np.isfinite(i) & np.isfinite(command)
    t, i, command = t[good], i[good], command[good]
    most = min(8, len(t) // 4)
    by_rows = [left_over(i[most:], [command[most - k : len(i) - k]]) for k in range(most)]
    dt = float(np.median(np.diff(t)))
    by_time = []
    for late in np.arange(0.0, most * dt, 0.1 * dt):
        held = np.searchsorted(t, t - late, side="left") - 1
        slow = np.interp(t - late, t, command)
        for delayed in (command[np.maximum(held, 0)], slow):
            by_time.append(left_over(i[most:], [delayed[most:]]))
    rows = int(np.argmin(by_rows))
    return rows if min(by_rows) ** 2 < ROWS * min(by_time) ** 2 else 0


def _shift(view: View) -> float | None:
    """Return the lag of the motion after its torque in samples; None if it is not identifiable."""
    balance = view.motor
    if balance is None or view.motor_angle == "tau" or view.drive == "v":
        return None  # the motor inherently lags behind a voltage
    if view.structure.has_spring and not (view.cut or view.structure.output_fixed):
        return None  # a load on a spring leads or lags by itself, and its torque is not measured
    a, motion = balance["a"], [balance["q"], balance["one"]]
    if left_over(a, motion) < ONE_SINE * float(np.std(a)):
        return None  # in a single sine a lag is damping, and friction that bends first looks late
    terms = [balance[name] for name in ("a", "v", "s", "one", "q")]
    if not view.records[0].prismatic:
        terms += [np.sin(balance["q"]), np.cos(balance["q"])]
    torques = {
        id(piece): smooth(view.motor_torque(piece), balance.width)
        for piece in view.stretches
        if len(piece["t"]) > 2 * balance.width
    }
    tried = [view.at_motion(lambda piece: torques[id(piece)], shift * view.dt) for shift in SHIFTS]
    left = np.array([left_over(y, terms) / max(float(np.std(y)), 1e-300) for y in tried])
    best, none = int(np.argmin(left)), int(np.flatnonzero(SHIFTS == 0.0)[0])
    now = left[none]
    if best in (0, len(SHIFTS) - 1) or left[best] > EXPLAINED:
        return None
    if factors(tried[best], terms)[0] < HEAVY * factors(tried[none], terms)[0]:
        return None  # the lag is due to inertia
    return float(SHIFTS[best]) if left[best] ** 2 < CLEARLY * now**2 else 0.0


def _samples(count: float) -> str:
    """Return a number of samples in words."""
    told = f"{count:.2g}"
    return f"{told} sample" if told == "1" else f"{told} samples"
