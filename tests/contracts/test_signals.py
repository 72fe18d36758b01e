"""References and disturbances: bounded, repeatable, seeded, and what their names promise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.records import Record, write_record
from cjt_gym.signals import KINDS, RANDOM_KINDS, Signal, make_signals, signal_from_file

TIMES = np.arange(0.0, 3.0, 1e-3)


@given(
    kind=st.sampled_from(RANDOM_KINDS),
    amplitude=st.floats(0.1, 100.0),
    key=st.integers(0, 2**63 - 1),
    period=st.floats(0.01, 2.0),
)
def test_a_signal_stays_within_its_amplitude(
    kind: str, amplitude: float, key: int, period: float
) -> None:
    values = Signal(kind, amplitude=amplitude, period=period, key=key).torque(TIMES[::50])
    assert np.abs(values).max() <= amplitude * (1.0 + 1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_signal_has_a_value_at_any_time_without_a_state(kind: str) -> None:
    signal = Signal(kind, key=5)
    forward = signal.torque(TIMES)
    backward = signal.torque(TIMES[::-1])[::-1]
    np.testing.assert_array_equal(forward, backward)
    assert signal.torque(-1.0) == signal.torque(0.0)


@pytest.mark.parametrize("kind", ["step", "multisine", "smooth"])
def test_reset_draws_from_the_generator_it_is_given_and_from_nothing_else(kind: str) -> None:
    one, same, other = (Signal(kind).reset(np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.torque(TIMES), same.torque(TIMES))
    assert not np.array_equal(one.torque(TIMES), other.torque(TIMES))


def test_a_step_holds_its_level() -> None:
    values = Signal("step", period=0.25, key=3).torque(TIMES)
    changes = np.flatnonzero(np.diff(values)) + 1
    np.testing.assert_array_equal(changes, np.arange(250, 3000, 250))


def test_a_chirp_sweeps_its_frequencies_linearly() -> None:
    signal = Signal("chirp", low=1.0, high=9.0, period=2.0)
    t = np.arange(0.0, 2.0, 1e-4)
    expected = np.sin(2.0 * np.pi * (1.0 * t + 0.5 * 8.0 / 2.0 * t**2))
    np.testing.assert_allclose(signal.torque(t), expected, atol=1e-12)
    assert abs(signal.torque(2.0 + 1e-9) - signal.torque(2.0 - 1e-9)) < 1e-6


def test_a_multisine_has_exactly_its_tones() -> None:
    signal = Signal("multisine", low=2.0, high=32.0, count=5, key=9)
    spectrum = np.abs(np.fft.rfft(signal.torque(np.arange(0.0, 4.0, 1e-3)))) / 2000.0
    tones = np.flatnonzero(spectrum > 1e-9) / 4.0
    np.testing.assert_allclose(tones, [2.0, 4.0, 8.0, 16.0, 32.0])
    np.testing.assert_allclose(spectrum[spectrum > 1e-9], 0.2, rtol=1e-9)


def test_a_smooth_signal_has_continuous_velocity_and_acceleration() -> None:
    dt = 1e-4
    values = Signal("smooth", period=0.1, key=4).torque(np.arange(0.0, 2.0, dt))
    acceleration = np.diff(values, 2) / dt**2
    assert np.abs(np.diff(values)).max() / dt < 2.0 * 1.875 / 0.1 + 1e-6
    assert np.abs(np.diff(acceleration)).max() < 60.0 * 2.0 / 0.1**3 * dt * 1.01


def test_a_record_serves_as_a_reference_and_repeats(tmp_path: Path) -> None:
    t = np.arange(100) * 0.01
    record = Record({"t": t + 5.0, "tau_ref": t * 3.0}, {"t": "s", "tau_ref": "N m"})
    path = write_record(record, tmp_path / "wanted.csv")
    signal = signal_from_file(path)
    assert signal.torque(0.505) == pytest.approx(3.0 * 0.505)
    assert signal.torque(1.0 + 0.2) == pytest.approx(3.0 * 0.2)
    (same,) = make_signals(str(path), amplitude=7.0)
    np.testing.assert_array_equal(same.torque(t), signal.torque(t))
    unwanted = Record({"t": t, "q_m": t}, {"t": "s", "q_m": "rad"})
    silent = write_record(unwanted, tmp_path / "silent.csv")
    with pytest.raises(ConfigurationError, match="tau_ref, tau_cmd or tau_l"):
        signal_from_file(silent)


def test_bad_signals_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="chirp"):
        Signal("chrip")
    with pytest.raises(ConfigurationError, match=r"high of the chirp signal .* > 0 Hz"):
        Signal("chirp", high=-1.0)
    with pytest.raises(ConfigurationError, match="count"):
        Signal("multisine", count=0)
    with pytest.raises(UnknownNameError, match="mixed"):
        make_signals("mixd", amplitude=1.0)
