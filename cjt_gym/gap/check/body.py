"""A moving body of the joint: the channel of its motion and the torque that moves it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cjt_gym.gap.check.balance import FEWEST, Balance, factors, left_over
from cjt_gym.gap.check.pieces import Columns, gain, motion, smooth
from cjt_gym.joint.kernel.arrays import Floats

MOVING = 3.0
"""Speed above which a body moves, in standard deviations of its noise."""
LEAST_SPEED = 2e-3
"""Speed above which a body moves, relative to its highest speed."""
CLEAN = 3.0
"""Factor by which the scatter of a balance may exceed that due to the noise of its channels."""


@dataclass(frozen=True, eq=False)
class Body:
    """One body of a joint, or several that move as one."""

    pieces: Sequence[Columns]  # the stretches of the log
    dt: float  # sample time [s]
    angle: str  # the channel of its motion
    angle_noise: float  # standard deviation of a sample of its angle
    stiffness: float  # stiffness of the spring to a held output, if the torque represents the angle
    # returns the torque that moves it, from the channels of a stretch
    torque: Callable[[Columns], Floats]
    torque_noise: float  # standard deviation of a sample of that torque
    # returns the motor's torque, from the channels of a stretch
    driving: Callable[[Columns], Floats]
    # returns the torque through the joint likewise, None where it is not known
    through: Callable[[Columns], Floats | None]
    inertia: float  # of the datasheet [kg m^2]; 1 if unknown

    def motions(self, width: int) -> list[Columns]:
        """Return its smoothed motion for each stretch that is long enough."""
        long = (piece for piece in self.pieces if len(piece["t"]) > 2 * width)
        return [motion(piece, self.angle, self.stiffness, width) for piece in long]

    def speed(self, piece: Columns, width: int) -> Floats:
        """Return its smoothed speed over a stretch, shape (N,)."""
        return motion(piece, self.angle, self.stiffness, width)["v"]

    def least_speed(self, width: int) -> float:
        """Return the speed above which it moves."""
        fastest = max((float(np.abs(m["v"]).max()) for m in self.motions(width)), default=0.0)
        noise = MOVING * self.angle_noise * gain(width, 1, self.dt, self.angle)
        return float(max(LEAST_SPEED * fastest, noise, 1e-300))

    def balance(self, width: int) -> Balance | None:
        """Return its torque balance while it moves; None if it hardly does."""
        limit = self.least_speed(width)
        parts = [
            self._part(k, piece, width, limit)
            for k, piece in enumerate(self.pieces)
            if len(piece["t"]) > 2 * width
        ]
        if not parts:
            return None
        joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        y = joined.pop("y")
        if len(y) < FEWEST:
            return None
        joined |= {"s": np.sign(joined["v"]), "one": np.ones(len(y))}
        if coasts := float(np.quantile(np.abs(y), 0.95)) == 0.0:
            joined = {name: x[y == 0.0] for name, x in joined.items()}
            y = joined["u"] = -self.inertia * joined["a"]  # what the others are compared with
        level = max(float(np.quantile(np.abs(joined[name]), 0.95)) for name in ("u", "pushed"))
        scatter = self._scatter(y, joined, width, coasts)
        return Balance(y, joined, scatter, width, level, coasts)

    def _part(self, k: int, piece: Columns, width: int, limit: float) -> Columns:
        """Return the columns of a stretch where the body moves."""
        found = motion(piece, self.angle, self.stiffness, width)
        found |= {"y": smooth(self.torque(piece), width), "u": smooth(self.driving(piece), width)}
        found["pushed"] = smooth(piece.get("tau_l", np.zeros(len(piece["t"]))), width)
        if (through := self.through(piece)) is not None:
            found["tau"] = smooth(through, width)
        found |= {"time": piece["t"], "stretch": np.full(len(piece["t"]), float(k))}
        moving = (np.abs(found["v"]) > limit) & (smooth(piece["valid"], width) > 0.5)
        moving[: width // 2] = moving[-(width // 2) :] = False
        return {name: x[moving] for name, x in found.items()}

    def _scatter(self, y: Floats, columns: Columns, width: int, coasts: bool) -> float:
        """Return the scatter of a balance: its residual, limited to a multiple of the noise."""
        plain = [columns[name] for name in ("a", "v", "s", "one")]
        plain = plain[1:] if coasts else plain
        v = columns["v"]
        quick = max(float(np.quantile(np.abs(v), 0.9)), 1e-300)
        slow = np.exp(-np.abs(v) / (0.1 * quick)) * columns["s"]
        left = left_over(y, [*plain, np.abs(v), v * np.abs(v), slow])
        inertia = self.inertia if coasts else float(factors(y, plain)[0])
        shaken = inertia * self.angle_noise * gain(width, 2, self.dt, self.angle)
        noise = float(np.hypot(shaken, self.torque_noise / np.sqrt(width)))
        return max(min(left, CLEAN * noise), 1e-12 * float(np.std(y)), 1e-300)
