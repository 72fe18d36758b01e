"""Dry friction with breakaway, bristles and load: curves, closed forms, passivity.

Levels are those of `friction.level`: d_c(+/-) + d_s exp(-(dq / v_s)^2) + mu |tau|.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cjt_gym.joint import STRUCTURES, Joint, load_joint
from cjt_gym.joint.kernel.arrays import BRISTLE
from tests.physics.cases import (
    EPS,
    UNDAMPED,
    Effects,
    Floats,
    initial_state,
    log_range,
    maybe,
    states,
    stiffness_number,
    traced,
    valid_parameters,
)

NAME = "orange_80_6000"
H = 1e-4
HELD = 1e3  # [N m]


def levels(symbol: str, body: str, value: float) -> dict[str, float]:
    """Return a friction parameter of one body, the others zero."""
    return {f"{symbol}{key}": value if key == body else 0.0 for key in "mgl"}


# ----------------------------------------------------------------------------- breakaway


def pushed(body: str, torque: float) -> bool:
    """Whether a body with d_c = 2, d_s = 1 moves under a torque, all others being held."""
    others = {f"d_c{key}": 0.0 if key == body else HELD for key in "mgl"}
    effects: Effects = {
        "coulomb": {**others, "dq_0": 0.0},
        "stribeck": {**levels("d_c", body, 2.0), **levels("d_s", body, 1.0), "v_s": 0.05},
    }
    joint = load_joint(NAME, "full_dynamics", effects=effects, parameters={"I_l": 0.5})
    x0 = np.zeros(6)
    if body == "g":  # pushed by the bent bar
        x0[2] = torque / joint.parameters.k_b
    tau_m, load = (np.full(50, torque if body == b else 0.0) for b in ("m", "l"))
    x = states(joint.simulate(tau_m, load, dt=H, dt_physics=H, x0=x0))
    assert not np.delete(x[:, 3:], "mgl".index(body), axis=1).any()
    return bool(x[:, 3 + "mgl".index(body)].any())


@pytest.mark.parametrize("body", ["m", "g", "l"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_body_breaks_away_at_coulomb_plus_stribeck(body: str, side: float) -> None:
    assert not pushed(body, 2.999 * side)
    assert pushed(body, 3.001 * side)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("structure", ["rigid", "output_fixed_rigid_gearbox"])
def test_a_ramp_breaks_away_at_the_full_level(structure: str, side: float) -> None:
    """Against a transmitted torque of 10 N m the level is 2 + 1 + 0.1 * 10 = 4 N m."""
    effects: Effects = {
        "stribeck": {**levels("d_c", "m", 2.0), **levels("d_s", "m", 1.0), "v_s": 0.05, "dq_0": 0},
        "load_friction": {**levels("mu_", "m", 0.1), "dq_0": 0.0},
    }
    joint = load_joint(NAME, structure, effects=effects)
    x0, load = np.zeros(6), np.zeros(2001)
    if structure == "rigid":
        load[:] = -10.0
    else:
        x0[:2] = 10.0 / joint.parameters.k_b
    net = side * np.linspace(0.0, 5.0, 2001)
    x = states(joint.simulate(10.0 + net, load, dt=H, dt_physics=H, x0=x0))
    first = int(np.argmax(x[:, 3] != 0.0)) - 1
    assert abs(net[first]) == pytest.approx(4.0, abs=0.003)
    assert np.sign(x[first + 1, 3]) == side


def test_bristles_hold_below_the_breakaway_and_give_way_above() -> None:
    """Loaded slowly to 97 % they come to rest, deflected by some g / sigma; at 103 % it slips."""
    effects: Effects = {
        "presliding": {**levels("d_c", "m", 2.0), **levels("sigma_", "m", 1e4), "sigma_1": 50.0},
        "stribeck": {**levels("d_c", "m", 0.0), **levels("d_s", "m", 1.0), "v_s": 0.05},
    }
    joint = load_joint(NAME, "rigid", effects=effects)
    for share, slips in ((0.97, False), (1.03, True)):
        tau_m = 3.0 * share * np.minimum(1.0, np.arange(3000) / 2000)
        x = states(joint.simulate(tau_m, dt_physics=H))
        assert (x[-1, 3] > 0.1) == slips
        if not slips:  # the deflection at which bristles of the Dahl kind carry 97 %
            assert 3.0 * share / 1e4 < x[-1, 0] < 8.0 * 3.0 / 1e4
            assert abs(x[-1, 3]) < 1e-4


# ------------------------------------------------------------------ curves at constant speed


def heavy(effects: Effects) -> Joint:
    return load_joint(NAME, "rigid", effects=effects, parameters=UNDAMPED | {"I_m": 1e3})


@pytest.mark.parametrize("body", ["m", "g", "l"])
@pytest.mark.parametrize("speed", [0.01, 0.05, 0.2, 2.0, -0.03, -0.4])
@pytest.mark.parametrize("sigma", [0.0, 1e6])
def test_stribeck_curve(body: str, speed: float, sigma: float) -> None:
    """Momentum lost per step over h is the friction, sliding or behind bristles.

    Bristles lag behind the falling speed by g / sigma, a few micrometres on the rim.
    """
    effects: Effects = {
        "stribeck": {**levels("d_c", body, 2.0), **levels("d_s", body, 1.5), "v_s": 0.05, "dq_0": 0}
    }
    if sigma > 0.0:
        effects["presliding"] = {**levels("d_c", body, 0.0), **levels("sigma_", body, sigma)}
    joint = heavy(effects)
    p = joint.packed()[0][0]
    x = states(joint.simulate(np.zeros(40), x0=[0, 0, 0, speed, speed, speed], dt_physics=1e-3))
    inertia = p["I_m"] + p["I_g"] + p["I_l"]
    torque = inertia * np.diff(x[:, 3])[-1] / 1e-3
    mean = np.diff(x[:, 0])[-1] / 1e-3
    expected = -np.sign(mean) * (2.0 + 1.5 * math.exp(-((mean / 0.05) ** 2)))
    assert torque == pytest.approx(expected, rel=1e-6 if sigma == 0.0 else 2e-5)


def test_dahl_friction_over_the_way_is_an_exponential() -> None:
    """Without Stribeck: z = g / sigma (1 - exp(-sigma x / g)), whatever the speed."""
    g, sigma = 3.0, 2e3
    effects: Effects = {"presliding": {**levels("d_c", "m", g), **levels("sigma_", "m", sigma)}}
    joint = load_joint(NAME, "rigid", effects=effects, parameters=UNDAMPED)
    trace = traced(joint, np.full(150, 0.8), h=1e-4, x0=np.array([0, 0, 0, 0.2, 0.2, 0.2]))
    way, z = trace.x[:, 0], trace.memory[:, BRISTLE]
    assert (np.diff(way) > 0).all()
    assert way[-1] > 3 * g / sigma
    np.testing.assert_allclose(z, g / sigma * -np.expm1(-sigma * way / g), rtol=1e-10, atol=1e-16)


@pytest.mark.parametrize("sigma", [0.0, 1e6])
@pytest.mark.parametrize("body", ["m", "g"])
@pytest.mark.parametrize("torque", [0.0, 5.0, -20.0])
def test_load_friction_grows_with_the_transmitted_torque(
    torque: float, body: str, sigma: float
) -> None:
    """Motor and load pull against each other: the friction is d_c + mu |tau|."""
    effects: Effects = {
        "coulomb": {**levels("d_c", body, 1.0), "dq_0": 0.0},
        "load_friction": {**levels("mu_", body, 0.1), "dq_0": 0.0},
    }
    if sigma > 0.0:
        effects["presliding"] = {**levels("d_c", body, 0.0), **levels("sigma_", body, sigma)}
    joint = heavy(effects)
    x0 = np.array([0, 0, 0, 0.5, 0.5, 0.5])
    v = joint.simulate(np.full(30, torque), np.full(30, -torque), x0=x0, dt_physics=1e-3)[
        "true_dq_m"
    ]
    inertia = sum(joint.packed()[0][0][name] for name in ("I_m", "I_g", "I_l"))
    assert -inertia * np.diff(v)[-1] / 1e-3 == pytest.approx(1.0 + 0.1 * abs(torque), rel=1e-5)


@pytest.mark.parametrize("body", ["m", "g", "l"])
def test_load_friction_holds_what_a_bent_spring_lets_go(body: str) -> None:
    """mu = 0.5 > 1 - share: a body that feels a net torque of 0.4 |tau| stays, 0.6 |tau| goes."""
    effects: Effects = {
        "load_friction": {**levels("mu_", body, 0.5), "dq_0": 0.0},
        "coulomb": {f"d_c{key}": 0.0 if key == body else HELD for key in "mgl"} | {"dq_0": 0.0},
    }
    joint = load_joint(NAME, "full_dynamics", effects=effects, parameters={"I_l": 0.5})
    p, tau = joint.parameters, 10.0
    for net, moves in ((0.4, False), (0.6, True)):
        x0 = np.array([tau / p.k_g, 0.0, 0.0, 0.0, 0.0, 0.0])
        tau_m = load = 0.0
        if body == "m":
            tau_m = (1.0 - net) * tau
        elif body == "g":  # pushed by the gear, held back by the bar
            x0[2] = -(1.0 - net) * tau / p.k_b
        else:
            load = net * tau
        x = states(joint.simulate(np.full(30, tau_m), np.full(30, load), dt=H, dt_physics=H, x0=x0))
        assert x[:, 3 + "mgl".index(body)].any() == moves


# ---------------------------------------------------------------------------- passivity


@st.composite
def dry_friction(draw: st.DrawFn) -> Effects:
    """Return asymmetric levels, breakaway and load friction, with and without bristles."""
    either = [f"d_c{key}{way}" for key in "mgl" for way in ("", "_n")]
    own: dict[str, float] = {name: draw(maybe(log_range(0.01, 20.0))) for name in either}
    dq_0 = {"dq_0": draw(maybe(log_range(1e-4, 0.05)))}
    bristles = {f"sigma_{key}": draw(maybe(log_range(1.0, 1e6))) for key in "mgl"}
    return {
        "coulomb_asym": {**own, **dq_0},
        "stribeck": {f"d_s{key}": draw(maybe(log_range(0.01, 20.0))) for key in "mgl"}
        | {"d_cm": 0.1, "d_cg": 0.0, "d_cl": 0.1, "v_s": draw(log_range(0.005, 2.0)), **dq_0},
        "presliding": {**bristles, "d_cm": 0.0, "d_cg": 0.1, "d_cl": 0.0}
        | {"sigma_1": draw(maybe(log_range(0.01, 100.0)))},
        "load_friction": {f"mu_{key}": draw(maybe(log_range(1e-3, 0.5))) for key in "mgl"} | dq_0,
    }


@settings(max_examples=120, deadline=None, derandomize=True)
@given(
    valid_parameters(),
    st.sampled_from(sorted(STRUCTURES)),
    dry_friction(),
    log_range(1e-5, 1e-3),
    st.integers(0, 2**32 - 1),
)
def test_no_friction_gives_energy(
    parameters: dict[str, float], structure: str, effects: Effects, h: float, seed: int
) -> None:
    """Kinetic energy, springs and bristles together never rise without input."""
    joint = load_joint("generic", structure, effects=effects, parameters=parameters)
    start = initial_state(seed)
    if joint.structure_row.output_fixed:
        start[5] = 0.0
    energy = traced(joint, np.zeros(150), dt=h, x0=start).energy
    allowed = 64.0 * EPS * max(1.0, stiffness_number(joint, h)) * energy[0]
    assert np.diff(energy).max() <= allowed


def rise(energy: Floats) -> float:
    return float(np.diff(energy).max() / energy[0])


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("sigma_1", [0.0, 100.0])
def test_bristles_stay_passive_at_the_largest_step(structure: str, sigma_1: float) -> None:
    """Stiff bristles (sigma h^2 / I of 20) under the largest plausible damping, at 1 ms."""
    effects: Effects = {
        "presliding": {"d_cm": 5.0, "d_cg": 2.0, "d_cl": 1.0, "sigma_m": 1e6, "sigma_g": 1e6}
        | {"sigma_l": 1e6, "sigma_1": sigma_1}
    }
    joint = load_joint(NAME, structure, effects=effects, parameters={"I_l": 0.05})
    start = 0.3 * initial_state(4)
    if joint.structure_row.output_fixed:
        start[5] = 0.0
    assert rise(traced(joint, np.zeros(300), x0=start).energy) <= 1e-12


@pytest.mark.parametrize("speed", [-0.5, 0.5])
def test_bristles_of_a_joint_that_starts_in_motion_are_bent(speed: float) -> None:
    """It is braked by its dry friction at once; one that starts at rest gives way at first."""
    effects = {"presliding": {**levels("d_c", "m", 3.0), **levels("sigma_", "m", 500.0)}}
    joint = load_joint(NAME, "rigid", effects=effects, parameters=UNDAMPED)
    v = joint.simulate(np.zeros(20), dt=1e-3, x0=[0, 0, 0, speed, speed, speed])["true_dq_m"]
    p = joint.packed()[0][0]
    slowed = 3.0 / float(p["I_m"] + p["I_g"] + p["I_l"])
    assert (abs(v[0]) - abs(v[-1])) / 0.019 == pytest.approx(slowed, rel=0.01)
