"""The plots draw into axes of one's own; the holding time is that of the winding."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from cjt_gym.characteristics import (
    characteristic,
    efficiency,
    holding_map,
    holding_time,
    response,
    temperatures,
    torque_limits,
)
from cjt_gym.datasheet import plots
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import JointParameters, load_joint_file


@pytest.fixture(scope="module")
def orange() -> JointParameters:
    return load_joint_file("orange_80_6000").parameters


def test_a_torque_is_held_until_its_heat_is_too_much(orange: JointParameters) -> None:
    """The motor's sinusoidal torque itself brings the winding to its limit at that time."""
    tau, f = 100.0, 5.0
    (time,) = holding_time(orange, [tau], [f])
    gain = float(np.abs(response(orange, np.array([f]))[0][0]))
    t = np.arange(0.0, time, 0.01)
    motor = tau / gain * np.sin(2.0 * np.pi * f * t)
    end = temperatures(orange, motor, 0.01)[-1, 0]
    assert end == pytest.approx(orange.Tmp_WMax, abs=0.5)


def test_what_is_possible_for_ever_and_not_at_all(orange: JointParameters) -> None:
    f = np.array([2.0, 20.0, 60.0])
    limits = torque_limits(orange, f)
    assert np.isinf(holding_time(orange, 0.99 * limits.lasting, f)).all()
    assert np.isfinite(holding_time(orange, 0.99 * limits.peak, f)).all()
    assert np.isnan(holding_time(orange, 1.01 * limits.peak, f)).all()
    assert (holding_time(orange, 0.9 * limits.peak, f, winding=orange.Tmp_WMax) == 0.0).all()


def test_an_amplitude_below_zero_is_refused(orange: JointParameters) -> None:
    with pytest.raises(ConfigurationError, match="tau, an amplitude, must be >= 0 N m, got -1"):
        holding_time(orange, [3.0, -1.0], 2.0)


def test_the_map_is_what_the_points_are(orange: JointParameters) -> None:
    tau, f = np.geomspace(5.0, 300.0, 9), np.geomspace(1.0, 80.0, 7)
    grid = holding_map(orange, tau, f, winding=60.0)
    exact = holding_time(orange, tau[None, :], f[:, None], winding=60.0)
    np.testing.assert_array_equal(np.isnan(grid), np.isnan(exact))
    np.testing.assert_array_equal(np.isinf(grid), np.isinf(exact))
    finite = np.isfinite(exact)
    assert finite.sum() > 10
    np.testing.assert_allclose(grid[finite], exact[finite], rtol=0.01)


def test_efficiency_curves_are_cuts_through_the_map(orange: JointParameters) -> None:
    axes = Figure().subplots()
    plots.efficiency_curves(axes, orange, [2.0, 4.0])
    for line, speed in zip(axes.lines[:2], (2.0, 4.0), strict=True):
        tau, values = line.get_xdata(), line.get_ydata()
        np.testing.assert_allclose(values, 100.0 * efficiency(orange, tau, np.float64(speed)))
    for bad in (0.0, math.nan):
        with pytest.raises(ConfigurationError, match="speeds must be finite and > 0"):
            plots.efficiency_curves(axes, orange, [bad])


@pytest.mark.parametrize(
    "name", ["torque_speed", "time_held", "final_temperature", "torque_bandwidth"]
)
def test_joints_alone_and_laid_over_each_other(name: str, orange: JointParameters) -> None:
    other = load_joint_file("lemon_50_6000").parameters
    for joints in (orange, [orange, other]):
        axes = Figure().subplots()
        getattr(plots, name)(axes, joints)
        assert axes.get_ylabel()
        assert axes.lines


def test_maps_return_what_a_colorbar_takes(orange: JointParameters) -> None:
    figure = Figure()
    for axes, draw in zip(
        figure.subplots(1, 3),
        (plots.efficiency_map, plots.holding, plots.torque_with_load),
        strict=True,
    ):
        figure.colorbar(draw(axes, orange), ax=axes)
    assert characteristic(orange, "t_r") > 0.0
    axes = Figure().subplots()
    plots.impedance(axes, orange)
    assert axes.lines
