"""Sensors: statistics of noise and drift, zeros and scales, lateness, eccentricity, lost frames.

Bounds on statistics are five standard errors.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from cjt_gym.joint import STRUCTURES, Joint, load_joint
from cjt_gym.records import Record
from tests.physics.cases import UNDAMPED, Effects, Floats

NAME, STRUCTURE = "orange_80_6000", "output_fixed"
DT, H = 1e-3, 1e-4
RATIO = round(DT / H)
CHANNELS = ("i", "q_m", "q_g", "q_l", "tau")
MEASURED = (*CHANNELS, "dq_m", "dq_g", "dq_l")
LONG = 40_000


def still(effects: Effects, seed: int = 0, samples: int = LONG) -> Record:
    """Return a joint at rest, whose sensors show nothing but their own errors."""
    joint = load_joint(NAME, STRUCTURE, effects=effects)
    return joint.simulate(np.zeros(samples), dt=DT, dt_physics=DT, seed=seed)


def driven(effects: Effects, dt: float = DT) -> Record:
    """Return a joint in motion, at control samples or at every substep."""
    t = np.arange(400) * DT
    inputs = 20.0 * np.sin(2 * np.pi * 5.0 * t), 0.3 * np.cos(20.0 * t)
    tau_m, load = (np.repeat(x, round(DT / dt)) for x in inputs)
    joint = load_joint(NAME, STRUCTURE, effects=effects)
    return joint.simulate(tau_m, load, dt=dt, dt_physics=H)


# -------------------------------------------------------------------------- noise and drift


@pytest.mark.parametrize("channel", CHANNELS)
def test_noise_is_white_normal_and_of_its_size(channel: str) -> None:
    x = still({"noise": {"channel": channel, "std": 0.02}})[channel] / 0.02
    assert abs(x.mean()) < 5 / math.sqrt(LONG)
    assert abs(x.var() - 1.0) < 5 * math.sqrt(2 / LONG)
    assert abs((x**3).mean()) < 5 * math.sqrt(15 / LONG)
    assert abs((x**4).mean() - 3.0) < 5 * math.sqrt(96 / LONG)
    for lag in (1, 2, 3, 10):
        assert abs((x[lag:] * x[:-lag]).mean()) < 5 / math.sqrt(LONG)
    inside = np.mean(np.abs(x) < 1.0)
    assert abs(inside - math.erf(math.sqrt(0.5))) < 5 * math.sqrt(0.217 / LONG)


@pytest.mark.parametrize("effect", ["noise", "drift"])
def test_channels_are_independent(effect: str) -> None:
    values = dict.fromkeys(CHANNELS, 0.01)
    record = still({effect: values})
    rows = [record[c] if effect == "noise" else np.diff(record[c]) for c in CHANNELS]
    off = np.corrcoef(rows) - np.eye(len(CHANNELS))
    assert np.abs(off).max() < 5 / math.sqrt(LONG)
    other = still({effect: values}, seed=1)["q_m"]
    other = other if effect == "noise" else np.diff(other)
    assert abs(np.corrcoef(rows[1], other)[0, 1]) < 5 / math.sqrt(LONG)


@pytest.mark.parametrize("channel", CHANNELS)
def test_drift_is_a_random_walk(channel: str) -> None:
    """Independent normal steps of rate sqrt(dt), from zero: variance rate^2 t."""
    rate = 0.3
    walk = still({"drift": {"channel": channel, "value": rate}})[channel]
    steps = np.diff(walk) / (rate * math.sqrt(DT))
    assert walk[0] == 0.0
    assert abs(steps.mean()) < 5 / math.sqrt(LONG)
    assert abs(steps.var() - 1.0) < 5 * math.sqrt(2 / LONG)
    assert abs((steps[1:] * steps[:-1]).mean()) < 5 / math.sqrt(LONG)


def test_variance_of_drift_grows_linearly_in_time() -> None:
    """Over an ensemble: 1/4, 1 and 4 times the variance at 20, 80 and 320 ms."""
    ends = np.array([
        still({"drift": {"tau": 1.0}}, seed=seed, samples=321)["tau"][[20, 80, 320]]
        for seed in range(150)
    ])  # fmt: skip
    expected = np.array([0.02, 0.08, 0.32])
    assert (np.abs(ends.var(axis=0) / expected - 1.0) < 5 * math.sqrt(2 / 150)).all()


def test_drift_is_the_same_at_any_rate_of_sampling() -> None:
    """Variance after one second does not depend on dt."""
    joint = load_joint(NAME, STRUCTURE, effects={"drift": {"tau": 1.0}})
    for dt in (1e-2, 1e-3):
        n = 200_000 if dt == 1e-3 else 20_000
        walk = joint.simulate(np.zeros(n), dt=dt, dt_physics=dt)["tau"]
        steps = np.diff(walk[:: round(0.1 / dt)])
        assert abs(steps.var() / 0.1 - 1.0) < 5 * math.sqrt(2 / len(steps))


# --------------------------------------------------------------------------- bias and gain


@pytest.mark.parametrize("channel", CHANNELS)
def test_bias_and_gain_are_a_line(channel: str) -> None:
    gain: Effects = {"sensor_gain": {"channel": channel, "value": 1.25}}
    bias: Effects = {"sensor_bias": {"channel": channel, "value": -0.03}}
    if channel == "tau":
        gain, bias = {"torque_gain": {"gain": 1.25}}, {"torque_bias": {"bias": -0.03}}
    record = driven(gain | bias)
    true = record[f"true_{channel}"]
    np.testing.assert_allclose(record[channel], 1.25 * true - 0.03, rtol=1e-12, atol=1e-15)
    if channel.startswith("q"):
        speed = driven({})[f"d{channel}"]
        np.testing.assert_allclose(record[f"d{channel}"], 1.25 * speed, rtol=1e-12, atol=1e-15)


def test_the_sensor_errors_come_in_their_order() -> None:
    """Late, scaled, biased, then noisy, then quantized."""
    resolution = 2.0**-8
    effects: Effects = {
        "channel_delay": {"channel": "q_m", "value": 2e-3},
        "sensor_gain": {"channel": "q_m", "value": 1.1},
        "sensor_bias": {"channel": "q_m", "value": 0.01},
        "quantization": {"channel": "q_m", "resolution": resolution},
    }
    record = driven(effects)
    late = np.concatenate([np.zeros(2), record["true_q_m"][:-2]])
    expected = np.floor((1.1 * late + 0.01) / resolution + 0.5) * resolution
    np.testing.assert_array_equal(record["q_m"], expected)


# -------------------------------------------------------------------------------- lateness


@pytest.mark.parametrize("substeps", [0, 1, 10, 13, 37])
@pytest.mark.parametrize(("channel", "own"), [("i", 5), ("q_m", 7), ("q_g", 23), ("q_l", 1)])
def test_each_channel_is_late_by_itself_in_fractions(channel: str, own: int, substeps: int) -> None:
    """To the substep, on top of the lateness of all; the velocity comes with its angle."""
    effects: Effects = {"channel_delay": {"channel": channel, "value": own * H}}
    if substeps:
        effects["measurement_delay"] = {"delay": substeps * H}
    fine, late = driven({}, dt=H), driven(effects)
    rates = {"q_m": "dq_m", "q_g": "dq_g", "q_l": "dq_l"}
    for name in MEASURED:
        alone = name in (channel, rates.get(channel))
        at = np.arange(400) * RATIO - substeps - own * alone
        expected = np.where(at < 0, fine[name][0], fine[name][np.maximum(at, 0)])
        np.testing.assert_allclose(late[name], expected, rtol=1e-11, atol=1e-12, err_msg=name)


# ---------------------------------------------------------------------------- eccentricity


def turning(effects: Effects, speed: float, samples: int) -> Record:
    joint = load_joint(NAME, "full_dynamics", effects=effects, parameters=UNDAMPED)
    x0 = [0, 0, 0, speed, speed, speed]
    return joint.simulate(np.zeros(samples), x0=x0, dt=DT, dt_physics=DT)


@pytest.mark.parametrize(("channel", "turns"), [("q_m", 80), ("q_m", 1), ("q_g", 1), ("q_l", 1)])
def test_eccentricity_is_one_harmonic_of_its_shaft(channel: str, turns: int) -> None:
    """One revolution in 2000 samples: e sin(f q + phase), f on the rotor's encoder alone."""
    effects: Effects = {"eccentricity": {channel: 2e-3, "phase": 0.7, "turns": float(turns)}}
    record = turning(effects, 2 * math.pi / 2.0, 2000)
    error = record[channel] - record[f"true_{channel}"]
    spectrum = np.fft.rfft(error) / 1000.0
    assert np.argmax(np.abs(spectrum)) == turns
    assert abs(spectrum[turns]) == pytest.approx(2e-3, rel=1e-9)
    assert np.angle(spectrum[turns] * 1j) == pytest.approx(0.7, abs=1e-7)
    spectrum[turns] = 0.0
    assert np.abs(spectrum).max() < 1e-10
    rate = record[f"d{channel}"] - record[f"true_d{channel}"]
    shape = turns * math.pi * np.cos(turns * record[f"true_{channel}"] + 0.7)
    np.testing.assert_allclose(rate, 2e-3 * shape, atol=1e-9)


# ---------------------------------------------------------------------------------- dropout


@pytest.mark.parametrize("probability", [0.02, 0.3, 0.9])
def test_lost_frames_have_their_rate_and_repeat_the_last(probability: float) -> None:
    """All channels of a frame are lost together; runs of lost frames are geometric."""
    record = turning({"dropout": {"probability": probability}}, 0.1, LONG)
    held = np.diff(record["q_m"]) == 0.0
    n = len(held)
    error = math.sqrt(probability * (1.0 - probability) / n)
    assert abs(held.mean() - probability) < 5 * error
    pairs = (held[1:] & held[:-1]).mean()
    assert abs(pairs - probability**2) < 5 * math.sqrt(probability**2 * 2 / n)
    kept = np.flatnonzero(np.concatenate([[True], ~held]))
    last = kept[np.searchsorted(kept, np.arange(LONG), side="right") - 1]
    for channel in ("q_m", "q_g", "q_l"):
        np.testing.assert_array_equal(record[channel], record[f"true_{channel}"][last])


def test_no_frame_arrives_where_all_are_lost() -> None:
    record = turning({"dropout": {"probability": 1.0}}, 0.1, 100)
    assert not record["q_m"].any()
    assert record["true_q_m"][-1] > 0.0


# -------------------------------------------------------------------------- every structure


def measured(joint: Joint, seed: int) -> Floats:
    record = joint.simulate(np.full(200, 5.0), dt_physics=DT, seed=seed)
    return np.column_stack([record[name] for name in MEASURED])


@pytest.mark.parametrize("structure", STRUCTURES)
def test_sensors_repeat_by_seed_in_every_structure(structure: str) -> None:
    effects: Effects = {
        "noise": dict.fromkeys(CHANNELS, 1e-3),
        "drift": dict.fromkeys(CHANNELS, 1e-2),
        "dropout": {"probability": 0.1},
        "command_noise": {"std": 0.2},
        "measurement_delay": {"delay": 1.5e-3},
    }
    joint = load_joint(NAME, structure, effects=effects)
    np.testing.assert_array_equal(measured(joint, 3), measured(joint, 3))
    assert (measured(joint, 3) != measured(joint, 4)).any(axis=0)[:5].all()
