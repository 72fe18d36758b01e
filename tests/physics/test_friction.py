"""Friction against what is known in closed form: rest, stopping, breakaway, creep, symmetry.

With sharp friction (dq_0 = 0) rest is meant literally: the angle keeps its bits and the velocity
is zero, not small.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from cjt_gym.joint import STRUCTURES, Joint, load_joint
from tests.physics.cases import FREE, UNDAMPED, Effects, Floats, initial_state, states

H = 1e-4


def sharp(**levels: float) -> Effects:
    return {"coulomb": {"d_cm": 0.0, "d_cg": 0.0, "d_cl": 0.0, "dq_0": 0.0} | levels}


def rigid_mass(effects: Effects, damping: float = 0.0) -> tuple[Joint, float]:
    """Return a rigid joint and its inertia [kg m^2]."""
    parameters = UNDAMPED | {"d_m": damping, "d_m_n": damping}
    joint = load_joint("orange_80_6000", "rigid", effects=effects, parameters=parameters)
    p = joint.parameters
    return joint, p.I_m + p.I_g + p.I_l


def run(joint: Joint, tau_m: Floats, x0: Floats | None = None, h: float = H) -> Floats:
    return states(joint.simulate(tau_m, x0=x0, dt=h, dt_physics=h))


# ----------------------------------------------------------------------------- rest


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("name", ["orange_80_6000", "generic"])
def test_less_than_the_coulomb_torque_moves_nothing(name: str, structure: str) -> None:
    joint = load_joint(name, structure, effects=sharp(d_cm=3.0, d_cg=3.0, d_cl=3.0))
    x0 = np.array([0.3, 0.3, 0.3, 0.0, 0.0, 0.0])
    tau_m = 2.999 * np.sign(np.sin(2 * np.pi * 3.0 * np.arange(1000) * 1e-3 + 0.1))
    x = states(joint.simulate(tau_m, x0=x0, dt_physics=1e-4))
    np.testing.assert_array_equal(x, np.tile(x0, (1000, 1)))


@pytest.mark.parametrize("structure", STRUCTURES)
def test_only_the_held_body_needs_friction(structure: str) -> None:
    """Bodies behind a held motor have no reason to move; what they do is rounding."""
    joint = load_joint("orange_80_6000", structure, effects=sharp(d_cm=3.0))
    x = run(joint, np.full(1000, 2.9))
    assert not x[:, [0, 3]].any()
    assert np.abs(x[:, :3]).max() < 1e-13


@pytest.mark.parametrize("structure", ["output_fixed", "output_fixed_rigid_gearbox"])
def test_friction_holds_against_a_loaded_spring(structure: str) -> None:
    """Static friction takes whatever torque is needed, here 0.9 of what it can take."""
    joint = load_joint("orange_80_6000", structure, effects=sharp(d_cm=4.0, d_cg=4.0))
    bend = 0.9 * 4.0 / joint.parameters.k_b
    x0 = np.array([bend, bend, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(run(joint, np.zeros(500), x0), np.tile(x0, (500, 1)))


def test_breakaway_happens_at_the_coulomb_level() -> None:
    joint, inertia = rigid_mass(sharp(d_cm=2.0, d_cg=1.0))
    tau_m = np.linspace(0.0, 6.0, 601)
    x = run(joint, tau_m)
    first = int(np.argmax(tau_m > 3.0))
    assert not x[: first + 1].any()
    accelerated = np.cumsum(np.maximum(tau_m - 3.0, 0.0))[:-1] * H / inertia
    np.testing.assert_allclose(x[1:, 3], accelerated, atol=1e-12)


@pytest.mark.parametrize(
    ("push", "moves"), [(1.9, False), (2.1, True), (-4.9, False), (-5.1, True)]
)
def test_each_direction_has_its_own_level(push: float, moves: bool) -> None:
    levels = {"d_cm": 2.0, "d_cm_n": 5.0, "d_cg": 0.0, "d_cg_n": 0.0}
    joint, _ = rigid_mass({"coulomb_asym": levels | {"dq_0": 0.0}})
    x = run(joint, np.full(100, push))
    assert x.any() == moves
    assert not moves or np.sign(x[-1, 0]) == np.sign(push)


# ------------------------------------------------------------------------- stopping


@pytest.mark.parametrize("h", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("speed", [1.0, -2.3])
def test_stopping_under_coulomb_friction(speed: float, h: float) -> None:
    """q = v^2 I / (2 F), t = v I / F; only the substep of the stop is not exact."""
    joint, inertia = rigid_mass(sharp(d_cm=2.5, d_cg=1.5))
    deceleration = 4.0 / inertia
    time, distance = abs(speed) / deceleration, speed * abs(speed) / (2 * deceleration)
    x = run(joint, np.zeros(int(time / h) + 20), np.array([0.0, 0.0, 0.0, speed, speed, speed]), h)
    stopped = int(np.argmax(x[:, 3] == 0.0))
    assert abs(stopped * h - time) <= h
    assert abs(x[-1, 0] - distance) <= 0.5 * deceleration * h**2
    np.testing.assert_allclose(x[:stopped, 3], speed * (1 - np.arange(stopped) * h / time))


def test_stopping_under_viscous_and_coulomb_friction() -> None:
    """t = I / d ln(1 + d v / F), q = I / d (v - F t / I)."""
    damping, level, speed, h = 5.0, 3.0, 4.0, 1e-4
    joint, inertia = rigid_mass(sharp(d_cm=level), damping)
    time = inertia / damping * math.log1p(damping * speed / level)
    distance = inertia / damping * (speed - level * time / inertia)
    x = run(joint, np.zeros(int(time / h) + 20), np.array([0, 0, 0, speed, speed, speed]), h)
    stopped = int(np.argmax(x[:, 3] == 0.0))
    assert abs(stopped * h - time) <= h
    assert abs(x[-1, 0] - distance) <= 0.5 * level / inertia * h**2


@pytest.mark.parametrize("h", [1e-5, 1e-4, 1e-3])
def test_a_stopping_mass_does_not_chatter(h: float) -> None:
    """Driven against friction and let go: the velocity reaches zero once and stays there."""
    levels = {"d_cm": 4.0, "d_cm_n": 1.0, "d_cg": 0.0, "d_cg_n": 0.0}
    joint, _ = rigid_mass({"coulomb_asym": levels | {"dq_0": 0.0}})
    tau_m = np.where(np.arange(round(0.5 / h)) * h < 0.1, 7.0, -0.99)
    speed = run(joint, tau_m, h=h)[:, 3]
    stopped = int(np.argmax(speed[1:] == 0.0)) + 1
    assert (speed[1:stopped] > 0.0).all()
    assert stopped * h > 0.1
    assert not speed[stopped:].any()


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("h", [1e-5, 1e-4, 1e-3])
def test_every_structure_comes_to_rest(structure: str, h: float) -> None:
    """Friction on all bodies ends all motion for good, with the springs left bent."""
    joint = load_joint("orange_80_6000", structure, effects=sharp(d_cm=3.0, d_cg=2.0, d_cl=1.0))
    start = initial_state(3) * [0.2, 0.2, 0.2, 1.0, 1.0, 1.0]
    x = run(joint, np.zeros(round(1.5 / h)), start, h)
    free = slice(3, 5) if joint.structure_row.output_fixed else slice(3, 6)
    moving = x[:, free].any(axis=1)
    stop = int(np.flatnonzero(moving)[-1]) + 1
    assert stop * h < 1.4
    np.testing.assert_array_equal(x[stop:], np.tile(x[stop], (len(x) - stop, 1)))


def test_a_stopped_joint_starts_again() -> None:
    joint, inertia = rigid_mass(sharp(d_cm=3.0))
    tau_m = np.concatenate([np.full(100, 5.0), np.full(400, 1.0), np.full(100, 5.0)])
    x = run(joint, tau_m)
    assert not x[-101, 3:].any()
    assert x[-1, 3] == pytest.approx(2.0 / inertia * 99 * H, rel=1e-12)


def test_turning_against_unequal_levels() -> None:
    """Pushed back harder than friction holds, the mass turns at once: v = a_1 (t - t_0), a_2 (...).

    The turn falls inside a substep, whose friction is that of the mean: an error of one substep.
    """
    levels = {"d_cm": 4.0, "d_cm_n": 1.0, "d_cg": 0.0, "d_cg_n": 0.0}
    joint, inertia = rigid_mass({"coulomb_asym": levels | {"dq_0": 0.0}})
    before, after, turn = -7.0 / inertia, -2.0 / inertia, inertia / 7.0
    for h in (1e-4, 1e-5):
        x = run(joint, np.full(round(0.1 / h), -3.0), np.array([0, 0, 0, 1.0, 1.0, 1.0]), h)
        left = np.arange(len(x)) * h - turn
        expected = np.where(left < 0.0, before * left, after * left)
        assert np.abs(x[:, 3] - expected).max() <= 5.0 / inertia * h


@pytest.mark.parametrize("push", [2.0, -2.0])
@pytest.mark.parametrize("body", ["m", "l"])
def test_a_rigid_joint_passes_torque_on_to_what_holds_it(body: str, push: float) -> None:
    """Held at the load it carries the motor's torque; held at the motor it carries the load's."""
    joint = load_joint("orange_80_6000", "rigid", effects=sharp(**{f"d_c{body}": 5.0}))
    load = np.full(100, 0.5)
    record = joint.simulate(np.full(100, push), load, dt=H, dt_physics=H)
    assert not states(record).any()
    expected = push if body == "l" else -0.5
    np.testing.assert_allclose(record["true_tau"][1:], expected, rtol=1e-12)


def test_a_rigid_joint_passes_on_what_its_load_needs() -> None:
    """While it moves: inertia, damping and friction of the load, minus what drives it directly."""
    levels = {"d_cm": 0.0, "d_cg": 1.0, "d_cl": 2.0, "dq_0": 0.0}
    damping = {"d_l": 3.0, "d_l_n": 3.0}
    joint = load_joint("generic", "rigid", effects={"coulomb": levels}, parameters=damping)
    record = joint.simulate(np.full(200, 40.0), np.full(200, 1.5), dt=H, dt_physics=H)
    p, v = joint.parameters, record["true_dq_l"]
    middle, acceleration = 0.5 * (v[1:] + v[:-1]), np.diff(v) / H
    expected = p.I_l * acceleration + p.d_l * middle + 2.0 - 1.5
    np.testing.assert_allclose(record["true_tau"][1:], expected, rtol=1e-6)


# --------------------------------------------------------------------- smooth friction


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, -0.7])
def test_smooth_friction_creeps(share: float) -> None:
    """The price of a smooth sign: v = dq_0 atanh(tau / F) under a torque it should hold."""
    dq_0, level = 0.002, 3.0
    joint, _ = rigid_mass({"coulomb": {"d_cm": level, "d_cg": 0.0, "dq_0": dq_0}})
    x = run(joint, np.full(2000, share * level))
    assert x[-1, 3] == pytest.approx(dq_0 * math.atanh(share), rel=1e-9)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_smooth_friction_approaches_the_sharp_one(structure: str) -> None:
    """It creeps where the sharp one holds, at about dq_0: less than dq_0 * 1 s in half a second."""
    t = np.arange(500) * 1e-3
    tau_m = 10.0 * np.sin(2 * np.pi * 3.0 * t)

    def motion(dq_0: float) -> Floats:
        effects = {"coulomb": {"d_cm": 3.0, "d_cg": 3.0, "d_cl": 0.5, "dq_0": dq_0}}
        joint = load_joint("generic", structure, effects=effects)
        return states(joint.simulate(tau_m, dt_physics=2e-5))[:, 0]

    limit = motion(0.0)
    widths = np.array([1e-2, 1e-3, 1e-4])
    distance = np.array([np.abs(motion(dq_0) - limit).max() for dq_0 in widths])
    assert (distance < widths).all()
    assert (distance[1:] < distance[:-1] / 3).all()


# -------------------------------------------------------------------------- symmetry


@pytest.mark.parametrize("dq_0", [0.0, 0.002])
@pytest.mark.parametrize("structure", STRUCTURES)
def test_mirrored_inputs_give_the_mirrored_motion(structure: str, dq_0: float) -> None:
    """Bit for bit: no sign is preferred by equal levels, odd ripple and odd sums."""
    effects = {
        "coulomb": {"d_cm": 2.0, "d_cg": 1.0, "d_cl": 0.5, "dq_0": dq_0},
        "cogging": {"f": (80.0, 240.0), "a": (0.0, 0.0), "b": (0.5, 0.2)},
    }
    joint = load_joint("orange_80_6000", structure, effects=effects)
    rng = np.random.default_rng(5)
    tau_m, load = rng.normal(0.0, 10.0, 300), rng.normal(0.0, 0.5, 300)
    x0 = 0.1 * initial_state(6)
    one = states(joint.simulate(tau_m, load, x0=x0, dt_physics=1e-4))
    other = states(joint.simulate(-tau_m, -load, x0=-x0, dt_physics=1e-4))
    np.testing.assert_array_equal(other, -one)


@pytest.mark.parametrize("structure", FREE)
def test_asymmetric_damping_brakes_each_way_at_its_own_rate(structure: str) -> None:
    """All bodies at one speed decay as exp(-sum(d) t / sum(I)) where every d / I is equal."""
    p = load_joint("generic", structure, effects={}).parameters
    inertia = {"m": p.I_m, "g": p.I_g, "l": p.I_l}
    parameters = {f"d_{b}{n}": 2.0 * value for b, value in inertia.items() for n in ("", "_n")}
    effects = {"viscous_asym": {f"d_{b}_n": 5.0 * value for b, value in inertia.items()}}
    joint = load_joint("generic", structure, effects=effects, parameters=parameters)
    for speed, rate in ((1.0, 2.0), (-1.0, 5.0)):
        x = run(joint, np.zeros(1001), np.array([0, 0, 0, speed, speed, speed]))
        # the extra damping acts at the mean velocity of a substep: an error of (rate h)^2 / 12
        np.testing.assert_allclose(x[-1, 3:], speed * math.exp(-rate * 0.1), rtol=1e-7)
