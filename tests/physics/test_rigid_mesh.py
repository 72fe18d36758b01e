"""A rigid joint whose friction and ripple depend on the torque that it transmits at that instant.

What the gear transmits is tau = I_l ddq + d_l dq + friction of the load + weight and contact - load
torque; friction of every body grows by mu |tau|.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cjt_gym.joint import Joint, load_joint
from cjt_gym.joint.kernel.arrays import MESH
from tests.physics.cases import UNDAMPED, Effects, Floats, Trace, log_range, maybe, states, traced

BODIES = {"I_m": 0.3, "I_g": 0.1, "I_l": 0.6} | UNDAMPED


def rigid(effects: Effects, parameters: dict[str, float]) -> Joint:
    return load_joint("generic", "rigid", effects=effects, parameters=parameters)


def load_friction(m: float, g: float, load: float, dq_0: float) -> Effects:
    return {
        "load_friction": {"mu_m": m, "mu_g": g, "mu_l": load, "dq_0": dq_0},
        "coulomb": {"d_cm": 0.0, "d_cg": 0.0, "d_cl": 0.0, "dq_0": dq_0},
    }


def acceleration(
    side: float, motor: float, load: float, mu: tuple[float, float, float]
) -> tuple[float, float]:
    """Return acceleration and transmitted torque of BODIES that slide, by trying both signs."""
    inertia = BODIES["I_m"] + BODIES["I_g"] + BODIES["I_l"]
    for sign in (1.0, -1.0):
        # inertia a + side sum(mu) sign tau = motor + load;  I_l a - (1 - side mu_l sign) tau = load
        matrix = [
            [inertia, side * sum(mu) * sign],
            [BODIES["I_l"], side * mu[2] * sign - 1.0],
        ]
        a, tau = np.linalg.solve(matrix, [motor + load, load])
        if tau * sign >= 0.0:
            return float(a), float(tau)
    raise AssertionError("one of the signs holds")


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("motor", "load"), [(8.0, 0.0), (3.0, -9.0), (-7.0, 2.0), (0.0, 5.0)])
@pytest.mark.parametrize("mu", [(0.4, 0.0, 0.0), (0.0, 0.0, 0.5), (0.3, 0.3, 0.3)])
def test_sliding_accelerates_as_in_closed_form(
    side: float, motor: float, load: float, mu: tuple[float, float, float]
) -> None:
    a, tau = acceleration(side, motor, load, mu)
    joint, steps, dt = rigid(load_friction(*mu, dq_0=0.0), BODIES), 40, 1e-3
    start = side * 1.0
    record = joint.simulate(
        np.full(steps, motor), np.full(steps, load), dt=dt, x0=[0, 0, 0, start, start, start]
    )
    np.testing.assert_allclose(record["true_dq_m"], start + a * dt * np.arange(steps), rtol=1e-9)
    np.testing.assert_allclose(record["tau"][1:], tau, rtol=1e-8)


@pytest.mark.parametrize("mu", [0.05, 0.5])
def test_against_an_integrator(mu: float) -> None:
    """A pendulum with damping, pushed through several reversals; second order in the step."""
    dq_0, weight, inertia = 0.2, 4.0, 1.0
    drag = {"d_m": 0.3, "d_m_n": 0.3, "d_l": 0.8, "d_l_n": 0.8}
    effects = load_friction(mu, 0.0, mu, dq_0) | {"gravity": {"torque": weight, "angle": 0.0}}
    joint = rigid(effects, BODIES | drag)
    motor = np.repeat([6.0, -6.0, 1.0, 9.0], 100)

    def slope(_: float, y: Floats, torque: float) -> list[float]:
        q, v = y
        s = math.tanh(v / dq_0)

        def a_of(tau: float) -> float:
            force = torque - 1.1 * v - weight * math.sin(q) - 2.0 * mu * abs(tau) * s
            return force / inertia

        def gap(tau: float) -> float:
            on_load = 0.8 * v + weight * math.sin(q) + mu * abs(tau) * s
            return BODIES["I_l"] * a_of(tau) + on_load - tau

        return [v, a_of(float(brentq(gap, -1e3, 1e3, xtol=1e-13)))]

    exact, y = np.empty((len(motor), 2)), np.zeros(2)
    for k in range(0, len(motor), 100):
        at = np.arange(101) * 1e-3
        found = solve_ivp(
            slope, (0.0, 0.1), y, "DOP853", at, args=(motor[k],), rtol=1e-9, atol=1e-12
        )
        exact[k : k + 100], y = found.y.T[:-1], found.y[:, -1]
    assert (np.diff(np.sign(exact[1:, 1])) != 0).sum() >= 2
    errors = [
        np.abs(states(joint.simulate(motor, dt_physics=h))[:, [0, 3]] - exact).max()
        for h in (1e-3, 1e-4)
    ]
    assert errors[1] < 1e-5
    assert errors[1] < 0.02 * errors[0]


# ------------------------------------------------------------------ friction of what is transmitted


def balances(
    joint: Joint, trace: Trace, h: float, motor: float, load: float, outside: Callable[..., float]
) -> None:
    """Check the momentum of every step: friction is mu |tau| of the torque that it leads to.

    What is outside (weight, contact) is the difference of its potential over the way.
    """
    p = joint.packed()[0][0]
    inertia, mu = p["I_m"] + p["I_g"] + p["I_l"], p["mu_m"] + p["mu_g"] + p["mu_l"]
    for k in range(len(trace.x) - 1):
        (q, v), (q_end, v_end) = trace.x[k, [0, 3]], trace.x[k + 1, [0, 3]]
        tau, mean, a = trace.memory[k + 1, MESH], (q_end - q) / h, (v_end - v) / h
        if mean == 0.0 or (p["dq_0"] == 0.0 and v_end == 0.0):
            continue  # held
        s = math.tanh(mean / p["dq_0"]) if p["dq_0"] > 0.0 else math.copysign(1.0, mean)
        against = outside(p, q, q_end)
        size = inertia * (abs(v) + abs(v_end)) / h + abs(motor) + abs(load) + abs(against) + 1.0
        friction = motor + load - against - inertia * a
        assert friction == pytest.approx(mu * abs(tau) * s, abs=1e-7 * size)
        passed_on = p["I_l"] * a + p["mu_l"] * abs(tau) * s + against - load
        assert tau == pytest.approx(passed_on, abs=1e-7 * size)


def contact_mean(p: Floats, q: float, q_end: float) -> float:
    """Return the mean of a contact that bends as k x^e, over the way from q to q_end [N m]."""
    k, e = p["contact_stiffness"], p["contact_exponent"] + 1.0
    depths = [max(0.0, at - p["contact_position"]) for at in (q, q_end)]
    return float(k / e * (depths[1] ** e - depths[0] ** e) / (q_end - q))


LIGHT = {"I_m": 1.3e-4, "I_g": 2.4e-3, "I_l": 1.5e-4} | UNDAMPED
STIFF: Effects = {
    "contact": {"stiffness": 6.4e5, "exponent": 1.1, "damping": 0.0, "position": -0.67}
}


@pytest.mark.parametrize("dq_0", [0.0, 6e-5])
@pytest.mark.parametrize("mu", [0.1, 0.4])
def test_a_stiff_contact_throws_a_light_joint_off(mu: float, dq_0: float) -> None:
    """Motor and gear take mu of what they transmit, whatever the step: no longer than a swing.

    The load moves by I ddq = -F + mu tau with tau = F + I_l ddq, so that of the energy of the
    contact I (1 - mu) / (I - mu I_l) is left.
    """
    joint = rigid(load_friction(mu, 0.0, 0.0, dq_0) | STIFF, LIGHT)
    trace = traced(joint, np.zeros(5), x0=np.array([0.02, 0.02, 0.02, 0.0, 0.0, 0.0]))
    inertia = LIGHT["I_m"] + LIGHT["I_g"] + LIGHT["I_l"]
    left = inertia * (1.0 - mu) / (inertia - mu * LIGHT["I_l"])
    assert trace.energy[1:] == pytest.approx(left * trace.energy[0], rel=1e-9)
    balances(joint, trace, 1e-3, 0.0, 0.0, contact_mean)


def test_a_light_joint_between_a_stiff_contact_and_strong_friction() -> None:
    """The contact swings in a fourteenth of the step, and friction grows with its force.

    An error of the transmitted torque changes the motion by so much that the torque it leads to
    is wrong by twenty times that: it has to be solved for.
    """
    effects = load_friction(0.4, 0.0, 0.0, 6e-5) | STIFF
    effects["coulomb"] |= {"d_cg": 6.0, "d_cl": 2.0}
    effects["stribeck"] = {"d_cm": 0.0, "d_cg": 0.0, "d_cl": 0.0, "d_sm": 0.0, "d_sl": 0.0}
    effects["stribeck"] |= {"d_sg": 8.0, "v_s": 0.02, "dq_0": 6e-5}
    effects["gravity"] = {"torque": 43.0, "angle": 0.0}
    joint = rigid(effects, LIGHT | {"d_g": 4.4, "d_g_n": 4.4, "d_l": 0.8, "d_l_n": 0.8})
    trace = traced(joint, np.zeros(500), x0=np.array([0.02, 0.02, 0.02, 0.5, 0.5, 0.5]))
    assert trace.energy[0] > 1e5
    assert np.diff(trace.energy).max() <= 1e-9 * trace.energy[0]
    assert trace.energy[-1] < 1e-3 * trace.energy[0]
    assert abs(trace.memory[-1, MESH]) < 43.0


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    st.tuples(*[log_range(1e-3, 1.0)] * 3),
    st.tuples(log_range(0.01, 0.5), *[maybe(log_range(0.01, 0.5))] * 2),
    maybe(log_range(1e-5, 0.05)),
    st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-2.0, 2.0)),
    maybe(log_range(1.0, 1e6)),
)
def test_friction_is_that_of_the_transmitted_torque(
    inertias: tuple[float, float, float],
    mu: tuple[float, float, float],
    dq_0: float,
    pushed: tuple[float, float, float],
    stiffness: float,
) -> None:
    """Up to mu = 1.5, where a joint may have several solutions: it takes one of them."""
    motor, load, v = pushed
    effects = load_friction(*mu, dq_0=dq_0)
    if stiffness > 0.0:
        effects["contact"] = {"stiffness": stiffness, "exponent": 1.5, "damping": 0.0}
        effects["contact"]["position"] = 0.0
    joint = rigid(effects, UNDAMPED | dict(zip(("I_m", "I_g", "I_l"), inertias, strict=True)))
    p = joint.packed()[0][0]
    commands = np.full(60, motor / (p["k_t"] * p["n"]))
    assert abs(commands[0]) <= p["i_p"]
    x0 = np.array([0.0, 0.0, 0.0, v, v, v])
    trace = traced(joint, commands, np.full(60, load), x0=x0)
    outside = contact_mean if stiffness > 0.0 else lambda *_: 0.0
    balances(joint, trace, 1e-3, motor, load, outside)
    work = (motor + load) * np.diff(trace.x[:, 0])
    size = trace.energy.max() + np.abs(work).max()
    assert (np.diff(trace.energy) - work).max() <= 1e-9 * size + 1e-15


# --------------------------------------------------------------------------------------- at rest


def test_a_balanced_joint_needs_no_friction() -> None:
    """Motor and weight balance at 10 N m: that is what the gear transmits, friction or not."""
    effects: Effects = {
        "coulomb": {"d_cm": 2.0, "d_cg": 0.0, "d_cl": 3.0, "dq_0": 0.0},
        "gravity": {"torque": 10.0, "angle": 0.0},
    }
    x0 = [0.5 * math.pi] * 3 + [0.0] * 3
    record = rigid(effects, BODIES).simulate(np.full(20, 10.0), x0=x0, dt_physics=1e-3)
    np.testing.assert_allclose(record["tau"][1:], 10.0, rtol=1e-9)
    assert not states(record)[:, 3:].any()


def test_bodies_share_the_friction_that_holds_them() -> None:
    """The motor pushes with 2.5 of 5 N m: the load's friction takes 3/5, so much is transmitted."""
    effects: Effects = {"coulomb": {"d_cm": 2.0, "d_cg": 0.0, "d_cl": 3.0, "dq_0": 0.0}}
    record = rigid(effects, BODIES).simulate(np.full(20, 2.5))
    np.testing.assert_allclose(record["tau"][1:], 1.5, rtol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_pushed_joint_breaks_away_at_mu_times_the_load(side: float) -> None:
    """Against a load of 10 N m the motor's friction holds 10 +- 0.3 * 10 N m."""
    joint, load = rigid(load_friction(0.3, 0.0, 0.0, 0.0), BODIES), np.full(30, -10.0)
    for net, moves in ((2.99, False), (3.01, True)):
        x = states(joint.simulate(np.full(30, 10.0 + side * net), load))
        assert bool(x[:, 3].any()) == moves
        assert not moves or np.sign(x[-1, 3]) == side
