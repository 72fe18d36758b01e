"""The real EMPS drive in closed loop: the errors stay what they were measured to be.

Published, for the same parameters: 5.848 %, 0.22911 %, 0.013752 % on the first record; 8.9409 %,
0.47888 %, 0.0080248 % on the one with pulses.
"""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.training.demo.emps import relative, replay, summary

MEASURED = {
    "emps": {"force": 4.5598, "velocity": 0.12489, "position": 0.00109},
    "emps_pulses": {"force": 5.2581, "velocity": 0.17783, "position": 0.00157},
}


@pytest.mark.parametrize("name", MEASURED)
def test_errors_are_as_measured_and_below_the_published_ones(name: str) -> None:
    result = replay(name)
    for signal, error in result.errors().items():
        assert error == pytest.approx(MEASURED[name][signal], rel=0.01)
        assert error < result.published[signal]
    assert f"{result.published['force']:.5f}" in summary(result)


@pytest.mark.slow
def test_a_continuous_controller_comes_close_to_the_published_errors() -> None:
    errors = replay("emps", continuous=True).errors()
    assert errors["force"] == pytest.approx(5.848, rel=0.03)
    assert errors["velocity"] == pytest.approx(0.22911, rel=0.06)


def test_the_relative_error() -> None:
    assert relative(np.array([3.0, 4.0]), np.array([3.0, 3.0])) == pytest.approx(20.0)
