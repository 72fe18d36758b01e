"""The electrical drives: torque-speed line, current limit, voltage circle, back-EMF, limits.

Speeds are on the link side, so the back-EMF constant is k_t n.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from cjt_gym.joint import Joint, load_joint
from tests.physics.cases import UNDAMPED, Floats

NAME = "orange_80_6000"
VOLTAGE_DRIVES = ("static", "rl", "dq")


def rigid(drive: str, **parameters: float) -> Joint:
    """Return a rigid joint without damping, so that speed is lost to nothing."""
    return load_joint(NAME, "rigid", drive, effects={}, parameters=UNDAMPED | parameters)


def heavy(drive: str, **parameters: float) -> Joint:
    """Return a joint that keeps its speed whatever the motor does."""
    return rigid(drive, I_m=1e9, **parameters)


def at_speed(joint: Joint, speed: float, *, voltage: Floats | None = None, torque: float = 0.0,
             steps: int = 400) -> float:  # fmt: skip
    """Return the current [A] that a heavy joint draws at a speed [rad/s] after 20 ms."""
    x0 = np.array([0.0, 0.0, 0.0, speed, speed, speed])
    tau_m = np.full(steps, torque) if voltage is None else None
    record = joint.simulate(tau_m, dt=5e-5, dt_physics=5e-5, voltage=voltage, x0=x0)
    return float(record["true_i"][-1])


def constant(value: float, steps: int = 400) -> Floats:
    return np.full(steps, value)


# -------------------------------------------------------------- voltage and torque-speed line


@pytest.mark.parametrize("drive", ["static", "rl"])
@pytest.mark.parametrize("volt", [48.0, 1e3, -48.0, -1e3, 20.0])
@pytest.mark.parametrize("speed", [-9.0, -4.0, 0.0, 3.0, 7.0])
def test_voltage_sets_the_torque_speed_line(drive: str, volt: float, speed: float) -> None:
    """tau = k (v - k dq) / r with |v| <= v_0, in all four quadrants."""
    joint = heavy(drive, i_p=1e6)
    p = joint.parameters
    expected = (np.clip(volt, -p.v_0, p.v_0) - p.k_t * p.n * speed) / p.r
    assert at_speed(joint, speed, voltage=constant(volt)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("drive", ["static", "rl"])
@pytest.mark.parametrize("speed", [-9.0, -4.0, 0.0, 3.0, 7.0, 7.6])
@pytest.mark.parametrize("torque", [-150.0, -20.0, 0.0, 20.0, 150.0])
def test_a_torque_command_is_met_as_far_as_the_supply_allows(
    drive: str, speed: float, torque: float
) -> None:
    joint = heavy(drive, i_p=1e6)
    p = joint.parameters
    k = p.k_t * p.n
    low, high = ((sign * p.v_0 - k * speed) / p.r for sign in (-1.0, 1.0))
    expected = np.clip(torque / k, low, high)
    assert at_speed(joint, speed, torque=torque) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(("drive", "factor"), [("static", 1.0), ("rl", 1.0), ("dq", 1.5)])
def test_no_load_speed(drive: str, factor: float) -> None:
    """Full voltage ends at v_0 / (k_t n), whatever the command beyond it.

    On two axes the phase voltage v_0 meets a back-EMF of (2/3) k_t n dq: 3/2 of that speed.
    """
    joint = rigid(drive)
    p = joint.parameters
    for volt in (p.v_0, 3.0 * p.v_0):
        record = joint.simulate(voltage=constant(volt, 3000), dt=1e-3, dt_physics=5e-5)
        assert record["true_dq_m"][-1] == pytest.approx(factor * p.v_0 / (p.k_t * p.n), rel=1e-9)
        assert record["true_i"][-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("drive", ["current", *VOLTAGE_DRIVES])
def test_the_peak_current_bounds_every_drive(drive: str) -> None:
    joint = heavy(drive)
    limit = joint.parameters.i_p
    for sign in (1.0, -1.0):
        assert at_speed(joint, 0.0, torque=sign * 1e4) == pytest.approx(sign * limit, rel=1e-9)
    if drive != "current":
        assert at_speed(joint, 0.0, voltage=constant(48.0)) == pytest.approx(limit, rel=1e-9)


def test_without_peak_current_an_ideal_source_is_not_limited() -> None:
    joint = load_joint("emps", "rigid", effects={})
    record = joint.simulate(np.full(2, 1e6), dt=1e-3)
    assert record["true_dq_m"][-1] == pytest.approx(1e6 / joint.parameters.I_m * 1e-3, rel=2e-3)


# ----------------------------------------------------------------------------- two axes


@pytest.mark.parametrize("angle", np.linspace(0.0, 2 * math.pi, 9))
def test_the_voltage_limit_of_two_axes_is_a_circle(angle: float) -> None:
    """At standstill |i| = v_0 / r in every direction, also in the corners of the square."""
    joint = heavy("dq", i_p=1e6)
    p = joint.parameters
    v_q, v_d = 5 * p.v_0 * math.cos(angle), 5 * p.v_0 * math.sin(angle)
    current = at_speed(joint, 0.0, voltage=np.tile([v_q, v_d], (400, 1)))
    assert current == pytest.approx(p.v_0 / p.r * math.cos(angle), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("speed", [-6.0, -1.0, 0.5, 4.0, 8.0])
@pytest.mark.parametrize("volts", [(30.0, 0.0), (20.0, -25.0), (-10.0, 5.0)])
def test_power_balance_of_two_axes(speed: float, volts: tuple[float, float]) -> None:
    """Steady state: 3/2 (v_q i_q + v_d i_d) = 3/2 r |i|^2 + tau_m dq_m, tau_m = k_t n i_q.

    The factor 3/2 belongs to currents and voltages that keep their amplitude. With i_d from the
    steady d equation, 0 = v_d - r i_d + p w l_a i_q, the back-EMF has to be the one that torque
    implies; any other constant breaks the balance.
    """
    joint = heavy("dq", i_p=1e6)
    p = joint.parameters
    i_q = at_speed(joint, speed, voltage=np.tile(volts, (2000, 1)), steps=2000)
    i_d = (volts[1] + p.p * p.n * speed * p.l_a * i_q) / p.r
    electrical = 1.5 * (volts[0] * i_q + volts[1] * i_d)
    spent = 1.5 * p.r * (i_q**2 + i_d**2) + p.k_t * p.n * i_q * speed
    assert electrical == pytest.approx(spent, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("speed", [0.0, 3.0, -5.0])
def test_a_torque_command_decouples_the_axes(speed: float) -> None:
    joint = heavy("dq")
    p = joint.parameters
    assert at_speed(joint, speed, torque=50.0) == pytest.approx(50.0 / (p.k_t * p.n), rel=1e-6)


# ------------------------------------------------------------------------------ inductance


def test_current_rises_with_the_electrical_time_constant() -> None:
    joint = heavy("rl", i_p=1e6)
    p = joint.parameters
    record = joint.simulate(voltage=constant(10.0), dt=5e-5, dt_physics=5e-5)
    rise = 10.0 / p.r * (1.0 - np.exp(-record.t * p.r / p.l_a))
    np.testing.assert_allclose(record["true_i"], rise, rtol=1e-6, atol=1e-9)


def test_two_axes_without_d_current_rise_like_one_phase() -> None:
    """At standstill the axes do not see each other."""
    one, two = (
        heavy(drive, i_p=1e6).simulate(voltage=constant(10.0), dt=5e-5, dt_physics=5e-5)
        for drive in ("rl", "dq")
    )
    np.testing.assert_allclose(two["true_i"], one["true_i"], rtol=1e-6)


@pytest.mark.parametrize("structure", ["output_fixed_rigid_gearbox", "full_dynamics"])
def test_no_inductance_is_the_limit_of_little(structure: str) -> None:
    """The distance to `static` falls in proportion to l_a, down to where l_a / r is a substep."""
    t = np.arange(300) * 1e-3
    volt = 15.0 * np.sin(2 * np.pi * 4.0 * t)

    def motion(drive: str, l_a: float) -> Floats:
        joint = load_joint(NAME, structure, drive, effects={}, parameters={"l_a": l_a})
        return joint.simulate(voltage=volt, dt_physics=2e-6)["true_dq_m"]

    limit = motion("static", 2e-4)
    distance = [np.abs(motion("rl", l_a) - limit).max() for l_a in (2e-4, 2e-5, 2e-6)]
    assert distance[0] > 6.0 * distance[1]
    assert 6.0 < distance[1] / distance[2] < 14.0
    assert distance[2] < 1e-3 * np.abs(limit).max()


@pytest.mark.parametrize("drive", ["rl", "dq"])
def test_second_order_with_inductance(drive: str) -> None:
    """Currents and mechanics take turns symmetrically: halving the step quarters the error.

    Where the current vector of `dq` slides along the circle of i_p the order is one.
    """
    joint = load_joint(
        NAME, "output_fixed_rigid_gearbox", drive, effects={}, parameters={"i_p": 1e6}
    )
    volt = 15.0 * np.sin(2 * np.pi * 4.0 * np.arange(200) * 1e-3)
    exact, coarse, fine = (
        joint.simulate(voltage=volt, dt_physics=h)["true_q_m"] for h in (2e-6, 1e-4, 5e-5)
    )
    ratio = np.abs(coarse - exact).max() / np.abs(fine - exact).max()
    assert 3.5 < ratio < 4.5
