"""Sensors and command path: noise and drift, zeros and scales, lateness, filters, lost frames.

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


def inputs(dt: float = DT) -> tuple[Floats, Floats]:
    """Return motor torque and load, held over control samples, at every step."""
    t = np.repeat(np.arange(400) * DT, round(DT / dt))
    return 20.0 * np.sin(2 * np.pi * 5.0 * t), 0.3 * np.cos(20.0 * t)


def driven(effects: Effects, dt: float = DT, structure: str = STRUCTURE) -> Record:
    """Return a joint in motion, at control samples or at every substep."""
    joint = load_joint(NAME, structure, effects=effects)
    return joint.simulate(*inputs(dt), dt=dt, dt_physics=H)


def shifted(fine: Record, channel: str, substeps: int) -> Floats:
    """Return a finely recorded channel at the control samples, late by some substeps."""
    at = np.arange(400) * RATIO - substeps
    return np.where(at < 0, fine[channel][0], fine[channel][np.maximum(at, 0)])


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


# --------------------------------------------------------------------- command, quantization


def test_command_noise_drives_the_joint() -> None:
    """Noise on the torque of a rigid mass: its speed is a random walk of std h / I per sample."""
    joint = load_joint(NAME, "rigid", effects={"command_noise": {"std": 0.5}})
    record = joint.simulate(np.zeros(20_000), dt=DT, dt_physics=DT)
    p = joint.parameters
    inertia, damping = p.I_m + p.I_g + p.I_l, p.d_m + p.d_g + p.d_l
    speed = record["true_dq_m"]
    decay = math.exp(-damping * DT / inertia)
    torque = (speed[1:] - decay * speed[:-1]) * damping / (1.0 - decay)
    assert abs(torque.mean()) < 5 * 0.5 / math.sqrt(20_000)
    assert torque.std() == pytest.approx(0.5, rel=5 / math.sqrt(40_000))


@pytest.mark.parametrize("channel", CHANNELS)
def test_quantized_values_lie_on_the_lattice(channel: str) -> None:
    resolution = 2.0**-6 if channel in ("i", "tau") else 2.0**-14
    record = driven({"quantization": {"channel": channel, "resolution": resolution}})
    steps = record[channel] / resolution
    np.testing.assert_array_equal(steps, np.round(steps))
    assert np.unique(steps).size > 3
    assert np.abs(record[channel] - record[f"true_{channel}"]).max() <= 0.5 * resolution


def test_noise_is_quantized_with_the_signal() -> None:
    effects: Effects = {
        "noise": {"channel": "q_m", "std": 1e-3},
        "quantization": {"channel": "q_m", "resolution": 2.0**-12},
    }
    steps = driven(effects)["q_m"] * 2.0**12
    np.testing.assert_array_equal(steps, np.round(steps))


def test_command_is_rounded_to_its_resolution() -> None:
    record = driven({"command_quantization": {"resolution": 0.25}})
    expected = np.floor(record["i_cmd"] / 0.25 + 0.5) * 0.25
    np.testing.assert_allclose(record["true_i"][1:], expected[:-1], atol=1e-12)


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
        expected = shifted(fine, name, substeps + own * alone)
        np.testing.assert_allclose(late[name], expected, rtol=1e-11, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("substeps", [1, 5, 10, 13, 20, 37])
def test_delayed_command_is_the_shifted_command(substeps: int) -> None:
    """To the substep: the same as a shifted command that is given at every substep."""
    record = driven({"command_delay": {"delay": substeps * H}})
    tau_m, load = inputs(H)
    later = np.concatenate([np.zeros(substeps), tau_m])[: len(tau_m)]
    late = load_joint(NAME, STRUCTURE).simulate(later, load, dt=H, dt_physics=H)
    for channel in ("q_m", "q_g", "q_l", "dq_m", "dq_g", "tau"):
        expected = late[f"true_{channel}"][::RATIO]
        np.testing.assert_allclose(record[f"true_{channel}"], expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(("all_late", "torque_late"), [(0, 7), (13, 7), (13, 17), (20, 10)])
def test_torque_delay_comes_on_top(all_late: int, torque_late: int) -> None:
    effects: Effects = {"torque_delay": {"delay": torque_late * H}}
    if all_late:
        effects["measurement_delay"] = {"delay": all_late * H}
    fine, late = driven({}, dt=H), driven(effects)
    tau = shifted(fine, "tau", all_late + torque_late)
    np.testing.assert_allclose(late["tau"], tau, rtol=1e-12, atol=1e-12)
    q_m = shifted(fine, "q_m", all_late)
    np.testing.assert_allclose(late["q_m"], q_m, rtol=1e-12, atol=1e-13)


# ------------------------------------------------------------------ derivative and filters


@pytest.mark.parametrize("cutoff", [20.0, 200.0, 499.0, 5000.0])
def test_differentiation_has_unit_gain_to_a_ramp(cutoff: float) -> None:
    """A joint that coasts: every measured speed ends at the true one."""
    effects: Effects = {"velocity_differentiation": {"cutoff": cutoff}}
    joint = load_joint(NAME, "full_dynamics", effects=effects, parameters=UNDAMPED)
    x0 = np.array([0.0, 0.0, 0.0, 1.5, 1.5, 1.5])
    record = joint.simulate(np.zeros(400), x0=x0, dt_physics=DT)
    for body in "mgl":
        assert record[f"dq_{body}"][-1] == pytest.approx(1.5, rel=1e-9)


@pytest.mark.parametrize("cutoff", [20.0, 200.0, 499.0, 700.0, 1000.0, 5000.0])
def test_differentiation_does_not_ring(cutoff: float) -> None:
    """Its response to a ramp rises without overshoot, above Nyquist's 500 Hz too."""
    effects: Effects = {"velocity_differentiation": {"cutoff": cutoff}}
    joint = load_joint(NAME, "rigid", effects=effects, parameters=UNDAMPED)
    x0 = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    speed = joint.simulate(np.zeros(100), x0=x0, dt_physics=DT)["dq_m"]
    assert speed[0] == 0.0
    assert (np.diff(speed) > -1e-12).all()
    assert speed.max() < 1.0 + 1e-12


def test_differentiation_passes_the_noise_of_the_angle() -> None:
    """White noise through (1 - d) (1 - 1/z) / (dt (1 - d/z)), d = exp(-2 pi cutoff dt)."""
    std, cutoff = 1e-4, 100.0
    effects: Effects = {
        "noise": {"channel": "q_m", "std": std},
        "velocity_differentiation": {"cutoff": cutoff},
    }
    d = math.exp(-2 * math.pi * cutoff * DT)
    # impulse response (1 - d) (1, d - 1, d (d - 1), ...): its squares add up to this
    expected = std / DT * (1 - d) * math.sqrt(1 + (1 - d) ** 2 / (1 - d**2))
    assert still(effects)["dq_m"].std() == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("cutoff", [20.0, 200.0, 1000.0])
def test_torque_filter_is_a_first_order_low_pass(cutoff: float) -> None:
    record = driven({"torque_filter": {"cutoff": cutoff}})
    gain = 1.0 - math.exp(-2 * math.pi * cutoff * DT)
    expected = record["true_tau"].copy()
    for k in range(1, len(expected)):
        expected[k] = expected[k - 1] + gain * (record["true_tau"][k] - expected[k - 1])
    np.testing.assert_allclose(record["tau"], expected, atol=1e-12)


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


@pytest.mark.parametrize("structure", STRUCTURES)
def test_ideal_sensors_report_the_truth(structure: str) -> None:
    """A prescribed load velocity jumps at a sample, where the sensor still has the one before."""
    record = driven({}, structure=structure)
    for channel in MEASURED:
        if channel != "dq_l" or not STRUCTURES[structure].output_fixed:
            true = record[f"true_{channel}"]
            np.testing.assert_array_equal(record[channel], true, err_msg=channel)
