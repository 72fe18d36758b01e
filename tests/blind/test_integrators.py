"""The fine-step integrator against the event-detecting one, and both against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from cjt_gym.blind.control import Gains
from cjt_gym.blind.plant import Floats, Plant, World
from cjt_gym.blind.run import Run, no_chances, run
from cjt_gym.blind.state import BRISTLE, CURRENT, SIZE, SLIP, SLIPS, WEN, Q, V, initial_state
from tests.blind.joints import LOSSLESS, PLANT, two_tones, world
from tests.blind.reference import Reference, reference_states

SAMPLES = 24
CASES = {
    "stick-slip, locked": (
        "output_fixed_rigid_gearbox",
        PLANT._replace(up_m=8.0, down_m=6.0),
        1e-3,
    ),
    "three sticking bodies": (
        "full_dynamics",
        PLANT._replace(up_m=8.0, down_m=6.0, up_g=2.0, down_g=2.0, up_l=2.0, down_l=2.0),
        1e-3,
    ),
    "stribeck": ("output_fixed", PLANT._replace(up_m=4.0, down_m=4.0, rise_m=4.0, v_s=0.05), 3e-3),
    "backlash in the gear": ("full_dynamics", PLANT._replace(play=5e-4), 3e-3),
    "backlash before the bar": ("output_fixed_rigid_gearbox", PLANT._replace(play=2e-3), 1e-4),
    "hysteresis of the bar": (
        "output_fixed_rigid_gearbox",
        PLANT._replace(slip_torque=3.0, slip_width=2e-3, wen_torque=2.0, wen_width=1e-3),
        1e-4,
    ),
    "rigid with weight": ("rigid", PLANT._replace(up_m=3.0, down_m=3.0, m_g_l=5.0), 1e-4),
    "presliding": ("output_fixed", PLANT._replace(bristle_m=3.0, z_s=3e-4), 1e-4),
    "all that is smooth": (
        "rigid_gearbox",
        PLANT._replace(
            heat_loss=1e-2,
            creep=0.1,
            creep_time=0.1,
            k_3=1e7,
            skew=0.05,
            drag_m=2.0,
            extra_m=4.0,
            cog_a=1.0,
            cog_f=160.0,
            mesh_b=0.05,
            mesh_f=90.0,
            shake_l=1.0,
            shake_f=60.0,
            k_f=900.0,
            I_f=0.05,
            d_f=0.1,
            mu_m=0.05,
            cold=2.0,
            cold_time=0.1,
            cold_travel=0.2,
            spot=2.0,
            spot_f=50.0,
        ),
        1e-3,
    ),
}


def fine(joint: World, command: Floats, step: float = 1e-5) -> Run:
    return run(joint, command, Gains(), no_chances(joint, len(command)), fine_step=step)


def largest_error(joint: World, command: Floats, states: Floats) -> float:
    """Return the largest deviation of positions and velocities, relative to their peaks."""
    reference = reference_states(joint, command)
    moving = slice(Q, V + 4)
    peak = np.abs(reference[:, moving]).max(axis=0) + 1e-12
    return float((np.abs(states - reference)[:, moving].max(axis=0) / peak).max())


@pytest.mark.parametrize("name", CASES)
def test_fine_steps_agree_with_events(name: str) -> None:
    structure, plant, tolerance = CASES[name]
    joint, command = world(structure, plant), two_tones(SAMPLES)
    assert largest_error(joint, command, fine(joint, command).states) < tolerance


def test_events_are_found() -> None:
    joint = world("output_fixed_rigid_gearbox", PLANT._replace(up_m=8.0, down_m=8.0, play=1e-3))
    events = Reference(joint, 3.0)
    events.integrate(initial_state(joint), 0.0, 0.03)
    assert events.switches > 2


def three_masses(p: Plant) -> Floats:
    """Return the matrix of (q_m, q_g, q_l, v_m, v_g, v_l, i, command), shape (8, 8)."""
    kg, kb, a, b = p.k_g, p.k_b, p.d_mg, p.d_gl
    m, g, j, w = p.I_m, p.I_g, p.I_l, 2.0 * np.pi * 1000.0
    torque = p.k_t * p.n
    zero, one = [0.0] * 3, np.eye(3)
    return np.array(
        [
            [*zero, *one[0], 0.0, 0.0],
            [*zero, *one[1], 0.0, 0.0],
            [*zero, *one[2], 0.0, 0.0],
            [-kg / m, kg / m, 0.0, -(a + p.d_m) / m, a / m, 0.0, torque / m, 0.0],
            [kg / g, -(kg + kb) / g, kb / g, a / g, -(a + b + p.d_g) / g, b / g, 0.0, 0.0],
            [0.0, kb / j, -kb / j, 0.0, b / j, -(b + p.d_l) / j, 0.0, 0.0],
            [*zero, *zero, -w, w],
            [*zero, *zero, 0.0, 0.0],
        ]
    )


@pytest.mark.parametrize("step", [1e-5, 5e-6])
def test_linear_joint_is_the_matrix_exponential(step: float) -> None:
    command, joint = two_tones(300), world("full_dynamics")
    states = fine(joint, command, step).states
    advance = expm(three_masses(PLANT) * 1e-3)
    z, exact = np.zeros(8), []
    for value in command:
        z[7] = value
        exact.append(z[:7].copy())
        z = advance @ z
    seen = states[:, [Q, Q + 1, Q + 2, V, V + 1, V + 2, CURRENT]]
    error = np.abs(seen - exact).max(axis=0) / np.abs(exact).max(axis=0)
    assert error.max() < 1e-5 * (step / 1e-5) ** 2


@pytest.mark.parametrize("structure", ["full_dynamics", "rigid_gearbox", "output_fixed"])
def test_energy_is_kept_without_losses(structure: str) -> None:
    joint = world(structure, LOSSLESS, twist=0.01)
    x = fine(joint, np.zeros(500)).states
    q, v = x[:, Q : Q + 3], x[:, V : V + 3]
    inertias = np.array([LOSSLESS.I_m, LOSSLESS.I_g, LOSSLESS.I_l])
    energy = 0.5 * (inertias * v**2).sum(axis=1)
    energy += 0.5 * LOSSLESS.k_b * (q[:, 1] - q[:, 2]) ** 2
    energy += 0.5 * LOSSLESS.k_g * (q[:, 0] - q[:, 1]) ** 2
    assert np.ptp(energy) < 3e-4 * energy[0]


def test_dry_friction_stops_and_holds() -> None:
    """A rigid joint of inertia J at speed v stops after J v / F and stays, bit by bit."""
    level, speed = 8.0, 1.0
    plant = LOSSLESS._replace(up_m=level, down_m=level)
    joint = world("rigid", plant, v=speed)
    x = fine(joint, np.zeros(300)).states
    inertia = plant.I_m + plant.I_g + plant.I_l
    way = 0.5 * inertia * speed**2 / level
    assert x[-1, Q] == pytest.approx(way, rel=1e-4)
    assert np.all(x[int(1e3 * inertia * speed / level) + 2 :, V] == 0.0)
    assert x[-1, Q] == x[-50, Q]


def test_rest_until_breakaway() -> None:
    plant = PLANT._replace(up_m=3.0, down_m=3.0, rise_m=2.0, v_s=0.01)
    joint = world("output_fixed_rigid_gearbox", plant)
    per_ampere = plant.k_t * plant.n
    assert np.all(fine(joint, np.full(100, 4.99 / per_ampere)).states[:, Q] == 0.0)
    assert fine(joint, np.full(100, 5.01 / per_ampere)).states[-1, Q] > 0.0


def slow_cycle(plant: Plant) -> Run:
    """Return a quasi-static cycle of the twist of a bar, from 0 to +, to -, and back to +."""
    t = np.arange(4000) * 1e-3
    torque = 30.0 * np.interp(t, [0.0, 0.8, 2.4, 4.0], [0.0, 1.0, -1.0, 1.0])
    stiff = plant._replace(d_m=200.0)
    joint = world("output_fixed_rigid_gearbox", stiff)
    return fine(joint, torque / (plant.k_t * plant.n), 5e-5)


def test_slip_elements_follow_masing() -> None:
    """Iwan elements: area of the loop is the sum of 4 F_e (X - w_e)."""
    plant = LOSSLESS._replace(slip_torque=3.0, slip_width=1e-3)
    x = slow_cycle(plant).states
    twist, elements = x[:, Q], x[:, SLIP : SLIP + SLIPS]
    widths = 0.5e-3 * np.arange(1, SLIPS + 1)
    torque = (elements / widths).sum(axis=1)
    loop = slice(int(np.argmax(twist)), None)
    area = np.trapezoid(torque[loop], twist[loop])
    amplitude = 0.5 * np.ptp(twist)
    assert area == pytest.approx((4.0 * (amplitude - widths)).sum(), rel=1e-2)


def test_bristles_end_at_their_level() -> None:
    x = slow_cycle(LOSSLESS._replace(bristle_m=2.0, z_s=2e-4)).states
    assert x[800, BRISTLE] == pytest.approx(2e-4, rel=1e-4)
    assert x[2400, BRISTLE] == pytest.approx(-2e-4, rel=1e-4)


def test_bouc_wen_is_a_tangent_hyperbolic() -> None:
    """Loaded from rest, z = w tanh(twist / w)."""
    width = 2e-3
    x = slow_cycle(LOSSLESS._replace(wen_torque=2.0, wen_width=width)).states
    for k in (100, 300, 700):
        assert x[k, WEN] == pytest.approx(width * math.tanh(x[k, Q] / width), rel=1e-3)


def test_backlash_lets_the_motor_move_freely() -> None:
    """Inside the play the only torque is the motor's: q = a t^2 / 2."""
    plant = LOSSLESS._replace(play=0.02)
    joint = world("output_fixed_rigid_gearbox", plant)
    run_ = fine(joint, np.full(30, 0.2))
    a = 0.2 * plant.k_t * plant.n / (plant.I_m + plant.I_g)
    free = np.flatnonzero(run_.states[:, Q] < 0.01)[-1]
    lag = 1.0 / (2.0 * math.pi * 1000.0)
    t = free * 1e-3 - lag
    assert run_.states[free, Q] == pytest.approx(0.5 * a * (t * t + lag * lag), rel=1e-3)
    assert np.all(run_.clean[: free + 1, 4] == 0.0)


@pytest.mark.parametrize("delay", [2e-6, 1.5e-3, 7.25e-3])
def test_late_torque_is_the_earlier_one(delay: float) -> None:
    joint, command = world("output_fixed_rigid_gearbox"), two_tones(200)
    late = replace(joint, sensing=joint.sensing._replace(delay=delay))
    now, then = fine(joint, command).clean[:, 4], fine(late, command).clean[:, 4]
    t = np.arange(200) * 1e-3
    expected = CubicSpline(t, now)(t - delay)
    np.testing.assert_allclose(then[20:], expected[20:], atol=2e-3 * np.abs(now).max())


@pytest.mark.parametrize("delay", [1e-3, 4e-3])
def test_late_command_shifts_everything(delay: float) -> None:
    joint, command = world("full_dynamics"), two_tones(200)
    late = replace(joint, drive=joint.drive._replace(delay=delay))
    shift = round(delay * 1e3)
    now, then = fine(joint, command).states[:, Q], fine(late, command).states[:, Q]
    np.testing.assert_allclose(then[shift:], now[:-shift], atol=1e-9)


def test_state_has_its_size() -> None:
    assert fine(world("rigid"), np.zeros(3)).states.shape == (3, SIZE)
