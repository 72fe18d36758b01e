"""What is found of a case: how several joints predict, and which is the answer."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

from cjt_gym.gap.diagnosis import Horizon
from cjt_gym.gap.horizons.fitting.fit import Problem
from cjt_gym.gap.horizons.fitting.uncertainty import Spread, spread_of
from cjt_gym.gap.horizons.prediction.case import Case
from cjt_gym.gap.horizons.prediction.predictable import Predictable
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, TRIVIAL
from cjt_gym.gap.horizons.selection.search_result import Found
from cjt_gym.gap.horizons.selection.worth import Worth
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

NEAR = 0.2
"""Relative error above which a search looks for a better joint than that of the stages."""
SLIGHT, CLOSE = 0.1, 1.3
"""Relative error, and its ratio to its floor, below which it is nearly as small as it could be."""
NEGLIGIBLE = 0.01
"""Relative error up to which it does not matter how much smaller it could be. Of 84 numbers of
rough logs as many intervals cover as where all errors count."""
LOUD = 0.6
"""Relative error, except at the shortest horizon, above which nothing counts as explained."""
LEFT_SHARE, LEFT_CLEAR = 0.3, 3.0
"""Share of an error, and number of its deviations, above which it counts as predictable."""


@dataclass(frozen=True)
class Row(Horizon):
    """One row of the table of horizons; 0 s stands for a whole piece of a held output.

    Attributes:
        left: Predictable part of the answer's error.
    """

    left: Predictable | None

    @property
    def unexplained(self) -> bool:
        """Whether the remaining error is clearly above the unpredictable part."""
        return self.left is not None and is_left(self.found, self.left)

    @property
    def near_floor(self) -> bool:
        """Whether a small error is nearly as small as it could be."""
        return self.found < SLIGHT and self.floor is not None and self.found < CLOSE * self.floor

    @property
    def lasting(self) -> bool:
        """Whether the errors just before predict the error best."""
        return self.left is not None and self.left.lasting


@dataclass(frozen=True, eq=False)
class Judgement:
    """Predictions of several joints, and which joint is the answer.

    Attributes:
        case: The records.
        answer: "datasheet", "least squares", "stages" or "found".
        joint: The joint that is the answer.
        rows: The table of horizons.
        found: Result of the search, if there was one.
        tests: Worth of each term of the search on held-out data.
        problem: The problem that the search was fitted to.
        contradicted: How held-out records contradict those that were fitted, if they do.
        errors: Errors of each joint that was judged, on held-out data.
    """

    case: Case
    answer: str
    joint: Joint
    rows: tuple[Row, ...]
    found: Found | None = None
    tests: tuple[Worth, ...] = ()
    problem: Problem | None = None
    contradicted: str = ""
    errors: dict[str, list[Floats]] = field(default_factory=dict)

    @cached_property
    def spread(self) -> Spread:
        """How certain the numbers of the search are, by all windows that determine them."""
        assert self.found is not None
        fit, fine = self.found.fit, Problem(self.case.fine, count=self.case.fit.count)
        spread = spread_of(fine, replace(fit, errors=fine.errors(fit.model, fit.z)))
        return spread.wider(self.misfit)

    @property
    def misfit(self) -> float:
        """The largest ratio of an error to what is unpredictable, Birge's ratio; at least one.

        What a model lacks shifts its numbers. How far is not known, but hardly less than in
        proportion to the errors that it leaves. Errors that are faint do not count.
        """
        ratios = [r.found / r.floor for r in self.rows if r.floor and r.found > NEGLIGIBLE]
        return max([1.0, *ratios])

    @property
    def cut_by_torque(self) -> bool:
        """Whether a measured torque cuts the joint into stages."""
        return self.case.cut is Cut.BY_TORQUE

    @property
    def unexplained(self) -> tuple[Row, ...]:
        """Rows with a predictable remaining error.

        An error at the shortest horizon alone comes from the measured start and does not count if
        everything further ahead is predicted, or nearly as well as it could be.
        """
        return () if self.exhausted else tuple(row for row in self.rows if row.unexplained)

    @property
    def exhausted(self) -> bool:
        """Whether everything beyond the shortest horizon is predicted nearly as well as can be."""
        further = [row for row in self.rows if row.seconds != min(HORIZONS)]
        return bool(further) and all(row.found < TRIVIAL or row.near_floor for row in further)


def is_left(error: float, one: Predictable) -> bool:
    """Return whether an error is clearly above its unpredictable part."""
    return error > TRIVIAL and one.share > LEFT_SHARE and one.share > LEFT_CLEAR * one.deviation
