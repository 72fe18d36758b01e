"""Uncertainty of the numbers of a joint file, from that of the coordinates of a fit."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.gap.diagnosis import Interval
from cjt_gym.gap.digits import short
from cjt_gym.gap.horizons.fitting.uncertainty import Spread
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.stages.intervals import TENFOLD
from cjt_gym.joint import EFFECTS
from cjt_gym.joint.files.effect_entries import unit_on
from cjt_gym.joint.kernel.arrays import Floats

STEP = 0.01
"""Step of a coordinate for finite-difference slopes, in units of its scale."""
VAGUE = 4.0
"""Width of an interval, relative to the number, from which it says nothing about its size."""
ANGLES, TURNED = frozenset({"gravity.angle"}), 1.0
"""Numbers whose size is none, and the width of their intervals from which they are vague [rad]."""
PASSED = np.linspace(-1.0, 1.0, 9)
"""Places on the way from one end of an interval to the other where a number is taken."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Numbers of effects changed by a fit, and their dependence on its coordinates.

    A number of the file need not be one of the fit: damping in the negative direction is fitted as
    a difference, gravity as two components.

    Attributes:
        spread: Covariance of the coordinates.
        names: "effect.symbol" of each number.
        values: Values of the numbers, shape (n,).
        slopes: Derivatives with respect to the coordinates, shape (n, coordinates).
    """

    spread: Spread
    names: tuple[str, ...]
    values: Floats
    slopes: Floats

    @classmethod
    def of(cls, spread: Spread) -> Scatter:
        """Return the numbers of a fit."""
        z = spread.fit.z
        middle = _numbers(spread.model, z)
        slopes = np.zeros((len(middle), len(z)))
        for k, ahead in enumerate(STEP * np.eye(len(z))):
            up, down = (_numbers(spread.model, x) for x in (z + ahead, z - ahead))
            slopes[:, k] = [(up[n] - down[n]) / (2.0 * STEP) for n in middle]
        moved = np.flatnonzero(slopes.any(axis=1))
        names, values = list(middle), np.array(list(middle.values()))
        return cls(spread, tuple(names[k] for k in moved), values[moved], slopes[moved])

    @property
    def matrix(self) -> Floats:
        """Covariance of the numbers, shape (n, n)."""
        return np.asarray(self.slopes @ self.spread.matrix @ self.slopes.T)

    def intervals(self) -> dict[str, Interval]:
        """Return the 95 % intervals, along the most probable change of the coordinates.

        A number need not change evenly: the weight that two components have falls to zero between
        opposite angles.
        """
        z, found = self.spread.fit.z, {}
        for name, value, slope in zip(self.names, self.values, self.slopes, strict=True):
            way = self.spread.matrix @ slope
            way *= self.spread.factor / np.sqrt(max(float(slope @ way), 1e-300))
            passed = [_numbers(self.spread.model, z + s * way)[name] for s in PASSED]
            found[name] = Interval(float(value), min(passed), max(passed), "")
        return found

    def untold(self, named: Collection[str]) -> frozenset[str]:
        """Return the numbers that the record leaves open; of named effects only the vaguest.

        A fit that needs them ends at a bound, or anywhere within a factor of ten: such a number
        predicts as well as others, but it was not found. That of a named effect is vague if its
        interval is several times as wide as it is large. A number that only the scale of all
        torques leaves open is not one of them.
        """
        model, z, known_scale = self.spread.model, self.spread.fit.z, self.spread.at_scale
        found: set[str] = set()
        for index, term in enumerate(model.terms):
            span, known = model.span(index), known_scale.intervals(index)
            for number, at in zip(term.numbers, range(span.start, span.stop), strict=True):
                one = known[number.symbol]
                wide = number.log and one.high > TENFOLD * one.low
                if wide or number.at_bound(float(z[at])):
                    found |= {self.names[k] for k in np.flatnonzero(self.slopes[:, at])}
        vague = {
            name
            for name, one in replace(self, spread=known_scale).intervals().items()
            if one.high - one.low > (TURNED if name in ANGLES else VAGUE * abs(one.value)) > 0.0
        }
        return frozenset(n for n in found if n.split(".")[0] not in named) | vague

    def of_effect(self, name: str) -> dict[str, Interval]:
        """Return the intervals of an effect's numbers, by their symbols in the effect table."""
        found = {}
        for key, one in self.intervals().items():
            effect, symbol = key.split(".")
            if effect == name and (parameter := EFFECTS[name].parameter(symbol)) is not None:
                unit = unit_on(parameter, self.spread.model.joint.parameters)
                found[symbol] = replace(one, unit=unit)
        return found

    def table(self, left_out: Collection[str] = ()) -> dict[str, object]:
        """Return the entries for a joint file, without some of the numbers."""
        kept = [k for k, name in enumerate(self.names) if name not in left_out]
        return {
            "names": tuple(self.names[k] for k in kept),
            "values": tuple(short(self.values[k]) for k in kept),
            "matrix": tuple(tuple(map(short, row)) for row in self.matrix[np.ix_(kept, kept)]),
        }


def _numbers(model: Model, z: Floats) -> dict[str, float]:
    """Return the numbers of the effects at given coordinates."""
    return {
        f"{name}.{symbol}": float(value)
        for name, values in model.draft(z).effects.items()
        for symbol, value in values.items()
        if isinstance(value, int | float)
    }
