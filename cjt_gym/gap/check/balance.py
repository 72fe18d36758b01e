"""Torque balance of a body, and the smallest identifiable size of its terms.

    y = I a + d v + F sgn(v) + c + ...

The smallest size of a term follows from the part of its column that is orthogonal to the columns it
must be distinguished from, and from the scatter of the balance: plain least squares, without
fitting a model of the joint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.arrays import Floats

Bools = NDArray[np.bool_]
RELIABLE = 10.0
"""Size of an identifiable term, in standard deviations: 5 would do for white noise, but the
residual of a real joint is never quite white."""
SYSTEMATIC = 0.005
"""Share of the balance due to its systematic errors, which hide smaller terms."""
PER_PERIOD = 4.0
"""Fewest samples per period of a torque periodic in the angle."""
FEWEST = 50
"""Fewest moving samples of a body that can be evaluated."""


@dataclass(frozen=True, eq=False)
class Balance:
    """Torque balance of one body while it moves."""

    y: Floats  # torque required by its motion [N m], shape (N,)
    # terms by name, each of shape (N,): ``a``, ``v``, ``s`` (direction), ``one``, ``q``, and other
    # quantities known at these samples
    columns: Mapping[str, Floats]
    scatter: float  # standard deviation of a smoothed sample of y about its terms [N m]
    width: int  # number of samples of the smoothing window
    level: float  # 95 % quantile of the motor or load torque that drives the body [N m]
    # whether nothing drives it, so that y is the torque of the datasheet's inertia
    coasts: bool = False
    _left: dict[tuple[str, ...], Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.y)

    def __getitem__(self, name: str) -> Floats:
        return self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    @property
    def inertia(self) -> float:
        """Inertia that it shows, beside friction and a constant torque [kg m^2]."""
        return float(factors(self.y, [self[name] for name in ("a", "v", "s", "one")])[0])

    def least(self, term: Floats, against: Sequence[str]) -> float:
        """Return the smallest identifiable factor of a term [N m per unit of the term].

        Args:
            term: The term's column, shape (N,).
            against: Names of the columns that it must be distinguished from.
        """
        basis = self._basis(tuple(against))
        left = term - basis @ (basis.T @ term)
        power = float(left @ left)
        if power <= 1e-18 * max(float(term @ term), 1e-300):
            return float("inf")
        chance = RELIABLE * self.scatter * np.sqrt(self.width / power)
        usual = SYSTEMATIC * float(np.sqrt(np.mean(self.y**2) / (power / len(term))))
        return float(max(chance, usual))

    def apart(self, term: Floats, against: Sequence[str]) -> float:
        """Return the share of a term that is orthogonal to the named columns."""
        basis = self._basis(tuple(against))
        left = term - basis @ (basis.T @ term)
        return float(np.sqrt((left @ left) / max(float(term @ term), 1e-300)))

    def slow(self, f: float, dt: float) -> Bools:
        """Return where motion is slow enough to resolve a torque periodic in the angle.

        Args:
            f: Its frequency [rad/rad].
            dt: Sample time [s].
        """
        samples = max(self.width, PER_PERIOD)
        return np.asarray(np.abs(self.columns["v"]) * f * dt * samples < 2.0 * np.pi)

    def _basis(self, names: tuple[str, ...]) -> Floats:
        """Return an orthonormal basis of some columns, shape (N, rank)."""
        if names not in self._left:
            self._left[names] = orthonormal([self.columns[name] for name in names], len(self))
        return self._left[names]


def orthonormal(columns: Sequence[Floats], length: int) -> Floats:
    """Return an orthonormal basis of given columns, shape (length, rank)."""
    scaled = [x / np.linalg.norm(x) for x in columns if float(x @ x) > 0.0]
    if not scaled:
        return np.zeros((length, 0))
    matrix = np.column_stack(scaled)
    power, ways = np.linalg.eigh(matrix.T @ matrix)
    used = power > 1e-11 * power[-1]
    return np.asarray(matrix @ (ways[:, used] / np.sqrt(power[used])))


def factors(y: Floats, columns: Sequence[Floats]) -> Floats:
    """Return the least-squares coefficients of y on columns, shape (columns,)."""
    size = np.array([max(float(np.linalg.norm(x)), 1e-300) for x in columns])
    matrix = np.column_stack(columns) / size
    found = np.linalg.lstsq(matrix.T @ matrix, matrix.T @ y, rcond=1e-12)[0]
    return np.asarray(found / size)


def slope(x: Floats, y: Floats) -> float:
    """Return the slope of y over x by least squares; 0 where x does not change."""
    x = x - x.mean()
    power = float(x @ x)
    return float(x @ y) / power if power > 0.0 else 0.0


def left_over(y: Floats, columns: Sequence[Floats]) -> float:
    """Return the standard deviation of y after projecting out columns."""
    basis = orthonormal(columns, len(y))
    return float(np.std(y - basis @ (basis.T @ y)))
