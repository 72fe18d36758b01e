"""A short soak over random joints and effects; `make soak` runs a long one."""

from __future__ import annotations

import pytest

from tests.physics.soak import soak


@pytest.mark.parametrize(
    ("substeps", "seed"), [(100_000, 0), pytest.param(2_000_000, 1, marks=pytest.mark.slow)]
)
def test_nothing_runs_away_and_no_energy_comes_from_nothing(substeps: int, seed: int) -> None:
    tally = soak(substeps, seed)
    assert tally.substeps >= substeps
    assert len(tally.cases) == 4, "every kind of check is met"
    assert not tally.failures, "\n".join(tally.failures)
