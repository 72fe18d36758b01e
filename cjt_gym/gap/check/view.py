"""A record seen as bodies that move: smoothed angles with their derivatives, torques, directions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from cjt_gym.gap.check.balance import FEWEST, Balance, Floats, left_over
from cjt_gym.gap.check.clock import gap_length
from cjt_gym.gap.check.channels import Channel, channels_of
from cjt_gym.joint import STRUCTURES, JointFile, Structure
from cjt_gym.records import Record

WIDTHS = (5, 7, 9, 13, 17, 25, 37, 53, 75, 101)
"""Samples over which angles may be smoothed."""
LONGEST = 0.3
"""Time over which they are smoothed at most [s]."""
MOVING = 3.0
"""Deviations of the speed from which a body moves."""
LEAST_SPEED = 2e-3
"""Share of its highest speed from which a body moves."""
REST = 0.1
"""Time without motion from which a body is at rest [s]."""
CLEAN = 3.0
"""Factor by which the scatter of a balance may exceed what the noise of its channels makes."""

Columns = dict[str, Floats]


@dataclass(frozen=True, eq=False)
class View:
    """Records of one joint, ready to be examined.

    Attributes:
        records: The records.
        joint: The nominal joint; None where it is not known.
        structure: How its bodies are joined.
        channels: What each channel is by itself; of several records, that of the longest.
    """

    records: tuple[Record, ...]
    joint: JointFile | None
    structure: Structure
    channels: Mapping[str, Channel]

    @classmethod
    def of(
        cls, records: Sequence[Record], joint: JointFile | None, structure: Structure | None
    ) -> View:
        """Return the view of one or several records."""
        longest = max(records, key=len)
        channels = channels_of(longest, joint)
        return cls(tuple(records), joint, structure or _likely(longest, channels), channels)

    def __contains__(self, name: object) -> bool:
        """Return whether a channel is there and moves."""
        return name in self.channels and self.channels[str(name)].moves

    # ---- what the joint file says
    def value(self, symbol: str, default: float = 0.0) -> float:
        """Return a parameter of the joint, or the default where there is none."""
        return default if self.joint is None else self.joint.parameters.get(symbol, default)

    @property
    def ratio(self) -> float:
        """Ratio of the gear; 1 where it is not known."""
        return self.value("n", 1.0)

    @property
    def torque_per_input(self) -> float:
        """Torque on the link side per unit of what drives the motor; 1 where it is not known."""
        gain = self.value("k_t", 1.0) * self.ratio
        if self.drive == "v" and self.value("r") > 0.0:
            gain /= self.value("r")
        return 1.0 if self.drive in ("tau_m", "tau_cmd") else gain

    @property
    def torque_unit(self) -> str:
        """Unit of the torques in the balance."""
        if self.joint is None and self.drive is not None:
            return self.channels[self.drive].unit
        return "N" if self.records[0].prismatic else "N m"

    @property
    def angle_unit(self) -> str:
        """Unit of the angles."""
        return "m" if self.records[0].prismatic else "rad"

    # ---- what is there
    @property
    def dt(self) -> float:
        """Usual sample time [s]."""
        return max(self.records, key=len).dt

    @property
    def seconds(self) -> float:
        """Time that the longest record covers [s]."""
        return max(float(record.t[-1] - record.t[0]) for record in self.records)

    @cached_property
    def drive(self) -> str | None:
        """The channel that stands for the motor's torque, or None."""
        names = ("i", "tau_m", "i_cmd", "tau_cmd", "v")
        return next((name for name in names if name in self.channels), None)

    @cached_property
    def command(self) -> str | None:
        """The channel of the command to the drive, or None."""
        return next((name for name in ("i_cmd", "tau_cmd") if name in self.channels), None)

    @property
    def has_spring(self) -> bool:
        """Whether a torsion bar separates motor side and load."""
        return self.structure.groups[1] != self.structure.groups[2]

    @property
    def has_gear(self) -> bool:
        """Whether the gearbox is compliant."""
        return self.structure.groups[0] != self.structure.groups[1]

    @property
    def cut(self) -> bool:
        """Whether the measured torque separates the motor side from the load."""
        return self.has_spring and "tau" in self

    @cached_property
    def motor_angle(self) -> str | None:
        """The channel that shows the motor's motion: an angle, a velocity, or tau; or None."""
        groups = self.structure.groups
        bodies = [b for b, group in zip("mgl", groups, strict=True) if group == groups[0]]
        names = [*(f"q_{b}" for b in bodies), *(f"dq_{b}" for b in bodies)]
        found = next((name for name in names if name in self.channels), None)
        held = self.structure.output_fixed and "tau" in self.channels
        return found or ("tau" if held and self.value("k_b", 1.0) > 0.0 else None)

    @cached_property
    def load_angle(self) -> str | None:
        """The channel that shows the load's motion, or None."""
        if self.structure.output_fixed:
            return None
        return next((name for name in ("q_l", "dq_l") if name in self.channels), None)

    @property
    def deflection_known(self) -> bool:
        """Whether both ends of the spring are measured, or one is held."""
        if not self.cut or not self.motor_angle or self.motor_angle == "tau":
            return False
        return self.structure.output_fixed or self.load_angle is not None

    @cached_property
    def stretches(self) -> tuple[Columns, ...]:
        """The channels on even times between the gaps, longest first; without short pieces."""
        found = [piece for record in self.records for piece in _stretches(record, self.channels)]
        found.sort(key=lambda piece: -len(piece["t"]))
        return tuple(piece for piece in found if len(piece["t"]) >= FEWEST) or tuple(found[:1])

    # ---- bodies
    @cached_property
    def motor(self) -> Balance | None:
        """The balance of the motor side, or of all bodies where nothing cuts them; or None."""
        if self.drive is None or self.motor_angle is None:
            return None
        return self._balance(self.motor_angle, self._motor_torque)

    @cached_property
    def load(self) -> Balance | None:
        """The balance of the load, where it is cut off and free; or None."""
        angle = self.load_angle if self.has_spring else self.motor_angle
        known = "tau" in self or self.wound
        if self.structure.output_fixed or not known or angle is None:
            return None
        return self._balance(angle, self._load_torque)

    @property
    def wound(self) -> bool:
        """Whether the spring's torque follows from its two angles, as none is measured."""
        ends = self.has_spring and {"q_m", "q_l"} <= self.channels.keys()
        return ends and "tau" not in self and self.value("k_b") > 0.0

    @cached_property
    def travel(self) -> tuple[float, float]:
        """How far the motor goes in the positive and in the negative direction."""
        up = down = 0.0
        for motion in self._motions(self.motor_angle, 9):
            change = np.diff(motion["q"])
            up, down = up + change[change > 0.0].sum(), down - change[change < 0.0].sum()
        return float(up), float(down)

    @cached_property
    def both_ways(self) -> tuple[float, float]:
        """Share of the moving samples in the positive and in the negative direction."""
        if self.motor is None or not len(self.motor):
            return 0.0, 0.0
        up = float(np.mean(self.motor["s"] > 0.0))
        return up, 1.0 - up

    @cached_property
    def speeds(self) -> tuple[float, float]:
        """Tenth and nine tenths quantile of the motor's speed while it moves."""
        if self.motor is None or not len(self.motor):
            return 0.0, 0.0
        low, high = np.quantile(np.abs(self.motor["v"]), [0.1, 0.9])
        return float(low), float(high)

    @cached_property
    def reversals(self) -> int:
        """How often the motor turns round, or sets out from rest."""
        count = 0
        for motion in self._motions(self.motor_angle, self.width):
            limit = self._least_speed(self.motor_angle, self.width)
            way = np.where(np.abs(motion["v"]) > limit, np.sign(motion["v"]), 0.0)
            count += _changes(way, max(int(REST / self.dt), 3))
        return count

    @cached_property
    def resting(self) -> float:
        """Share of the samples at which the motor is at rest."""
        total = sum(len(piece["t"]) for piece in self._motions(self.motor_angle, self.width))
        return 1.0 - (0 if self.motor is None else len(self.motor)) / max(total, 1)

    @cached_property
    def width(self) -> int:
        """Samples over which everything is smoothed: those that show the acceleration best."""
        longest = max(len(piece["t"]) for piece in self.stretches) // 8
        most = max(min(LONGEST / self.dt, longest), WIDTHS[0])
        names = [width for width in WIDTHS if width <= most]
        return max(names, key=self._sharpness)

    def _sharpness(self, width: int) -> float:
        if self.drive is None or self.motor_angle is None:
            return 0.0
        found = self._balance(self.motor_angle, self._motor_torque, width)
        if found is None:
            return 0.0
        least = found.least(found["a"], ("v", "s", "one"))
        return 1.0 / least if np.isfinite(least) and least > 0.0 else 0.0

    def _motor_torque(self, piece: Columns) -> Floats:
        assert self.drive is not None
        torque = self.torque_per_input * piece[self.drive]
        if self.cut:
            return np.asarray(torque - piece["tau"])
        return np.asarray(torque + piece.get("tau_l", 0.0))

    def _load_torque(self, piece: Columns) -> Floats:
        spring = self.value("k_b") * (piece["q_m"] - piece["q_l"]) if self.wound else piece["tau"]
        return np.asarray(spring + piece.get("tau_l", 0.0))

    def _motions(self, angle: str | None, width: int) -> list[Columns]:
        if angle is None:
            return []
        pieces = (piece for piece in self.stretches if len(piece["t"]) > 2 * width)
        return [_motion(piece, angle, self, width) for piece in pieces]

    def _least_speed(self, angle: str | None, width: int) -> float:
        """Return the speed from which a body moves."""
        assert angle is not None
        fastest = max((float(np.abs(m["v"]).max()) for m in self._motions(angle, width)), default=0)
        noise = MOVING * self.angle_noise(angle) * _gain(width, 1, self.dt, angle)
        return float(max(LEAST_SPEED * fastest, noise, 1e-300))

    def angle_noise(self, angle: str) -> float:
        """Return the deviation of a sample of an angle; of tau, of the angle that it stands for."""
        noise = self.channels[angle].noise
        return noise / self.value("k_b", 1.0) if angle == "tau" else noise

    def _balance(self, angle: str, torque, width: int | None = None) -> Balance | None:  # type: ignore[no-untyped-def]
        """Return the balance of the body of that angle under that torque while it moves."""
        wide = width or self.width
        limit = self._least_speed(angle, wide)
        parts: list[Columns] = []
        for k, piece in enumerate(self.stretches):
            if len(piece["t"]) <= 2 * wide:
                continue
            motion = _motion(piece, angle, self, wide)
            smoothed = {n: _smooth(x, wide) for n, x in piece.items() if n != "t"}
            motion["y"] = _smooth(torque(piece), wide)
            motion["u"] = self._driving(smoothed)
            motion |= {n: x for n, x in smoothed.items() if n not in motion}
            motion["valid"] = _smooth(piece["_valid"], wide) > 0.5
            moving = (np.abs(motion["v"]) > limit) & motion["valid"].astype(bool)
            moving[: wide // 2] = moving[-(wide // 2) :] = False
            motion |= {"time": piece["t"], "stretch": np.full(len(piece["t"]), float(k))}
            parts.append({n: x[moving] for n, x in motion.items()})
        if not parts:
            return None
        joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        if len(joined["y"]) < FEWEST:
            return None
        y = joined.pop("y")
        joined |= {"s": np.sign(joined["v"]), "one": np.ones(len(y))}
        scatter = self._scatter(angle, y, joined, wide)
        driving = joined["u"] if self.drive is not None else y
        return Balance(y, joined, scatter, wide, float(np.quantile(np.abs(driving), 0.95)))

    def _driving(self, smoothed: Columns) -> Floats:
        if self.drive is None:
            return np.zeros(len(next(iter(smoothed.values()))))
        return np.asarray(self.torque_per_input * smoothed[self.drive])

    def _scatter(self, angle: str, y: Floats, columns: Columns, width: int) -> float:
        """Return the scatter of a balance: what is left of it, if that is not far above noise."""
        plain = [columns[name] for name in ("a", "v", "s", "one")]
        v = columns["v"]
        quick = float(np.quantile(np.abs(v), 0.9))
        more = [np.abs(v), v * np.abs(v), np.exp(-np.abs(v) / (0.1 * quick)) * np.sign(v)]
        left = left_over(y, plain + more)
        basis = np.column_stack(plain)
        inertia = abs(float(np.linalg.lstsq(basis, y, rcond=None)[0][0]))
        power = (inertia * self.angle_noise(angle) * _gain(width, 2, self.dt, angle)) ** 2
        if self.drive is not None:
            noise = 0.0 if self.drive.endswith("_cmd") else self.channels[self.drive].noise
            power += (self.torque_per_input * noise) ** 2 / width
        if "tau" in self.channels:
            power += self.channels["tau"].noise ** 2 / width
        return float(max(min(left, CLEAN * np.sqrt(power)), 1e-12 * np.std(y), 1e-300))


def _likely(record: Record, channels: Mapping[str, Channel]) -> Structure:
    """Return the structure that a record names, or else the one that its channels suggest."""
    if record.structure in STRUCTURES:
        return STRUCTURES[record.structure]
    if "tau" not in channels:
        return STRUCTURES["rigid"]
    free = "q_l" in channels and channels["q_l"].moves
    return STRUCTURES["rigid_gearbox" if free else "output_fixed_rigid_gearbox"]


def _stretches(record: Record, channels: Mapping[str, Channel]) -> list[Columns]:
    """Return the channels of a record on even times, cut at its gaps."""
    t, dt = record.t, record.dt
    gap = gap_length(np.diff(t))
    ends = np.flatnonzero(np.diff(t) > gap) + 1
    found = []
    for rows in np.split(np.arange(len(t)), ends):
        if len(rows) < 4:
            continue
        grid = t[rows[0]] + dt * np.arange(int((t[rows[-1]] - t[rows[0]]) / dt + 1.5))
        piece: Columns = {"t": grid}
        valid = np.ones(len(grid), dtype=bool)
        for name in channels:
            known = rows[np.isfinite(record[name][rows])] if name in record else rows[:0]
            if len(known) < 2:
                piece[name] = np.zeros(len(grid))
                valid[:] = False
                continue
            piece[name] = np.interp(grid, t[known], record[name][known])
            near = np.searchsorted(t[known], grid).clip(1, len(known) - 1)
            apart = t[known][near] - t[known][near - 1]
            valid &= (apart < gap) | (name not in USED)
        piece["_valid"] = valid.astype(np.float64)
        found.append(piece)
    return found


USED = ("i", "i_cmd", "tau_m", "tau_cmd", "tau", "q_m", "q_g", "q_l", "dq_m", "dq_l")
"""Channels without which a sample does not count."""


def _motion(piece: Columns, angle: str, view: View, width: int) -> Columns:
    """Return angle, speed and acceleration of a body, smoothed."""
    x = piece[angle]
    if angle == "tau":
        x = x / view.value("k_b", 1.0)
    if angle.startswith("dq_"):
        v, a = _smooth(x, width), _smooth(x, width, 1, view.dt)
        return {"q": np.cumsum(x) * view.dt, "v": v, "a": a}
    speed, acceleration = _smooth(x, width, 1, view.dt), _smooth(x, width, 2, view.dt)
    return {"q": _smooth(x, width), "v": speed, "a": acceleration}


def _smooth(x: Floats, width: int, order: int = 0, dt: float = 1.0) -> Floats:
    return np.asarray(savgol_filter(x, width, 3, deriv=order, delta=dt), dtype=np.float64)


def _gain(width: int, order: int, dt: float, angle: str) -> float:
    """Return the deviation of a smoothed derivative per deviation of a sample."""
    order -= angle.startswith("dq_")
    return float(np.linalg.norm(savgol_coeffs(width, 3, deriv=order, delta=dt)))


def _changes(way: NDArray[np.float64], rest: int) -> int:
    """Return how often a direction changes, or begins again after so many samples of rest."""
    at = np.flatnonzero(way)
    if len(at) < 2:
        return len(at)
    turned = way[at[1:]] != way[at[:-1]]
    return int(np.sum(turned | (np.diff(at) > rest))) + int(at[0] > rest)

