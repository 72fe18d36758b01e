"""A record on an even time grid: input of the joint, measured channels and usable samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import binary_dilation, binary_erosion
from scipy.signal import savgol_filter

from cjt_gym.errors import RecordError
from cjt_gym.gap.recorded.series import SHORTEST, SLOW, current_before, same_file
from cjt_gym.gap.recorded.slope import in_time, is_noise, is_slope
from cjt_gym.joint import JointFile, Structure
from cjt_gym.joint.between_rows import until_next
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record

Flags = NDArray[np.bool_]
SMOOTH = 0.02
"""Time over which angles are smoothed for the state at the start of a window [s]."""
LEAST_SMOOTH = 5
"""Fewest samples to smooth over."""
GAP = 5.0
"""Ratio to the median sampling interval above which there is a gap in the log."""
ENOUGH = 2e-3
"""Sample time to which records of a joint without a spring are downsampled [s]."""
DRIVING = ("i", "i_cmd", "v", "tau_cmd", "tau_m", "tau_l")
FOLLOWED = 0.1
"""Largest share of a current's variance that its command may leave unexplained."""
STUCK = 0.05
"""Share of the usual speed below which dry friction cannot be evaluated."""
EITHER_WAY = 0.1
"""Share of the motion that either direction must have for its friction to be seen."""
Drive = Literal["i", "i_cmd", "v"]


@dataclass(frozen=True, eq=False)
class Log:
    """One record, ready to be predicted.

    Attributes:
        dt: Sample time [s].
        t: Time of the samples [s], shape (N,).
        drive: Channel that drives the joint.
        command: That channel [A], or [V] if it is a voltage, shape (N,).
        wanted: Command of the drive if the current was measured too [A], shape (N,).
        load: Torque on the load [N m], or velocity of a prescribed load [rad/s]; shape (N,).
        rows: Rows of the record per sample.
        acting: What drives the joint from each sample to the next [A] or [V], shape (N,): the
            command, or the mean of what was measured at both.
        pulling: Load from each sample to the next, likewise, shape (N,).
        measured: Channels to predict, of q_m, q_l and tau, each of shape (N,).
        states: [q_m q_g q_l dq_m dq_g dq_l] as measured, smoothed, shape (N, 6).
        first: States from which predictions start: the same, but smoothed no longer than suits
            the record, shape (N, 6).
        angles: Angles of motor, gear and load, not smoothed, shape (N, 3).
        known: Which states were measured or follow from measured channels, shape (6,).
        acceleration: Smoothed acceleration of the motor [rad/s^2], shape (N,).
        with_speed: Whether the motor's velocity was measured, is the slope of its angle, and no
            noise beside that.
        whole: Where all channels were measured and no gap is near, shape (N,).
        temperature: Lowest and highest temperature reported by the drive [degC]; None if absent.
        past: Current from the beginning of the file up to the first sample [A], shape (M,).
        filtered: Whether predictions start from what a filter of the joint estimates.
        from_slope: Whether they start from the slope of the angle although its velocity was
            measured.
        share: Rows after its own at which the torque is logged that acts from a row to the next: 0
            for one that is held, 0.5 for the mean of two rows, more for one that is logged late.
    """

    dt: float
    t: Floats
    drive: Drive
    command: Floats
    wanted: Floats | None
    load: Floats
    rows: int
    acting: Floats
    pulling: Floats
    measured: dict[str, Floats]
    states: Floats
    first: Floats
    angles: Floats
    known: Flags
    acceleration: Floats
    with_speed: bool
    whole: Flags
    temperature: tuple[float, float] | None = None
    past: Floats = field(default_factory=lambda: np.zeros(0))
    filtered: bool = False
    from_slope: bool = False
    share: float = 0.0

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def inside(self) -> Flags:
        """Where no gap is near enough to bend smoothed speeds, shape (N,); `whole` if nowhere."""
        width = usual_count(self.dt) // 2
        inside = binary_erosion(self.whole, iterations=width, border_value=1)
        return inside if inside.any() else self.whole

    @property
    def voltage(self) -> bool:
        """Whether the joint is driven by a voltage."""
        return self.drive == "v"

    @property
    def usual(self) -> float:
        """Rows by which the motion follows the input unless the record shows otherwise."""
        return 0.0 if self.drive == "i" else 0.5

    def late(self, rows: float) -> Log:
        """Return the log of a joint that its input moves late by some rows, early if negative."""
        log = replace(self, share=0.5 - rows)
        command = until_next(self.command, log.early / self.rows)
        acting = until_next(command, (log.share - log.early) / self.rows)
        return replace(log, command=command, acting=acting)

    @property
    def early(self) -> float:
        """Rows by which the motion is ahead of its input, more than within a row."""
        return self.share - 0.5 if self.share > 1.0 else 0.0

    def started(self, width: float) -> Log:
        """Return the log with predictions that start from states smoothed over a time [s]."""
        first = _smooth_states(self.angles, max(3, round(width / self.dt) | 1), self.dt)
        if self.with_speed and not self.from_slope:
            first[:, 3] = self.states[:, 3]
        return replace(self, first=first)

    def by_angle(self) -> Log:
        """Return the log with predictions that start from the angle's slope, not measured speed."""
        first = self.states.copy()
        first[:, 3] = smoothed(self.angles[:, 0], self.dt, 1)
        return replace(self, first=first, from_slope=True)

    @property
    def speed(self) -> Floats:
        """Velocity of the motor [rad/s], shape (N,)."""
        return self.states[:, 3]


def to_logs(records: Sequence[Record], file: JointFile, structure: Structure) -> list[Log]:
    """Return records on even grids, all driven by the same channel where they have it.

    Raises:
        RecordError: As for `to_log`.
    """
    pairs = [(record, same_file(record, records)) for record in records]
    logs = [to_log(record, file, structure, whole) for record, whole in pairs]
    if len({log.drive for log in logs}) == 1:
        return logs
    return [to_log(record, file, structure, whole, measured=True) for record, whole in pairs]


def to_log(
    record: Record,
    file: JointFile,
    structure: Structure,
    whole: Sequence[Record] = (),
    *,
    measured: bool = False,
) -> Log:
    """Return a record on an even grid.

    Args:
        record: The record.
        file: The joint.
        structure: Structure of the joint.
        whole: Records of the same file, of which this one is a part.
        measured: Whether a measured current drives the joint even if it follows its command.

    Raises:
        RecordError: Nothing drives the joint, or nothing that could be predicted was measured.
    """
    columns = {name: record[name] for name in record.columns if name != "t"}
    columns = {n: x for n, x in columns.items() if np.isfinite(x).sum() >= SHORTEST}
    t = record.t
    dt = float(np.median(np.diff(t)))
    every = 1
    if structure.size == 1 and not structure.output_fixed:
        every = max(int(ENOUGH / dt + 1e-9), 1)
        columns, t = _thinned(columns, t, every)
        dt = float(np.median(np.diff(t)))
    grid = t[0] + dt * np.arange(round((t[-1] - t[0]) / dt) + 1)
    even = {n: _even(grid, t, x) for n, x in columns.items()}
    drive, command = _driving(record, even, file)
    followed = not measured and drive == "i" and "i_cmd" in even
    if dt <= SLOW and structure.has_spring and followed and _followed(even["i"], even["i_cmd"]):
        drive, command = "i_cmd", even["i_cmd"]
    shown = _measured(record, even, structure, grid)
    used = [n for n in columns if n in (*shown, drive, "tau_cmd", "tau_l")]
    holes = _holes(grid, t, [columns[n] for n in used], dt)
    felt = shown | ({"tau": felt_torque(shown["tau"], file)} if "tau" in shown else {})
    zero = _relaxed(felt, even.get("q_l"), command, structure, dt, ~holes)
    if "q_l" in shown:
        shown["q_l"] = felt["q_l"] = shown["q_l"] + zero
    held = even.get("q_l", np.zeros(len(grid))) + zero if structure.output_fixed else None
    angles = _angles(felt, held, structure, file)
    states = _smooth_states(angles, usual_count(dt), dt)
    with_speed = "dq_m" in even and is_slope(even["dq_m"], angles[:, 0], dt)
    if with_speed:
        speed = in_time(even["dq_m"], angles[:, 0])
        with_speed = not is_noise(speed, states[:, 3], angles[:, 0], dt)
    if with_speed:
        states[:, 3] = speed
    load = even.get("tau_l", np.zeros(len(grid)))
    pulling = until_next(load, 0.5 / every)
    if structure.output_fixed:
        load = pulling = states[:, 5]
    share = 0.5 if drive == "i" else 0.0
    acting = until_next(command, share / every)  # means of rows lack the rise within one only
    wanted = even.get("i_cmd") if drive == "i" else None
    heat = even.get("temperature")
    warm = None if heat is None else (float(heat.min()), float(heat.max()))
    return Log(
        dt, grid, drive, command, wanted, load, every, acting, pulling, shown, states, states,
        angles, _known(shown, held, structure), smoothed(angles[:, 0], dt, 2), with_speed, ~holes,
        warm, current_before(grid[0], whole, file, dt), share=share,
    )  # fmt: skip


def _thinned(columns: dict[str, Floats], t: Floats, every: int) -> tuple[dict[str, Floats], Floats]:
    """Return every nth sample; input channels are averaged over each interval."""
    if every == 1:
        return columns, t
    rows = len(t) // every
    kept = {}
    for name, x in columns.items():
        parts = x[: rows * every].reshape(rows, every)
        kept[name] = parts.mean(axis=1) if name in DRIVING else parts[:, 0]
    return kept, t[: rows * every : every]


def _even(grid: Floats, t: Floats, x: Floats) -> Floats:
    good = np.isfinite(x)
    return np.asarray(np.interp(grid, t[good], x[good]))


def _driving(record: Record, even: dict[str, Floats], file: JointFile) -> tuple[Drive, Floats]:
    """Return the channel that drives the joint, and the current or voltage that it represents."""
    p = file.parameters
    if p.takes_volts and "v" in even:
        return "i_cmd", even["v"]
    if "i" in even:
        return "i", even["i"]
    if "i_cmd" in even:
        return "i_cmd", even["i_cmd"]
    for name in ("tau_m", "tau_cmd"):
        if name in even:
            return ("i" if name == "tau_m" else "i_cmd"), even[name] / (p.k_t * p.n)
    if "v" in even and "r" in p:
        return "v", even["v"]
    raise RecordError(
        f"{record.owner} must have one of i [A], i_cmd [A], tau_m [N m], tau_cmd [N m], or v [V] "
        "with the resistance r of the joint or its k_t in N m/V. Columns there: "
        f"{', '.join(record.columns)}."
    )


def _followed(i: Floats, command: Floats) -> bool:
    """Return whether a current follows its command closely enough for the command to drive.

    Between two samples, a current that follows a held command is closer to the next sample than to
    the last, which matters with an oscillating spring. The command is known at every instant.
    """
    left = np.min([np.var(i[2:] - command[2 - k : len(command) - k]) for k in (0, 1, 2)])
    return bool(left < FOLLOWED * np.var(i))


def _measured(
    record: Record, even: dict[str, Floats], structure: Structure, grid: Floats
) -> dict[str, Floats]:
    """Return the channels that a joint of this structure predicts."""
    motor, gear, load = structure.groups
    found: dict[str, Floats] = {}
    with_motor = [b for b, g in zip("mgl", structure.groups, strict=True) if g == motor]
    for body in with_motor:
        if f"q_{body}" in even:
            found["q_m"] = even[f"q_{body}"]
            break
    else:
        for body in with_motor:
            if f"dq_{body}" in even:
                found["q_m"] = cumulative_trapezoid(even[f"dq_{body}"], grid, initial=0.0)
                break
    if load != motor and "q_l" in even and not structure.output_fixed:
        found["q_l"] = even["q_l"]
    if gear != load and "tau" in even:
        found["tau"] = even["tau"]
    if not found.keys() & {"q_m", "tau"}:
        raise RecordError(
            f"{record.owner} must have the motor's angle q_m [rad] or velocity dq_m [rad/s], or "
            f"with a spring its torque tau [N m]. Columns there: {', '.join(record.columns)}."
        )
    return found


def felt_torque(tau: Floats, file: JointFile) -> Floats:
    """Return the torque that a sensor felt, without the bias and gain that a joint file lists."""
    bias, gain = file.effects.get("torque_bias", {}), file.effects.get("torque_gain", {})
    off, scale = bias.get("bias"), gain.get("gain")
    tau = tau - off.number if isinstance(off, Quantity) else tau
    return tau / scale.number if isinstance(scale, Quantity) else tau


def _relaxed(
    measured: dict[str, Floats],
    q_l: Floats | None,
    drive: Floats,
    structure: Structure,
    dt: float,
    whole: Flags,
) -> float:
    """Return the offset of the load's angle that makes deflection zero at zero torque [rad].

    Encoder zeros are arbitrary: they follow from a regression of the deflection on the torque or,
    if that was not measured, on what takes it: inertia and friction of a free load; of a held
    output the input, less what they take from it. Friction may differ with the direction, which
    motion in one direction does not show. The motor's angle is left unchanged, because cogging and
    ripple refer to its zero.
    """
    unseen = "q_m" not in measured or (q_l is None and not structure.output_fixed)
    if unseen or not structure.has_spring:
        return 0.0
    q_m = measured["q_m"]
    twist = q_m - (q_l if q_l is not None else 0.0)
    if "tau" in measured:
        columns, use = [measured["tau"]], whole
    else:
        moves = q_m if structure.output_fixed or q_l is None else q_l
        twist, speed, acceleration = smoothed(twist, dt), *(smoothed(moves, dt, k) for k in (1, 2))
        use = whole & (np.abs(speed) > STUCK * float(np.sqrt(np.mean(speed[whole] ** 2))))
        columns = [acceleration, speed]
        if structure.output_fixed:
            columns += [smoothed(drive, dt), np.abs(speed), np.sign(speed)]
        elif goes_both_ways(speed[use]):
            columns += [np.sign(speed)]
    rows = np.stack([*columns, np.ones(len(twist))], axis=1)
    return float(np.linalg.lstsq(rows[use], twist[use], rcond=None)[0][-1])


def goes_both_ways(speed: Floats) -> bool:
    """Return whether either direction has its share of a motion."""
    return bool(EITHER_WAY < np.mean(speed > 0.0) < 1.0 - EITHER_WAY)


def _holes(grid: Floats, t: Floats, columns: list[Floats], dt: float) -> Flags:
    """Return where the log has a gap, shape (N,)."""
    bad = np.zeros(len(grid), dtype=bool)
    for x in columns:
        known = t[np.isfinite(x)]
        for k in np.flatnonzero(np.diff(known) > GAP * dt):
            bad |= (grid > known[k] + 0.5 * dt) & (grid < known[k + 1] - 0.5 * dt)
        bad |= (grid < known[0] - 0.5 * dt) | (grid > known[-1] + 0.5 * dt)
    return np.asarray(binary_dilation(bad, iterations=LEAST_SMOOTH // 2)) if bad.any() else bad


def _known(measured: dict[str, Floats], held: Floats | None, structure: Structure) -> Flags:
    """Return which states follow from measured channels, shape (6,)."""
    motor, gear, load = structure.groups
    tau = "tau" in measured
    q_m = "q_m" in measured or (tau and gear == motor)  # beyond a compliant gear inertia counts
    q_g = q_m if gear == motor else tau or (gear == load and "q_l" in measured)
    q_l = load < 0 or load == motor or "q_l" in measured or held is not None or tau
    return np.array([q_m, q_g, q_l] * 2)


def smoothed(x: Floats, dt: float, order: int = 0) -> Floats:
    """Return a channel, or its derivative of order up to 2, smoothed by local parabolas."""
    return np.asarray(savgol_filter(x, usual_count(dt), 2, deriv=order, delta=dt))


def usual_count(dt: float) -> int:
    """Return the number of samples over which states are smoothed."""
    return max(LEAST_SMOOTH, round(SMOOTH / dt) | 1)


def _angles(
    measured: dict[str, Floats], held: Floats | None, structure: Structure, file: JointFile
) -> Floats:
    """Return the angles of motor, gear and load, shape (N, 3).

    Unmeasured ones follow from measured ones: the deflection of a spring from its torque, the
    motor's angle with a held output likewise, and bodies that move together from each other.
    """
    p = file.parameters
    motor, gear, load = structure.groups
    size = len(next(iter(measured.values())))
    tau = measured.get("tau", np.zeros(size))
    k_b, k_g = p.get("k_b", 0.0), p.get("k_g", 0.0)
    bar = tau / k_b if gear != load and k_b > 0.0 else np.zeros(size)
    mesh = tau / k_g if motor != gear and k_g > 0.0 else np.zeros(size)
    load_angle = measured.get("q_l", held)
    q_m = measured.get("q_m", (0.0 if load_angle is None else load_angle) + bar + mesh)
    if load_angle is not None:
        q_l = load_angle
    else:
        q_l = np.zeros(size) if structure.output_fixed else q_m - bar - mesh
    q_g = q_m - mesh if motor != gear else q_m
    return np.stack([q_m, q_g, q_m if load == motor else q_l], axis=1)


def _smooth_states(angles: Floats, count: int, dt: float) -> Floats:
    """Return angles and their rates, smoothed by parabolas of so many samples, shape (N, 6)."""
    parts = [
        savgol_filter(q, count, 2, deriv=order, delta=dt) for order in (0, 1) for q in angles.T
    ]
    return np.stack(parts, axis=1)
