"""Play, hardening and hysteresis of the springs: closed forms, an event finder, energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipk

from cjt_gym.joint import STRUCTURES, Joint, load_joint
from cjt_gym.joint.kernel.arrays import LOOP
from tests.physics.cases import (
    DT,
    LOSSLESS,
    Effects,
    Floats,
    beyond,
    falls,
    lossless,
    slip_elements,
    states,
    total_energy,
    traced,
)

NAME = "orange_80_6000"
ELASTIC = [name for name in STRUCTURES if name != "rigid"]
GAP, OFFSET = 4e-3, 3e-4
PLAY: Effects = {"backlash": {"gap": GAP, "offset": OFFSET}}
HARD: Effects = {"hardening": {"k_3": 1e8}}
TABLE: Effects = {
    "spring_table": {
        "deflection": (-0.04, -0.02, -0.005, 0.0, 0.01, 0.03),
        "torque": (-300.0, -120.0, -20.0, 0.0, 30.0, 200.0),
    }
}


# -------------------------------------------------------------------------------- backlash


@pytest.mark.parametrize("h", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("structure", ELASTIC)
def test_a_body_at_rest_in_the_gap_stays(structure: str, h: float) -> None:
    """Anywhere in the gap, without creep; a second of rounding is below a picoradian."""
    joint = lossless(structure, PLAY)
    row = joint.structure_row
    x0 = np.zeros(6)
    x0[row.groups.index(0)] = x0[1 if row.groups[0] == row.groups[1] else 0] = OFFSET + 0.4 * GAP
    steps = round(0.5 / h)
    x = states(joint.simulate(np.zeros(steps), dt=h, dt_physics=h, x0=x0))
    assert np.abs(x - x[0]).max() < 1e-12


@pytest.mark.parametrize("structure", ["rigid_gearbox", "output_fixed_rigid_gearbox"])
def test_no_torque_inside_the_gap(structure: str) -> None:
    """Not even of the damper."""
    joint = load_joint(NAME, structure, effects=PLAY, parameters={"I_l": 0.5, "d_gl": 20.0})
    t = np.arange(1000) * DT
    record = joint.simulate(20.0 * np.sin(2 * np.pi * 4.0 * t), dt_physics=1e-4)
    inside = beyond(record["true_q_g"] - record["true_q_l"], joint.packed()[0][0]) == 0.0
    assert 50 < inside.sum() < 950
    assert not record["true_tau"][inside].any()
    assert record["true_tau"][~inside].any()


@pytest.mark.parametrize("structure", ["rigid_gearbox", "output_fixed_rigid_gearbox"])
def test_bouncing_in_the_play_has_its_period(structure: str) -> None:
    """T = 2 (gap / v + pi / omega): free flight, and half an oscillation at either end."""
    joint = lossless(structure, PLAY)
    p, speed, h = joint.parameters, 0.5, 1e-5
    mass = p.I_m + p.I_g
    mass = 1.0 / (1.0 / mass + 1.0 / p.I_l) if structure == "rigid_gearbox" else mass
    period = 2.0 * (GAP / speed + math.pi * math.sqrt(mass / p.k_b))
    x0 = np.array([OFFSET, OFFSET, 0.0, speed, speed, 0.0])
    x = states(joint.simulate(np.zeros(round(5.2 * period / h)), dt=h, dt_physics=h, x0=x0))
    y = x[:, 1] - x[:, 2] - OFFSET
    np.testing.assert_allclose(falls(-y, h), period * np.arange(1, 6), rtol=1e-5)


@pytest.mark.parametrize("structure", ELASTIC)
@pytest.mark.parametrize("h", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize(
    "effects", [PLAY, HARD, PLAY | HARD, TABLE, PLAY | TABLE], ids=lambda effects: " ".join(effects)
)
def test_springs_conserve_energy(effects: Effects, h: float, structure: str) -> None:
    """Impacts included, at every step; 1e-11 is the rounding of 1000 steps."""
    joint = lossless(structure, effects)
    moving = 0.0 if joint.structure_row.output_fixed else 2.0
    x0 = np.array([0.02, 0.01, 0.0, 1.0, -1.0, moving])
    x = states(joint.simulate(np.zeros(1000), dt=h, dt_physics=h, x0=x0))
    energy = total_energy(joint, x)
    assert np.abs(energy - energy[0]).max() <= 1e-11 * energy[0]


def test_impacts_against_an_integrator_with_events() -> None:
    """Each flight and each contact integrated on its own, ended by the event of the border."""
    joint = lossless("output_fixed_rigid_gearbox", {"backlash": {"gap": GAP}}, d_gl=0.0)
    p, torque = joint.parameters, 3.0
    mass, half, y, t = p.I_m + p.I_g, 0.5 * GAP, np.array([0.0, 0.4]), 0.0
    times, found = np.arange(0.0, 0.5, 1e-3), []
    done = 0
    while done < len(times):
        side = 0.0 if abs(y[0]) < half - 1e-12 else math.copysign(1.0, y[0])
        side = 0.0 if side * y[1] < 0.0 and abs(abs(y[0]) - half) < 1e-12 else side

        def slope(_: float, y: Floats, side: float = side) -> list[float]:
            spring = p.k_b * (y[0] - side * half) if side else 0.0
            return [y[1], (torque - spring) / mass]

        def border(_: float, y: Floats, side: float = side) -> float:
            return float(side * y[0] - half if side else half - abs(y[0]))

        border.terminal, border.direction = True, -1.0  # type: ignore[attr-defined]
        flight = solve_ivp(
            slope, (t, times[-1] + 1e-3), y, "DOP853", dense_output=True, events=border,
            rtol=1e-11, atol=1e-13, max_step=2e-3,
        )  # fmt: skip
        while done < len(times) and times[done] <= flight.t[-1]:
            found.append(flight.sol(times[done]))
            done += 1
        t, y = flight.t[-1], flight.y[:, -1]
        y[0] = math.copysign(half, y[0])
    x0 = [0.0, 0.0, 0.0, 0.4, 0.4, 0.0]
    x = states(joint.simulate(np.full(500, torque), x0=x0))[:, [1, 4]]
    exact = np.array(found)
    assert (np.abs(x - exact).max(axis=0) < 1e-4 * np.abs(exact).max(axis=0)).all()


# ------------------------------------------------------------------------------- hardening


@pytest.mark.parametrize("amplitude", [1e-3, 1e-2, 5e-2])
def test_hardening_has_the_period_of_duffing(amplitude: float) -> None:
    """T = 4 K(m) / sqrt(a + b A^2), m = b A^2 / (2 (a + b A^2)) for x'' = -a x - b x^3."""
    k_3, h = 5e6, 1e-5
    joint = lossless("output_fixed_rigid_gearbox", {"hardening": {"k_3": k_3}})
    p = joint.parameters
    a, b = p.k_b / (p.I_m + p.I_g), k_3 / (p.I_m + p.I_g) * amplitude**2
    period = 4.0 * ellipk(0.5 * b / (a + b)) / math.sqrt(a + b)
    x0 = np.array([amplitude, amplitude, 0.0, 0.0, 0.0, 0.0])
    x = states(joint.simulate(np.zeros(round(4.5 * period / h)), dt=h, dt_physics=h, x0=x0))[:, 0]
    np.testing.assert_allclose(falls(x, h), period * (np.arange(5) + 0.25), rtol=1e-5)


# ------------------------------------------------------------------------------ hysteresis

TAU_H, DELTA_H = 2.0, 1e-3


def bent(path: Floats, elements: int = 0) -> tuple[Joint, Floats, Floats]:
    """Bend the bar along a path of deflections by moving the load of a held motor.

    Returns:
        The joint, the torque and the state of the hysteresis after each piece of the path.
    """
    effects: Effects = {
        "spring_hysteresis": {"tau_h": TAU_H, "delta_h": DELTA_H, "elements": elements},
        "coulomb": {"d_cm": 1e4, "d_cg": 0.0, "d_cl": 0.0, "dq_0": 0.0},
    }
    joint = load_joint(NAME, "output_fixed_rigid_gearbox", effects=effects)
    trace = traced(joint, np.zeros(len(path)), -np.diff(path, prepend=0.0) / DT)
    assert not trace.x[:, 0].any()
    loop = trace.memory[1:, LOOP : LOOP + 8]
    if elements == 0:
        return joint, TAU_H * loop[:, 0], loop
    _, stiffness = slip_elements(joint.packed()[0][0])
    return joint, loop[:, : len(stiffness)] @ stiffness, loop


def way(*turns: float, step: float = 2e-5) -> Floats:
    """Return deflections that go straight from each turn to the next, starting at zero."""
    pieces, at = [], 0.0
    for turn in turns:
        count = max(1, round(abs(turn - at) / step))
        pieces.append(np.linspace(at, turn, count + 1)[1:])
        at = turn
    return np.concatenate(pieces)


def test_bouc_wen_has_its_closed_form() -> None:
    """Up: 1 - exp(-x / d); back: a straight line to zero, then exponential to the other side."""
    path = way(2.5e-3, -3e-3)
    _, torque, _ = bent(path)
    turn = int(np.argmax(path)) + 1
    top = -math.expm1(-2.5)
    back = path[turn - 1] - path[turn:]
    expected = np.where(
        back < top * DELTA_H, top - back / DELTA_H, np.expm1(-(back - top * DELTA_H) / DELTA_H)
    )
    np.testing.assert_allclose(torque[:turn], -TAU_H * np.expm1(-path[:turn] / DELTA_H), rtol=1e-9)
    np.testing.assert_allclose(torque[turn:], TAU_H * expected, atol=1e-9)


@pytest.mark.parametrize("elements", [0, 1, 4, 8])
def test_loss_per_cycle_is_the_area_of_the_loop(elements: int) -> None:
    """Energy that the held bar takes from the moved load in a cycle, at coarse steps too.

    Bouc-Wen: the loop's area in closed form. Maxwell: 4 k_j Y_j (A - Y_j) of each element.
    """
    amplitude = 2e-3
    fine = way(*[amplitude, -amplitude] * 2, amplitude, step=2e-6)
    joint, torque, _ = bent(fine, elements)
    cycle = slice(-round(4 * amplitude / 2e-6) - 1, None)
    x, f = fine[cycle], torque[cycle]
    measured = float(0.5 * (f[1:] + f[:-1]) @ np.diff(x))
    if elements == 0:
        top = brentq(lambda s: s + math.expm1(s - 2 * amplitude / DELTA_H), 0.0, 1.0)
        straight, rest = DELTA_H * top, 2 * amplitude - DELTA_H * top
        half = -0.5 * top * straight + rest + DELTA_H * math.expm1(-rest / DELTA_H)
        expected = 2.0 * TAU_H * half
    else:
        y, k = slip_elements(joint.packed()[0][0])
        expected = float((4.0 * k * y * np.maximum(amplitude - y, 0.0)).sum())
    assert measured == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("elements", [1, 3, 8])
def test_maxwell_elements_fit_the_exponential(elements: int) -> None:
    _, torque, _ = bent(way(*(3e-3 * np.arange(1, elements + 1) / elements), step=1.0), elements)
    nodes = 3.0 * np.arange(1, elements + 1) / elements
    expected = TAU_H * np.expm1(-nodes) / np.expm1(-3.0)
    np.testing.assert_allclose(torque, expected, rtol=1e-9)


@pytest.mark.parametrize("elements", [2, 4, 8])
def test_minor_loops_of_maxwell_slip_close_and_are_wiped_out(elements: int) -> None:
    """Return to a turn: the state is that of the turn. Beyond it: as if never turned."""
    _, straight, end = bent(way(1.5e-3, 2.5e-3), elements)
    _, turned, loop = bent(way(1.5e-3, 0.6e-3, 1.1e-3, 0.6e-3, 1.5e-3, 2.5e-3), elements)
    at = [75 - 1, 75 + 45 + 25 + 25 + 45 - 1]
    np.testing.assert_allclose(loop[at[1]], loop[at[0]], atol=1e-12)
    np.testing.assert_allclose(turned[-50:], straight[-50:], rtol=1e-9)
    np.testing.assert_allclose(loop[-1], end[-1], atol=1e-12)
    inner = [75 + 45 - 1, 75 + 45 + 25 + 25 - 1]
    np.testing.assert_allclose(loop[inner[1]], loop[inner[0]], atol=1e-12)


def test_minor_loops_of_bouc_wen_do_not_close() -> None:
    """What it is known for, and why Maxwell slip is there."""
    _, turned, _ = bent(way(1.5e-3, 0.6e-3, 1.5e-3))
    assert abs(turned[-1] - turned[74]) > 0.01 * TAU_H


@pytest.mark.parametrize("elements", [0, 4])
@pytest.mark.parametrize("structure", ELASTIC)
@pytest.mark.parametrize("h", [1e-4, 1e-3])
def test_hysteresis_only_takes_energy(structure: str, elements: int, h: float) -> None:
    joint = lossless(
        structure, {"spring_hysteresis": {"tau_h": 3.0, "delta_h": 1e-3, "elements": elements}}
    )
    moving = 0.0 if joint.structure_row.output_fixed else 2.0
    x0 = np.array([0.02, 0.01, 0.0, 1.0, -1.0, moving])
    energy = traced(joint, np.zeros(round(0.5 / h)), dt=h, x0=x0).energy
    assert np.diff(energy).max() <= 1e-13 * energy[0]
    assert energy[-1] < 0.7 * energy[0]


@pytest.mark.parametrize("elements", [0, 3])
def test_a_loop_that_is_narrow_against_the_motion_of_a_step_only_takes_energy(
    elements: int,
) -> None:
    """It yields either way in a tenth of a step, so that Newton's method alone would jump about."""
    joint = load_joint(
        "generic",
        "output_fixed",
        effects={"spring_hysteresis": {"tau_h": 2.5, "delta_h": 1e-5, "elements": elements}},
        parameters=LOSSLESS | {"I_m": 0.012, "I_g": 1.1e-3, "k_g": 1400.0, "k_b": 21000.0},
    )
    rng = np.random.default_rng(0)
    for _ in range(60):
        start = np.concatenate([rng.normal(0.0, 1e-3, 2), [0], rng.normal(0.0, 0.1, 2), [0]])
        energy = traced(joint, np.zeros(500), x0=start).energy
        assert np.diff(energy).max() <= 1e-11 * energy[0]


@pytest.mark.parametrize("structure", ELASTIC)
@pytest.mark.parametrize(
    "spring", [{"hardening": {"k_3": 5e7}}, {"backlash": {"gap": GAP}}], ids=["hardening", "play"]
)
def test_gear_ripple_does_not_drive_a_swing_faster_than_the_steps(
    structure: str, spring: Effects
) -> None:
    """A share of the transmitted torque comes back, at the same instant: it has a potential.

    The share r(q) makes a torque T(q) one of (1 - r) T, so that energy stays within 1 +- r of what
    it was, and about that at some fifteen radians per step.
    """
    effects = spring | {"gear_ripple": {"f": (5.0,), "a": (0.13,), "b": (0.05,)}}
    joint = lossless(structure, effects, I_m=0.01, I_g=0.01, I_l=0.02, k_b=2e4, k_g=2e4)
    energy = traced(joint, np.zeros(500), x0=np.array([0.1, 0.1, 0.0, 0.0, 0.0, 0.0])).energy
    assert energy.max() < 2.0 * energy[0]
