"""A velocity is the slope of its angle, or scaled, or something else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from cjt_gym.gap.recorded.slope import SCALED, integrated, is_noise, is_scaled, is_slope

DT = 2e-3
T = DT * np.arange(5000)
ANGLE = np.sin(3.0 * T) + 0.4 * np.sin(11.0 * T)
SPEED = 3.0 * np.cos(3.0 * T) + 4.4 * np.cos(11.0 * T)


@given(st.floats(0.5, 2.0).filter(lambda x: abs(abs(x - 1.0) - SCALED) > 5e-3))
def test_a_scale_is_found_and_refused(scale: float) -> None:
    factor, _, rest = integrated(scale * SPEED, ANGLE, DT)
    assert factor == pytest.approx(scale, rel=1e-3)
    assert rest < 1e-3
    assert is_slope(scale * SPEED, ANGLE, DT) == (abs(scale - 1.0) < SCALED)


def test_a_late_velocity_is_still_a_slope_and_another_one_is_not() -> None:
    assert is_slope(np.roll(SPEED, 5), ANGLE, DT)
    assert not is_slope(np.cos(5.0 * T), ANGLE, DT)
    noisy = 0.95 * SPEED + np.random.default_rng(1).normal(0.0, 20.0, len(T))
    factor, _, rest = integrated(noisy, ANGLE, DT)
    assert not is_scaled(factor, rest)


def test_a_short_stretch_has_more_than_one_slope() -> None:
    few = slice(0, 60)
    noisy = SPEED + np.random.default_rng(2).normal(0.0, 2.0, len(T))
    factor, _, rest = integrated(noisy[few], ANGLE[few], DT)
    assert rest > 0.0
    assert not is_scaled(factor, rest)


def test_an_angle_that_does_not_move_has_no_slope() -> None:
    assert not is_slope(SPEED, np.zeros_like(ANGLE), DT)


@pytest.mark.parametrize(
    ("noise", "step", "worse"), [(4.0, 0.0, True), (0.3, 0.0, False), (0.3, 0.1, False)]
)
def test_a_velocity_is_noise_where_the_slope_tells_more(
    noise: float, step: float, worse: bool
) -> None:
    angle = np.round(ANGLE / step) * step if step else ANGLE
    slope = savgol_filter(angle, 11, 2, deriv=1, delta=DT)
    speed = SPEED + np.random.default_rng(3).normal(0.0, noise, len(T))
    assert is_slope(speed, angle, DT)
    assert is_noise(speed, slope, angle, DT) == worse
