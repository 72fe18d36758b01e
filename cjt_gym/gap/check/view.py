"""A record viewed as moving bodies: their measured channels, balances, travel and speed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cjt_gym.gap.check.balance import FEWEST, Balance
from cjt_gym.gap.check.body import Body
from cjt_gym.gap.check.channels import Channel, channels_of
from cjt_gym.gap.check.pieces import Columns, changes, gain, stretches
from cjt_gym.gap.recorded.bridged import bridged
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.gap.recorded.listed import as_values
from cjt_gym.joint import STRUCTURES, JointFile, Structure, get_structure
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record

WIDTHS = (5, 7, 9, 13, 17, 25, 37, 53, 75, 101)
"""Candidate smoothing windows, in samples."""
LONGEST = 0.3
"""Longest smoothing window [s]."""
MOTION = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
STILL = 10.0
"""Range of a channel at rest, in standard deviations of its noise: white noise spans 8 to 10."""
REST = 0.1
"""Time without motion after which a body is at rest [s]."""


@dataclass(frozen=True, eq=False)
class View:
    """Records of one joint, ready to be examined."""

    records: tuple[Record, ...]
    joint: JointFile | None  # the nominal joint; None if unknown
    structure: Structure
    channels: Mapping[str, Channel]  # properties of each channel of the longest record
    logged: tuple[Record, ...]  # as they were logged, before short gaps were filled

    @classmethod
    def of(
        cls, records: Sequence[Record], joint: JointFile | None, structure: Structure | None
    ) -> View:
        """Return the view of one or several records, the short gaps of which are filled."""
        logged, (records, _) = tuple(records), bridged(records)
        longest = max(records, key=len)
        channels = channels_of(records, joint)
        shape = structure or _likely(longest, channels, joint)
        known = None if joint is None else as_values(joint, shape)
        return cls(records, known, shape, channels, logged)

    def __contains__(self, name: object) -> bool:
        """Return whether a channel exists and moves."""
        return name in self.channels and self.channels[str(name)].moves

    # ---- values of the joint file
    def value(self, symbol: str, default: float = 0.0) -> float:
        """Return a parameter of the joint, or the default if absent."""
        return default if self.joint is None else self.joint.parameters.get(symbol, default)

    @property
    def ratio(self) -> float:
        """Gear ratio; 1 if unknown."""
        return self.value("n", 1.0)

    @property
    def torque_per_input(self) -> float:
        """Link-side torque per unit of the motor's input; unknown factors count as 1."""
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

    @property
    def inertia_unit(self) -> str:
        """Unit of the inertias."""
        return "kg" if self.records[0].prismatic else "kg m^2"

    @property
    def stiffness_unit(self) -> str:
        """Unit of the stiffnesses."""
        return "N/m" if self.records[0].prismatic else "N m/rad"

    # ---- available channels
    @property
    def dt(self) -> float:
        """Usual sample time [s]."""
        return max(self.records, key=len).dt

    @property
    def seconds(self) -> float:
        """Duration of the longest record [s]."""
        return max(float(record.t[-1] - record.t[0]) for record in self.records)

    @cached_property
    def drive(self) -> str | None:
        """The channel that represents the motor's torque, or None."""
        names = ("i", "tau_m", "i_cmd", "tau_cmd", "v")
        return next((name for name in names if name in self.channels), None)

    @cached_property
    def command(self) -> str | None:
        """The channel of the command to the drive, or None."""
        found = next((name for name in ("i_cmd", "tau_cmd") if name in self.channels), None)
        return found or ("v" if self.drive == "v" else None)

    @property
    def cut(self) -> bool:
        """Whether the measured torque separates the motor side from the load."""
        return self.structure.has_spring and "tau" in self

    @cached_property
    def motor_angle(self) -> str | None:
        """The channel of the motor's motion: an angle, a velocity, or tau; or None."""
        bodies = body_group(self.structure, "m")
        names = [*(f"q_{b}" for b in bodies), *(f"dq_{b}" for b in bodies)]
        found = next((name for name in names if name in self.channels), None)
        held = self.structure.output_fixed and "tau" in self.channels
        return found or ("tau" if held and self.value("k_b", 1.0) > 0.0 else None)

    @cached_property
    def load_angle(self) -> str | None:
        """The channel of the load's motion, or None."""
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
        """Evenly sampled channels between the gaps, longest first, without short pieces."""
        found = [piece for record in self.records for piece in stretches(record, self.channels)]
        found.sort(key=lambda piece: -len(piece["t"]))
        return tuple(piece for piece in found if len(piece["t"]) >= FEWEST) or tuple(found[:1])

    # ---- bodies
    @cached_property
    def motor_body(self) -> Body | None:
        """The motor side, or all bodies if no torque in a spring cuts them; None without motion."""
        if self.motor_angle is None:
            return None
        return self._motor_body(self.motor_angle, apart=self.parted)

    def _motor_body(self, angle: str, *, apart: bool) -> Body:
        power = (self.torque_per_input * self._noise(self.drive)) ** 2
        power += self._through_noise**2 if apart else 0.0
        torque = self._own_torque if apart else self._whole_torque
        body = self._body(angle, torque, float(np.sqrt(power)), self._inertias(apart=apart))
        return body if apart or not self.wound else replace(body, through=lambda _: None)

    @cached_property
    def parted(self) -> bool:
        """Whether the torque in the spring cuts the motor side from the load.

        That of a deflection does where the motor's acceleration shows better so than that of all.
        """
        if not self.wound or self.motor_angle is None or self.drive is None:
            return self.cut
        bodies = [self._motor_body(self.motor_angle, apart=apart) for apart in (True, False)]
        one, two = (max(self._sharpness(body, w) for w in self._widths) for body in bodies)
        return one > two

    @cached_property
    def motor(self) -> Balance | None:
        """The torque balance of that body, or None."""
        if self.motor_body is None or self.drive is None:
            return None
        return self.motor_body.balance(self.width)

    @cached_property
    def load(self) -> Balance | None:
        """The torque balance of a free load whose torque is known, or None."""
        angle = self.load_angle if self.structure.has_spring else self.motor_angle
        known = "tau" in self or self.wound
        if self.structure.output_fixed or not known or angle is None:
            return None
        torque, noise = self._load_torque, self._through_noise
        return self._body(angle, torque, noise, ("I_l",)).balance(self.width)

    @property
    def wound(self) -> bool:
        """Whether the spring's torque is not measured but follows from its two angles."""
        ends = self.structure.has_spring and {"q_m", "q_l"} <= self.channels.keys()
        return ends and "tau" not in self and self.value("k_b") > 0.0

    @property
    def _through_noise(self) -> float:
        """Deviation of a sample of the torque through the joint [N m]."""
        ends = self._noise("q_m") + self._noise("q_l")
        return self.value("k_b") * ends if self.wound else self._noise("tau")

    def _noise(self, name: str | None) -> float:
        """Return the deviation of a sample of a channel; 0 for a command or an absent channel."""
        if name is None or name not in self.channels or name.endswith("_cmd"):
            return 0.0
        return self.channels[name].noise

    def angle_noise(self, angle: str) -> float:
        """Return the deviation of a sample of an angle; tau is converted to an angle."""
        return self._noise(angle) / (self.value("k_b", 1.0) if angle == "tau" else 1.0)

    @property
    def inertias(self) -> tuple[str, ...]:
        """The inertias that the motor's balance contains."""
        return self._inertias(apart=self.parted)

    def _inertias(self, *, apart: bool) -> tuple[str, ...]:
        alone = self.structure.output_fixed or apart
        return ("I_m", "I_g") if alone else ("I_m", "I_g", "I_l")

    def _body(
        self,
        angle: str,
        torque: Callable[[Columns], Floats],
        noise: float,
        moved: Sequence[str],
    ) -> Body:
        return Body(
            self.stretches,
            self.dt,
            angle,
            self.angle_noise(angle),
            self.value("k_b", 1.0),
            torque,
            noise,
            self.driving,
            self._through,
            sum(self.value(name) for name in moved) or 1.0,
        )

    def driving(self, piece: Columns) -> Floats:
        """Return the motor's torque, from the channels of a stretch."""
        if self.drive is None:
            return np.zeros(len(piece["t"]))
        return np.asarray(self.torque_per_input * piece[self.drive])

    def motor_torque(self, piece: Columns) -> Floats:
        """Return the torque that moves the motor side, from the channels of a stretch."""
        return self._own_torque(piece) if self.parted else self._whole_torque(piece)

    def _own_torque(self, piece: Columns) -> Floats:
        through = self._through(piece)
        assert through is not None
        return np.asarray(self.driving(piece) - through)

    def _whole_torque(self, piece: Columns) -> Floats:
        return np.asarray(self.driving(piece) + piece.get("tau_l", 0.0))

    def _through(self, piece: Columns) -> Floats | None:
        """Return the torque through the joint, measured or of its spring's deflection, if known."""
        if self.wound:
            return np.asarray(self.value("k_b") * (piece["q_m"] - piece["q_l"]))
        return piece.get("tau")

    def _load_torque(self, piece: Columns) -> Floats:
        through = self._through(piece)
        assert through is not None
        return np.asarray(through + piece.get("tau_l", 0.0))

    def at_motion(self, values: Callable[[Columns], Floats], earlier: float = 0.0) -> Floats:
        """Return a quantity at the samples of the motor's balance, shape (N,).

        Args:
            values: Returns the quantity over a stretch.
            earlier: Time by which it is taken before the motion [s].
        """
        assert self.motor is not None
        out = np.zeros(len(self.motor))
        for k, piece in enumerate(self.stretches):
            own = self.motor["stretch"] == k
            if own.any():
                at = self.motor["time"][own] - earlier
                out[own] = np.interp(at, piece["t"], values(piece))
        return out

    # ---- motion
    @cached_property
    def travel(self) -> tuple[float, float]:
        """Total travel of the motor in the positive and in the negative direction."""
        up = down = 0.0
        for motion in self._motions:
            change = np.diff(motion["q"])
            up, down = up + change[change > 0.0].sum(), down - change[change < 0.0].sum()
        return float(up), float(down)

    @cached_property
    def both_ways(self) -> tuple[float, float]:
        """Share of the moving samples in the positive and in the negative direction."""
        if self.motor is None:
            return 0.0, 0.0
        up = float(np.mean(self.motor["s"] > 0.0))
        return up, 1.0 - up

    @cached_property
    def speeds(self) -> tuple[float, float]:
        """10 % and 90 % quantiles of the motor's speed while it moves."""
        if self.motor is None:
            return 0.0, 0.0
        low, high = np.quantile(np.abs(self.motor["v"]), [0.1, 0.9])
        return float(low), float(high)

    @property
    def at_rest(self) -> bool:
        """Whether no angle, velocity or torque leaves its noise."""
        moved = [c for n, c in self.channels.items() if n in MOTION]
        return bool(moved) and all(c.span < STILL * c.noise for c in moved)

    @cached_property
    def reversals(self) -> int:
        """Number of times the motor reverses or starts from rest."""
        if self.motor_body is None:
            return 0
        limit, rest = self.motor_body.least_speed(self.width), max(int(REST / self.dt), 3)
        ways = (
            np.where(np.abs(motion["v"]) > limit, np.sign(motion["v"]), 0.0)
            for motion in self._motions
        )
        return sum(changes(way, rest) for way in ways)

    @cached_property
    def _motions(self) -> list[Columns]:
        return [] if self.motor_body is None else self.motor_body.motions(self.width)

    @cached_property
    def width(self) -> int:
        """Samples of the smoothing window, chosen to show the acceleration best."""
        body = self.motor_body
        if body is None:
            return WIDTHS[0]
        return max(self._widths, key=lambda width: self._sharpness(body, width))

    @property
    def _widths(self) -> list[int]:
        longest = max(len(piece["t"]) for piece in self.stretches) // 8
        most = max(min(LONGEST / self.dt, longest), WIDTHS[0])
        return [width for width in WIDTHS if width <= most]

    def _sharpness(self, body: Body, width: int) -> float:
        """Return how well a smoothing window resolves the acceleration above its noise."""
        found = body.balance(width) if self.drive is not None else None
        if found is None:
            return 0.0
        least = found.least(found["a"], ("v", "s", "one"))
        noise = body.angle_noise * gain(width, 2, self.dt, body.angle)
        own = 1.0 - noise**2 / max(float(np.mean(found["a"] ** 2)), 1e-300)
        return max(own, 0.0) / least if least > 0.0 else 0.0


def _likely(record: Record, channels: Mapping[str, Channel], joint: JointFile | None) -> Structure:
    """Return the structure named in a record or joint, or the one suggested by the channels."""
    for name in (record.structure, None if joint is None else joint.structure):
        if name is not None:
            return get_structure(name)
    if "tau" not in channels:
        return STRUCTURES["rigid"]
    free = "q_l" in channels and channels["q_l"].moves
    return STRUCTURES["rigid_gearbox" if free else "output_fixed_rigid_gearbox"]
