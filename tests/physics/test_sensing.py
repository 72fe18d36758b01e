"""What sensors and command path add: noise, quantization, delays, differentiation, filters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cjt_gym.joint import STRUCTURES, Joint, load_joint
from cjt_gym.records import Record
from tests.physics.cases import UNDAMPED, Effects, Floats

NAME, STRUCTURE = "orange_80_6000", "output_fixed"
DT, H = 1e-3, 1e-4
CHANNELS = ("i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")


def loaded(effects: Effects, structure: str = STRUCTURE) -> Joint:
    return load_joint(NAME, structure, effects=effects)


def inputs() -> tuple[Floats, Floats]:
    rng, t = np.random.default_rng(4), np.arange(300) * DT
    return 20.0 * np.sin(2 * np.pi * 5.0 * t) + rng.normal(0.0, 2.0, 300), 0.3 * np.cos(20 * t)


def driven(effects: Effects) -> Record:
    return loaded(effects).simulate(*inputs(), dt=DT, dt_physics=H)


def finely() -> Record:
    """Return the ideal joint under the same inputs, recorded at every substep."""
    tau_m, load = (np.repeat(x, round(DT / H)) for x in inputs())
    return loaded({}).simulate(tau_m, load, dt=H, dt_physics=H)


# -------------------------------------------------------------------- noise, quantization


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


@pytest.mark.parametrize("channel", ["i", "q_m", "q_g", "q_l", "tau"])
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
    joint = loaded({"command_quantization": {"resolution": 0.25}})
    record = joint.simulate(inputs()[0], dt_physics=H)
    expected = np.floor(record["i_cmd"] / 0.25 + 0.5) * 0.25
    np.testing.assert_allclose(record["true_i"][1:], expected[:-1], atol=1e-12)


# ------------------------------------------------------------------------------- delays


@pytest.mark.parametrize("substeps", [1, 5, 10, 13, 20, 37])
def test_delayed_command_is_the_shifted_command(substeps: int) -> None:
    """To the substep: the same as a shifted command that is given at every substep."""
    record = driven({"command_delay": {"delay": substeps * H}})
    tau_m, load = (np.repeat(x, round(DT / H)) for x in inputs())
    shifted = np.concatenate([np.zeros(substeps), tau_m])[: len(tau_m)]
    late = loaded({}).simulate(shifted, load, dt=H, dt_physics=H)
    for channel in ("q_m", "q_g", "q_l", "dq_m", "dq_g", "tau"):
        expected = late[f"true_{channel}"][:: round(DT / H)]
        np.testing.assert_allclose(record[f"true_{channel}"], expected, rtol=1e-12, atol=1e-13)


def shifted_by(record: Record, channel: str, substeps: int, samples: int) -> Floats:
    """Return a finely recorded channel at the control samples, late by some substeps."""
    at = np.arange(samples) * round(DT / H) - substeps
    return np.where(at < 0, record[channel][0], record[channel][np.maximum(at, 0)])


@pytest.mark.parametrize(("all_late", "torque_late"), [(0, 7), (13, 7), (13, 17), (20, 10)])
def test_torque_delay_comes_on_top(all_late: int, torque_late: int) -> None:
    effects: Effects = {"torque_delay": {"delay": torque_late * H}}
    if all_late:
        effects["measurement_delay"] = {"delay": all_late * H}
    fine, late = finely(), driven(effects)
    tau = shifted_by(fine, "tau", all_late + torque_late, len(late.t))
    np.testing.assert_allclose(late["tau"], tau, rtol=1e-12, atol=1e-12)
    q_m = shifted_by(fine, "q_m", all_late, len(late.t))
    np.testing.assert_allclose(late["q_m"], q_m, rtol=1e-12, atol=1e-13)


# ----------------------------------------------------------------- derivative and filters


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
    std, cutoff, n = 1e-4, 100.0, 20_000
    effects: Effects = {
        "noise": {"channel": "q_m", "std": std},
        "velocity_differentiation": {"cutoff": cutoff},
    }
    record = loaded(effects).simulate(np.zeros(n), dt_physics=DT)
    d = math.exp(-2 * math.pi * cutoff * DT)
    # impulse response (1 - d) (1, d - 1, d (d - 1), ...): its squares add up to this
    expected = std / DT * (1 - d) * math.sqrt(1 + (1 - d) ** 2 / (1 - d**2))
    assert record["dq_m"].std() == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("cutoff", [20.0, 200.0, 1000.0])
def test_torque_filter_is_a_first_order_low_pass(cutoff: float) -> None:
    record = driven({"torque_filter": {"cutoff": cutoff}})
    gain = 1.0 - math.exp(-2 * math.pi * cutoff * DT)
    expected = record["true_tau"].copy()
    for k in range(1, len(expected)):
        expected[k] = expected[k - 1] + gain * (record["true_tau"][k] - expected[k - 1])
    np.testing.assert_allclose(record["tau"], expected, atol=1e-12)


# ----------------------------------------------------------------------------------- ideal


@pytest.mark.parametrize("structure", STRUCTURES)
def test_ideal_sensors_report_the_truth(structure: str) -> None:
    """A prescribed load velocity jumps at a sample, where the sensor still has the one before."""
    joint = loaded({}, structure)
    record = joint.simulate(*inputs(), dt=DT, dt_physics=H)
    for channel in CHANNELS:
        if channel != "dq_l" or not joint.structure_row.output_fixed:
            true = record[f"true_{channel}"]
            np.testing.assert_array_equal(record[channel], true, err_msg=channel)
