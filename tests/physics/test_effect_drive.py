"""From the command to the motor's torque: lag, dead time, limits, heat, harmonics, tolerances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from cjt_gym.joint import EFFECTS, STRUCTURES, Joint, load_joint
from cjt_gym.joint.kernel.arrays import HOUSING, K_M, R_W, WINDING
from tests.physics.cases import DT, UNDAMPED, Effects, Floats, traced

NAME = "orange_80_6000"
MEASURED = ("q_m", "q_l", "dq_m", "dq_g", "tau")
HEAVY = UNDAMPED | {"I_m": 1e7}


def rigid(effects: Effects, drive: str = "current", **parameters: float) -> Joint:
    return load_joint(NAME, "rigid", drive, effects=effects, parameters=UNDAMPED | parameters)


def inertia(joint: Joint) -> float:
    p = joint.packed()[0][0]
    return float(p["I_m"] + p["I_g"] + p["I_l"])


# ---------------------------------------------------------------- lag, dead time, rate limit


@pytest.mark.parametrize("bandwidth", [5.0, 100.0, 5000.0])
@pytest.mark.parametrize("h", [1e-3, 1e-4])
def test_lag_answers_a_step_exactly(bandwidth: float, h: float) -> None:
    """The mean of 1 - exp(-w t) over each substep, for any w h; hence exact speed as well."""
    joint = rigid({"current_lag": {"bandwidth": bandwidth}})
    record = joint.simulate(np.full(200, 10.0), dt=h, dt_physics=h)
    w, t, p = 2.0 * math.pi * bandwidth, np.arange(200) * h, joint.parameters
    impulse = 10.0 * (t + np.expm1(-w * t) / w)
    np.testing.assert_allclose(record["true_dq_m"], impulse / inertia(joint), rtol=1e-9, atol=1e-12)
    mean = np.diff(impulse) / h / (p.k_t * p.n)
    np.testing.assert_allclose(record["true_i"][1:], mean, rtol=1e-9)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize(
    ("effect", "impulse"),
    [
        ({"current_lag": {"bandwidth": 10.0}}, 1.0 / (2.0 * math.pi * 10.0)),
        ({"command_delay": {"delay": 0.025}}, 0.025),
    ],
)
def test_a_joint_that_starts_in_motion_has_had_its_command(
    effect: Effects, impulse: float, moving: bool
) -> None:
    """One at rest waits for it; the impulse that it lacks for good is that of a wait so long."""
    joint, speed = rigid(effect), 0.5 if moving else 0.0
    x0 = [0.0, 0.0, 0.0, speed, speed, speed]
    v = joint.simulate(np.full(2000, 10.0), dt=1e-3, x0=x0)["true_dq_m"]
    gained = (v[-1] - speed) * inertia(joint)
    assert gained == pytest.approx(10.0 * (1.999 - (0.0 if moving else impulse)), rel=1e-9)


@pytest.mark.parametrize("bandwidth", [50.0, 300.0])
def test_lag_is_3_db_down_at_its_bandwidth(bandwidth: float) -> None:
    """And 45 degrees late; the held command and the mean over a substep cost (w h)^2 / 12."""
    joint, h = rigid({"current_lag": {"bandwidth": bandwidth}}), 1e-5
    t = np.arange(round(10.0 / bandwidth / h)) * h
    angle = 2.0 * math.pi * bandwidth * t
    current = joint.simulate(10.0 * np.sin(angle), dt=h)["true_i"][len(t) // 2 :]
    # what is recorded at t is the mean over the substep before, under the command at its start
    at = 2.0 * math.pi * bandwidth * (t[len(t) // 2 :] - h)
    fit, *_ = np.linalg.lstsq(np.column_stack([np.sin(at), np.cos(at)]), current, rcond=None)
    p = joint.parameters
    assert np.hypot(*fit) * p.k_t * p.n / 10.0 == pytest.approx(math.sqrt(0.5), rel=1e-3)
    assert math.degrees(math.atan2(fit[1], fit[0])) == pytest.approx(-45.0, abs=0.2)


@pytest.mark.parametrize("h", [1e-3, 1e-4])
def test_rate_limit_makes_a_ramp(h: float) -> None:
    """From 0 to 10 A at 400 A/s in 25 ms, and its torque's impulse exactly."""
    joint, rate = rigid({"current_rate_limit": {"rate": 400.0}}), 400.0
    p = joint.parameters
    k = p.k_t * p.n
    record = joint.simulate(np.full(60, 10.0 * k), dt=DT, dt_physics=h)
    t, full = record.t, 10.0 / rate
    ramp = np.where(t < full, 0.5 * rate * t**2, 0.5 * rate * full**2 + 10.0 * (t - full))
    np.testing.assert_allclose(record["true_dq_m"], k * ramp / inertia(joint), rtol=1e-9)


def test_rate_limit_holds_for_both_directions() -> None:
    joint = rigid({"current_rate_limit": {"rate": 400.0}})
    p, rng = joint.parameters, np.random.default_rng(1)
    torque = rng.uniform(-60.0, 60.0, 400)
    current = joint.simulate(torque, dt_physics=DT)["true_i"]
    assert np.abs(np.diff(current)).max() <= 400.0 * DT * (1.0 + 1e-12)
    wanted = torque / (p.k_t * p.n)
    near = np.abs(np.diff(wanted)) < 1e-9
    assert not near.any()  # bang-bang: it never rests


# ------------------------------------------------------------------------------ saturation


@pytest.mark.parametrize("drive", ["current", "static", "rl", "dq"])
def test_current_saturates_at_its_own_peak(drive: str) -> None:
    joint = rigid({"current_saturation": {"i_p": 7.0}}, drive, I_m=1e6)
    p = joint.parameters
    for sign in (1.0, -1.0):
        record = joint.simulate(np.full(50, sign * 20.0 * p.k_t * p.n), dt_physics=1e-4)
        assert record["true_i"][-1] == pytest.approx(7.0 * sign, rel=1e-6)
        assert np.abs(record["true_i"]).max() <= 7.0 * (1.0 + 1e-12)


@pytest.mark.parametrize(("drive", "factor"), [("static", 1.0), ("rl", 1.0), ("dq", 1.5)])
def test_a_sagging_supply_lowers_the_no_load_speed(drive: str, factor: float) -> None:
    joint = rigid({"voltage_saturation": {"v_0": 30.0}}, drive)
    p = joint.parameters
    record = joint.simulate(voltage=np.full(3000, 48.0), dt_physics=5e-5)
    assert record["true_dq_m"][-1] == pytest.approx(factor * 30.0 / (p.k_t * p.n), rel=1e-6)


# ------------------------------------------------------------------------------------ heat

HEAT: Effects = {
    "thermal_derating": {"derating": 2e-3, "a_CU": 0.0, "r": 0.3, "r_th1": 2.0, "r_th2": 5.0}
    | {"T_thw": 0.2, "T_thm": 1.5, "rise": 0.0}
}


def heated(amperes: float, samples: int, **changed: float) -> tuple[Joint, Floats]:
    """Return what a blocked motor remembers under a constant current, shape (samples + 1, ...)."""
    values = HEAT["thermal_derating"] | changed
    joint = rigid({"thermal_derating": values}, I_m=1e6)
    return joint, traced(joint, np.full(samples, amperes)).memory


def test_heat_rises_as_two_exponentials() -> None:
    """Linear without a_CU: the matrix exponential; backward Euler's error is dt / T, at first 1 %.

    C_w = T_thw / r_th1 and C_h = T_thm / r_th2 as in the toolbox's parameters.
    """
    power = 0.3 * 10.0**2
    _, memory = heated(10.0, 4000)
    c_w, c_h = 0.2 / 2.0, 1.5 / 5.0
    a = np.array([[-0.5 / c_w, 0.5 / c_w], [0.5 / c_h, -(0.5 + 0.2) / c_h]])
    end = -np.linalg.solve(a, [power / c_w, 0.0])
    for k in (100, 500, 1500, 4000):  # the current of a step heats in the one after
        exact = end - expm(a * (k - 1) * DT) @ end
        np.testing.assert_allclose(memory[k, [WINDING, HOUSING]], exact, rtol=1e-2)
    assert end == pytest.approx([power * 7.0, power * 5.0])


def test_heat_ends_where_copper_says() -> None:
    """T = P0 (r_th1 + r_th2) / (1 - a_CU P0 (r_th1 + r_th2)) with resistance rising along."""
    _, memory = heated(4.0, 40_000, a_CU=0.0039)
    cold = 0.3 * 16.0 * 7.0
    assert memory[-1, WINDING] == pytest.approx(cold / (1.0 - 0.0039 * cold), rel=1e-4)


def test_heat_flows_out_of_a_warm_winding() -> None:
    """Energy C_w T_w + C_h T_h is lost through r_th2 alone, and never negative."""
    _, memory = heated(0.0, 3000, rise=80.0)
    held = 0.1 * memory[:, WINDING] + 0.3 * memory[:, HOUSING]
    lost = np.cumsum(memory[1:, HOUSING]) * DT / 5.0
    np.testing.assert_allclose(held[0] - held[1:], lost, rtol=1e-9, atol=1e-12)
    assert memory[-1, WINDING] < 40.0
    assert (memory[:, [WINDING, HOUSING]] >= 0.0).all()


def test_a_warm_motor_gives_less_torque() -> None:
    """k_t (1 - derating rise) at constant current, felt as acceleration."""
    values = HEAT["thermal_derating"] | {"rise": 100.0, "T_thw": 1e4, "T_thm": 1e5}
    joint = rigid({"thermal_derating": values})
    v = joint.simulate(np.full(50, 10.0), dt_physics=DT)["true_dq_m"]
    torque = np.diff(v) / DT * inertia(joint)
    np.testing.assert_allclose(torque, 10.0 * (1.0 - 2e-3 * 100.0), rtol=1e-4)


@pytest.mark.parametrize("drive", ["static", "rl", "dq"])
def test_a_warm_winding_resists(drive: str) -> None:
    """A blocked motor at 10 V draws v / (r (1 + a_CU rise)); the joint's own r counts."""
    values = HEAT["thermal_derating"] | {"rise": 100.0, "a_CU": 0.0039, "T_thw": 1e4, "T_thm": 1e5}
    joint = rigid({"thermal_derating": values}, drive, I_m=1e9)
    p = joint.parameters
    record = joint.simulate(voltage=np.full(30, 5.0), dt_physics=DT)
    assert record["true_i"][-1] == pytest.approx(5.0 / (p.r * 1.39), rel=1e-4)
    memory = traced(joint, np.full(3, 5.0), voltage=True).memory
    assert memory[-1, R_W] == pytest.approx(1.39 * p.r, rel=1e-4)
    assert memory[-1, K_M] == pytest.approx(0.8 * p.k_t * p.n, rel=1e-4)


# ---------------------------------------------------------------------- ripple over the angle

TURN = 12_000


def orders(effects: Effects, torque: float) -> Floats:
    """Return amplitudes of the torque by periods per revolution of q_m, from one revolution."""
    joint = load_joint(NAME, "rigid", effects=effects, parameters=HEAVY)
    h = 1e-4
    speed = 2.0 * math.pi / (TURN * h)
    x0 = [0, 0, 0, speed, speed, speed]
    v = joint.simulate(np.full(TURN + 1, torque), dt=h, dt_physics=h, x0=x0)["true_dq_m"]
    return np.asarray(np.abs(np.fft.rfft(np.diff(v) / h * inertia(joint))) * 2.0 / TURN)


@pytest.mark.parametrize(
    ("name", "per_turn", "torque"),
    [("current_offset", 480, 0.0), ("commutation_ripple", 2880, 20.0), ("cogging", 80, 0.0)],
)
def test_ripple_has_its_orders(name: str, per_turn: int, torque: float) -> None:
    """p n for offsets of the current sensors, 6 p n for commutation, n for cogging (p 6, n 80)."""
    p = load_joint(NAME).parameters
    values: dict[str, object] = {"a": 0.03, "b": -0.04}
    expected = 0.05 * p.k_t * p.n
    if name != "current_offset":
        values = {"f": (float(per_turn),), "a": (0.03,), "b": (-0.04,)}
        expected = 0.05 * (torque if name == "commutation_ripple" else 1.0)
    assert p.p * p.n == 480
    found = orders({name: values}, torque)
    assert np.argmax(found[1:]) + 1 == per_turn
    assert found[per_turn] == pytest.approx(expected, rel=2e-3)
    found[[0, per_turn]] = 0.0
    assert found.max() < 2e-3 * expected


def test_commutation_ripple_needs_current() -> None:
    found = orders({"commutation_ripple": {"f": (2880.0,), "a": (0.03,), "b": (0.0,)}}, 0.0)
    assert found.max() == 0.0


# -------------------------------------------------------------------------------- tolerances


K_T = load_joint(NAME).parameters.k_t
BOTH = {"d_m": 0.5, "d_m_n": 0.5, "d_g": 3.0, "d_g_n": 3.0}
ANOTHER: dict[str, tuple[dict[str, float], dict[str, float], float, float]] = {
    "inertia": ({"I_m": 0.4}, {"I_m": 0.4}, 1.0, 0.0),
    "damping": ({"d_m": 0.5, "d_g": 3.0}, BOTH, 1.0, 0.0),
    "stiffness": ({"k_b": 4321.0}, {"k_b": 4321.0}, 1.0, 0.0),
    "gear_stiffness": ({"k_g": 4321.0}, {"k_g": 4321.0}, 1.0, 0.0),
    "load_inertia": ({"I_l": 0.7}, {"I_l": 0.7}, 1.0, 0.0),
    "torque_constant": ({"k_t": 0.9 * K_T}, {}, 0.9, 0.0),
    "torque_offset": ({"torque": 1.5}, {}, 1.0, 1.5),
}
"""Values of an effect, the parameters of the joint that it makes, and what it does to a torque."""
ACTING = [
    (name, structure)
    for name in ANOTHER
    for structure, row in STRUCTURES.items()
    if EFFECTS[name].acts_in(row, "current")
]


@pytest.mark.parametrize(("effect", "structure"), ACTING)
def test_a_tolerance_is_that_of_another_joint(effect: str, structure: str) -> None:
    """The command asks for the nominal current, so a torque constant scales the torque."""
    tau_m = 20.0 * np.sin(np.arange(200) * 0.1)
    values, changed, scale, shift = ANOTHER[effect]
    one = load_joint(NAME, structure, effects={effect: values})
    other = load_joint(NAME, structure, effects={}, parameters=changed)
    a = one.simulate(tau_m, dt_physics=1e-4)
    b = other.simulate(scale * tau_m + shift, dt_physics=1e-4)
    near = 0.0 if changed else 1e-9
    for column in MEASURED if near else a.columns:
        np.testing.assert_allclose(a[column], b[column], rtol=near, atol=near, err_msg=column)
