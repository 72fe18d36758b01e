"""Diagnoses that several files of tests look at."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap import Diagnosis, diagnose
from tests.gap.simulator import nominal, simulate


def shaken(t: float, q: float, v: float) -> float:
    """Return a torque that is in no effect table [N m]."""
    return 2.0 * float(np.sin(2.0 * np.pi * 23.0 * t))


@pytest.fixture(scope="session")
def explained() -> Diagnosis:
    record = simulate(seconds=3.0, friction=(2.6, 1.9))
    return diagnose(record, nominal(), validate=simulate(seconds=3.0, seed=1, friction=(2.6, 1.9)))


@pytest.fixture(scope="session")
def clean() -> Diagnosis:
    return diagnose(simulate(seconds=2.0), nominal())


@pytest.fixture(scope="session")
def unexplained() -> Diagnosis:
    return diagnose(simulate(seconds=2.0, extra=shaken), nominal())
