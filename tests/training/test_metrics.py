"""Figures of merit on signals whose figures are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from cjt_gym.training.evaluation import metrics
from cjt_gym.training.evaluation.conditions import SWEEP, bandwidth_reference
from cjt_gym.training.evaluation.rollout import Traces

Floats = NDArray[np.float64]
DT = 1e-3


def traces(reference: Floats, tau: Floats, noise: Floats | float = 0.0, **given: Floats) -> Traces:
    command = given.get("command", reference)
    ended = np.zeros(tau.shape, dtype=np.bool_)
    return Traces(reference, tau, tau + noise, command, ended, DT)


def test_errors_of_a_constant_offset() -> None:
    reference = np.full((3, 100), 4.0)
    run = traces(reference, reference - 2.0, command=np.full((3, 100), -3.0))
    assert metrics.rmse(run) == pytest.approx(2.0)
    assert metrics.nrmse(run) == pytest.approx(0.5)
    assert metrics.effort_rms(run) == pytest.approx(3.0)
    assert metrics.bootstrap_rmse(run) == pytest.approx((2.0, 2.0))
    assert math.isnan(metrics.nrmse(traces(0.0 * reference, reference)))


def test_bandwidth_of_a_first_order_lag() -> None:
    """Its gain falls 3 dB at its corner."""
    t = DT * np.arange(1, round(SWEEP / DT) + 1)
    reference = bandwidth_reference(5.0).torque(t)[None]
    corner = 25.0
    pole = math.exp(-2.0 * math.pi * corner * DT)
    tau = signal.lfilter([0.0, 1.0 - pole], [1.0, -pole], reference)
    assert metrics.bandwidth(traces(reference, tau), 1.0, 150.0) == pytest.approx(corner, rel=0.05)
    assert metrics.bandwidth(traces(reference, reference), 1.0, 150.0) == 150.0


def test_step_figures_of_a_second_order_system() -> None:
    """Overshoot exp(-pi z / sqrt(1 - z^2)); within 10 % after the second extremum for z = 0.5."""
    z, w = 0.5, 40.0
    t = np.arange(1, 501) * DT
    damped = w * math.sqrt(1.0 - z * z)
    phase = math.atan2(damped, z * w)
    response = 1.0 - np.exp(-z * w * t) * np.sin(damped * t + phase) / math.sin(phase)
    tau = np.concatenate([3.0 * response, 3.0 * (1.0 - 2.0 * response)])[None]
    reference = np.repeat([3.0, -3.0], 500)[None]
    run = traces(reference, tau)
    expected = math.exp(-math.pi * z / math.sqrt(1.0 - z * z))
    assert metrics.overshoot(run) == pytest.approx(expected, rel=1e-3)
    outside = np.flatnonzero(np.abs(response - 1.0) > 0.1)[-1]
    assert metrics.settling_time(run) == pytest.approx((outside + 1) * DT)


def test_steps_that_never_settle_are_infinite_and_no_steps_are_nan() -> None:
    reference = np.full((1, 100), 2.0)
    assert metrics.settling_time(traces(reference, 0.5 * reference)) == math.inf
    nothing = traces(np.zeros((1, 100)), np.zeros((1, 100)))
    assert math.isnan(metrics.settling_time(nothing))
    assert math.isnan(metrics.overshoot(nothing))


def test_noise_amplification_of_a_gain() -> None:
    rng = np.random.default_rng(0)
    noise = 0.1 * rng.normal(size=(4, 5000))
    zero = np.zeros_like(noise)
    run = traces(zero, zero, noise, command=-3.0 * noise)
    assert metrics.noise_amplification(run) == pytest.approx(3.0, rel=1e-2)
    assert math.isnan(metrics.noise_amplification(traces(zero, zero)))


def test_paired_bootstrap_is_narrow_where_episodes_differ_alike() -> None:
    rng = np.random.default_rng(0)
    size = rng.uniform(1.0, 10.0, size=(40, 1))
    error = size * rng.normal(size=(40, 200))
    zero = np.zeros_like(error)
    ratio, low, high = metrics.bootstrap_ratio(traces(zero, 0.7 * error), traces(zero, error))
    assert (ratio, low, high) == pytest.approx((0.7, 0.7, 0.7))
