"""What the load meets: weight, contact, prescribed motion, a person."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import welch
from scipy.special import ellipk

from cjt_gym.joint import load_joint
from cjt_gym.joint.kernel.disturbance import TREMOR_DAMPING
from tests.physics.cases import FIXED, FREE, Effects, Floats, falls, lossless, states, total_energy

NAME = "orange_80_6000"
INERTIA = 0.23 + 0.0717 + 0.5


def equal(q: float, dq: float) -> Floats:
    return np.array([q, q, q, dq, dq, dq])


# --------------------------------------------------------------------------------- gravity


@pytest.mark.parametrize("amplitude", [0.05, 1.0, 3.0])
def test_a_pendulum_has_its_period(amplitude: float) -> None:
    """T = 4 sqrt(I / w) K(sin^2(A / 2)), about the angle at which it hangs."""
    weight, hang, h = 40.0, 0.4, 1e-4
    joint = lossless("rigid", {"gravity": {"torque": weight, "angle": hang}})
    period = 4.0 * math.sqrt(INERTIA / weight) * ellipk(math.sin(0.5 * amplitude) ** 2)
    samples = round(3.5 * period / h)
    x0 = equal(hang + amplitude, 0.0)
    q = states(joint.simulate(np.zeros(samples), dt=h, dt_physics=h, x0=x0))[:, 2] - hang
    np.testing.assert_allclose(falls(q, h), period * (np.arange(4) + 0.25), rtol=1e-5)


@pytest.mark.parametrize("structure", FREE)
def test_weight_hangs_where_the_spring_holds_it(structure: str) -> None:
    """Held at the motor, the load sinks until spring and weight balance."""
    weight = 40.0
    effects: Effects = {"gravity": {"torque": weight, "angle": -1.2}}
    damping = {"d_l": 20.0, "d_l_n": 20.0, "I_l": 0.5}
    joint = load_joint(NAME, structure, effects=effects, parameters=damping)
    tau = weight * math.sin(1.2)
    record = joint.simulate(np.full(20_000, tau), dt=1e-3, dt_physics=1e-3)
    if structure == "rigid":
        assert record["true_tau"][5] == pytest.approx(tau, rel=1e-3)
    assert record["true_q_l"][-1] == pytest.approx(0.0, abs=2.0 * tau / joint.parameters.k_b)


# --------------------------------------------------------------------------------- contact


def bounced(effects: Effects, speed: float, h: float) -> Floats:
    joint, start = lossless("rigid", effects), equal(-0.01, speed)
    return states(joint.simulate(np.zeros(round(0.5 / h)), dt=h, dt_physics=h, x0=start))


@pytest.mark.parametrize("h", [1e-3, 1e-4])
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_an_elastic_contact_gives_all_back(exponent: float, h: float) -> None:
    """The rebound is as fast as the approach, at any step."""
    effects: Effects = {"contact": {"stiffness": 5000.0, "exponent": exponent, "damping": 0.0}}
    v = bounced(effects, 1.5, h)[:, 5]
    assert v[0] == 1.5
    assert v[-1] == pytest.approx(-1.5, rel=1e-11)


def test_a_linear_contact_lasts_half_an_oscillation() -> None:
    """Between the crossings of the surface: pi sqrt(I / k)."""
    effects: Effects = {"contact": {"stiffness": 5000.0, "exponent": 1.0, "damping": 0.0}}
    h = 1e-5
    q = bounced(effects, 1.5, h)[:, 2]
    inside = np.flatnonzero(q > 0.0)
    assert (inside[-1] - inside[0]) * h == pytest.approx(
        math.pi * math.sqrt(INERTIA / 5e3), abs=2 * h
    )


@pytest.mark.parametrize("speed", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("damping", [0.1, 0.5, 2.0])
def test_restitution_of_hunt_and_crossley(speed: float, damping: float) -> None:
    """The first integral of x'' = -k x^e (1 + c x') / I: e(v) solves
    c v_in + ln(1 - ...) below, for any k and exponent; small c v: e = 1 - 2 c v / 3.

        c v_out - ln(1 + c v_out) = c v_in - ln(1 + c v_in),   v_out < 0
    """
    effects: Effects = {"contact": {"stiffness": 5e3, "exponent": 1.5, "damping": damping}}
    v_in, v_out = (damping * v for v in (speed, bounced(effects, speed, 1e-5)[-1, 5]))
    assert v_out < 0.0
    assert v_out - math.log1p(v_out) == pytest.approx(v_in - math.log1p(v_in), rel=1e-4)


@pytest.mark.parametrize("structure", FREE)
@pytest.mark.parametrize("h", [1e-3, 1e-4])
def test_contact_never_pulls(structure: str, h: float) -> None:
    """Torn out of the heavily damped contact, the load is slowed by nothing."""
    effects: Effects = {
        "contact": {"stiffness": 1e5, "exponent": 1.0, "damping": 10.0, "position": -0.05}
    }
    free, held = (
        states(lossless(structure, e).simulate(np.full(40, -30.0), x0=equal(0.0, -2.0), dt=h,
               dt_physics=h))
        for e in ({}, effects)
    )  # fmt: skip
    assert (held[:, 5] <= free[:, 5] + 1e-9 + 0.2 * (structure != "rigid")).all()


@pytest.mark.parametrize("structure", FREE)
@pytest.mark.parametrize("h", [1e-3, 1e-4])
def test_weight_and_contact_conserve_energy(structure: str, h: float) -> None:
    effects: Effects = {
        "contact": {"stiffness": 3e4, "exponent": 1.5, "damping": 0.0, "position": 0.01},
        "gravity": {"torque": 60.0, "angle": 0.5},
    }
    joint = lossless(structure, effects)
    x0 = np.array([0.02, 0.01, 0.0, 1.0, -1.0, 2.0])
    energy = total_energy(joint, states(joint.simulate(np.zeros(2000), dt=h, dt_physics=h, x0=x0)))
    assert np.abs(energy - energy[0]).max() <= 1e-11 * energy[0]


# ------------------------------------------------------------------------- load friction


@pytest.mark.parametrize("structure", FREE)
def test_friction_of_the_load_is_that_of_coulomb(structure: str) -> None:
    tau_m = 10.0 * np.sin(np.arange(200) * 0.1)
    rows: list[Effects] = [
        {"load_coulomb": {"d_cl": 3.0, "dq_0": 0.0}},
        {"coulomb": {"d_cm": 0.0, "d_cg": 0.0, "d_cl": 3.0, "dq_0": 0.0}},
        {"load_coulomb": {"d_cl": 1.0, "dq_0": 0.0},
         "coulomb": {"d_cm": 0.0, "d_cg": 0.0, "d_cl": 2.0, "dq_0": 0.0}},
    ]  # fmt: skip
    found = [states(load_joint(NAME, structure, effects=e).simulate(tau_m)) for e in rows]
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])


# ---------------------------------------------------------------------------- moved output


@pytest.mark.parametrize("structure", FIXED)
@pytest.mark.parametrize("frequency", [0.7, 20.0])
def test_moved_output_is_a_sine_at_each_sample(structure: str, frequency: float) -> None:
    """On top of the given velocity; exact, as the mean velocity of each sample is."""
    effects: Effects = {"load_motion": {"amplitude": 0.05, "frequency": frequency}}
    joint = load_joint(NAME, structure, effects=effects)
    record = joint.simulate(np.zeros(2000), np.full(2000, 0.1), dt_physics=1e-3)
    expected = 0.05 * np.sin(2 * np.pi * frequency * record.t) + 0.1 * record.t
    np.testing.assert_allclose(record["true_q_l"], expected, atol=1e-12)


@pytest.mark.parametrize("structure", FIXED)
def test_moved_output_is_a_moved_load(structure: str) -> None:
    effects: Effects = {"load_motion": {"amplitude": 0.02, "frequency": 3.0}}
    t = np.arange(301) * 1e-3
    moved = np.diff(0.02 * np.sin(2 * np.pi * 3.0 * t)) / 1e-3
    one = load_joint(NAME, structure, effects=effects).simulate(np.zeros(300), dt_physics=1e-4)
    other = load_joint(NAME, structure, effects={}).simulate(np.zeros(300), moved, dt_physics=1e-4)
    for column in ("true_q_m", "true_tau", "true_dq_l"):
        np.testing.assert_allclose(one[column], other[column], rtol=1e-9, atol=1e-10)


# -------------------------------------------------------------------------------- a person

SAMPLES = 200_000


def person(**values: float) -> Floats:
    """Return the torque of a person on a rigid mass, from its momentum, shape (SAMPLES - 1,)."""
    dt = 1e-3
    joint = lossless("rigid", {"human_torque": values})
    v = joint.simulate(np.zeros(SAMPLES), dt=dt, dt_physics=dt)["true_dq_l"]
    return np.asarray(np.diff(v) * INERTIA / dt)


@pytest.mark.parametrize("bandwidth", [1.0, 5.0])
def test_voluntary_torque_is_noise_through_a_low_pass(bandwidth: float) -> None:
    """Deviation, and correlation exp(-2 pi b t); 2 b T independent values make the error."""
    torque = person(std=3.0, bandwidth=bandwidth)[2000:]
    w, independent = 2 * math.pi * bandwidth, math.pi * bandwidth * SAMPLES * 1e-3
    assert torque.var() == pytest.approx(9.0, rel=5 * math.sqrt(2 / independent))
    for lag in (0.1 / w, 0.5 / w, 1.0 / w):
        k = round(lag * 1e3)
        found = (torque[k:] * torque[:-k]).mean() / torque.var()
        assert found == pytest.approx(math.exp(-w * k * 1e-3), abs=5 / math.sqrt(independent))


@pytest.mark.parametrize("frequency", [4.0, 9.0, 15.0])
def test_tremor_is_a_narrow_band_at_its_frequency(frequency: float) -> None:
    """Its peak, its half-power width of 2 zeta f, and its deviation."""
    torque = person(std=0.0, tremor=0.5, tremor_frequency=frequency)[2000:]
    independent = 2 * math.pi * TREMOR_DAMPING * frequency * SAMPLES * 1e-3
    assert torque.var() == pytest.approx(0.25, rel=5 * math.sqrt(2 / independent))
    f, power = welch(torque, 1e3, nperseg=16384)
    assert f[np.argmax(power)] == pytest.approx(frequency, rel=0.05)
    smooth = np.convolve(power, np.ones(5) / 5, "same")
    wide = f[smooth > 0.5 * smooth.max()]
    assert wide[-1] - wide[0] == pytest.approx(2 * TREMOR_DAMPING * frequency, rel=0.5)
    assert power[(f > 0.7 * frequency) & (f < 1.4 * frequency)].sum() > 0.85 * power.sum()


def test_a_person_is_another_each_time_and_the_same_by_seed() -> None:
    effects: Effects = {"human_torque": {"std": 1.0, "tremor": 0.1}}
    joint = lossless("full_dynamics", effects)
    one, same, other = (
        joint.simulate(np.zeros(100), dt_physics=1e-3, seed=seed)["true_q_l"] for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert (one != other)[2:].all()
