"""What single laws promise: integral action, anti-windup, optimality, learning, rendering."""

from __future__ import annotations

import control
import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym import load_joint
from cjt_gym.baselines import CONTROLLERS, Controller, default_gains, make_controller
from cjt_gym.baselines.adaptive_friction import AdaptiveFriction
from cjt_gym.baselines.current_control import CurrentController
from cjt_gym.baselines.h_infinity import SLACK, robust_controller, shaped_joint
from cjt_gym.baselines.impedance import Impedance
from cjt_gym.baselines.iterative_learning import IterativeLearning, answer, smoothing
from cjt_gym.baselines.linear_law import LinearController
from cjt_gym.baselines.mpc import ModelPredictive
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.ripple_learning import RippleLearning
from cjt_gym.baselines.robust import PEAK, is_stable, make_bench
from cjt_gym.baselines.state_feedback import quadratic_feedback
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.plant import SimulatedPlant

Floats = NDArray[np.float64]
DT = 1e-3
NAME, STRUCTURE = "orange_80_6000", "output_fixed_rigid_gearbox"
INTEGRAL = (
    "integral_feedforward",
    "pid_feedforward",
    "pid_compensation",
    "pid_inner_dob",
    "pid_outer_dob",
    "mass_dob",
    "momentum_dob",
    "passivity_momentum",
    "cascade",
    "lqi",
    "lqg",
    "observer_feedback",
    "disturbance_rejection",
    "h_infinity",
    "mpc",
    "impedance",
)


def a_joint(structure: str = STRUCTURE, **effects: dict[str, float]) -> Joint:
    return load_joint(NAME, structure, effects=effects)


def track(joint: Joint, law: object, reference: Floats, load: Floats | None = None) -> Floats:
    """Return the joint torque under a controller, shape (samples,)."""
    plant = SimulatedPlant(joint, 1, DT)
    now, torque = plant.reset(seed=0), np.zeros(len(reference))
    for k, r in enumerate(reference):
        command = law.act(now, np.array([r]))  # type: ignore[attr-defined]
        now = plant.step(command, None if load is None else load[k : k + 1])
        torque[k] = plant.batch.arrays.tau[0]
    return torque


SLOWER = {"integral_feedforward": {"ki": 4.0}, "pid_feedforward": {"ki": 4.0}}
"""Integral gains that are through within two seconds, where the default ones are slow."""


@pytest.mark.parametrize("name", INTEGRAL)
def test_integral_action_takes_a_constant_disturbance_away(name: str) -> None:
    joint = a_joint(torque_offset={"torque": 5.0}, command_delay={"delay": 1e-3})
    gains = default_gains(name, joint, DT) | SLOWER.get(name, {})
    torque = track(joint, make_controller(name, joint, DT, gains), np.full(2000, 20.0))
    assert np.mean(torque[-200:]) == pytest.approx(20.0, abs=0.15)


@pytest.mark.parametrize("name", sorted(set(CONTROLLERS) - {"open_loop", "pd"}))
def test_a_reference_beyond_the_limit_leaves_no_trace(name: str) -> None:
    """After half a second at the limit the torque is back as soon as without the limit."""
    joint = a_joint(command_delay={"delay": 1e-3})
    gains = default_gains(name, joint, DT)
    limit = 30.0
    far = np.where(np.arange(1500) < 500, 60.0, 5.0)
    near = np.where(np.arange(1500) < 500, limit, 5.0)
    law = make_controller(name, joint, DT, gains)
    law.torque_limit = limit
    held = track(joint, law, far)[500:]
    free = track(joint, make_controller(name, joint, DT, gains), near)[500:]
    cost = [np.sqrt(np.mean((torque - 5.0) ** 2)) for torque in (held, free)]
    assert cost[0] < 1.5 * cost[1] + 0.5


@pytest.mark.parametrize("structure", ["output_fixed", STRUCTURE])
def test_quadratic_gains_are_those_of_an_independent_program(structure: str) -> None:
    model = SampledJoint(a_joint(structure), DT)
    plant, effort = model.mechanics, 0.3
    scale = np.array([1e3] * (len(plant.b) // 2) + [1.0] * (len(plant.b) // 2))
    c = plant.row("tau") / scale
    expected = control.dlqr(
        plant.a * scale[:, None] / scale, (plant.b * scale)[:, None], np.outer(c, c), effort
    )[0][0]
    found = quadratic_feedback(model, effort, 0.0)
    np.testing.assert_allclose(found.states, expected * scale, rtol=1e-6)


def test_feedback_behind_a_delay_is_that_of_the_state_to_come() -> None:
    prompt = SampledJoint(a_joint("output_fixed"), DT)
    late = SampledJoint(a_joint("output_fixed", command_delay={"delay": 2e-3}), DT)
    one, other = (quadratic_feedback(model, 0.5, 0.0) for model in (prompt, late))
    a, b = prompt.mechanics.a, prompt.mechanics.b
    np.testing.assert_allclose(other.states, one.states @ a @ a, rtol=1e-5)
    np.testing.assert_allclose(other.commands, [one.states @ b, one.states @ a @ b], rtol=1e-5)


@pytest.mark.parametrize("structure", ["full_dynamics", "rigid_gearbox"])
def test_a_free_joints_torque_cannot_be_held(structure: str) -> None:
    model = SampledJoint(a_joint(structure), DT)
    with pytest.raises(ConfigurationError, match="No command holds a joint torque"):
        quadratic_feedback(model, 1.0, 0.0)


@pytest.mark.parametrize("delay", [0.0, 2e-3])
def test_the_h_infinity_norm_is_below_gamma_and_near_its_bound(delay: float) -> None:
    effects = {"command_delay": {"delay": delay}} if delay else {}
    shaped, _ = shaped_joint(SampledJoint(a_joint("output_fixed", **effects), DT), 3.0, 1.0)
    feedback, gamma = robust_controller(*shaped)
    w = np.geomspace(1e-2, 1e6, 4000)
    plant, k = (np.ravel(control.ss(*one)(1j * w)) for one in (shaped, feedback))
    sensitivity = 1.0 / (1.0 + plant * k)
    rows = np.sqrt(1.0 + np.abs(k) ** 2) * np.sqrt(1.0 + np.abs(plant) ** 2)
    norm = np.max(rows * np.abs(sensitivity))
    assert 0.85 * gamma < norm < gamma * (1.0 + 1e-6)


def test_the_least_gamma_is_that_of_an_independent_program() -> None:
    """The closed form against the iteration of SLICOT (SB10AD) on the generalised plant."""
    pytest.importorskip("slycot")
    (a, b, c, d), _ = shaped_joint(SampledJoint(a_joint("output_fixed"), DT), 3.0, 1.0)
    _, gamma = robust_controller(a, b, c, d)
    none, through = np.zeros((len(a), 1)), float(d[0, 0])
    plant = control.ss(
        a,
        np.hstack([none, b, b]),  # output disturbance, input disturbance, command
        np.vstack([c, none.T, c]),  # torque, command, torque
        [[1.0, through, through], [0.0, 0.0, 1.0], [1.0, through, through]],
    )
    assert gamma / SLACK == pytest.approx(control.hinfsyn(plant, 1, 1)[2], rel=1e-6)


def test_predictive_control_is_quadratic_where_no_limit_acts() -> None:
    joint = a_joint(command_delay={"delay": 1e-3})
    gains = {"effort": 0.05, "drift": 1.0}
    reference = np.where(np.arange(300) < 150, 20.0, -10.0)
    free = [track(joint, make_controller(n, joint, DT, gains), reference) for n in ("lqg", "mpc")]
    np.testing.assert_allclose(free[0], free[1], rtol=0, atol=1e-6)


def test_predictive_control_is_better_where_a_limit_acts_again_and_again() -> None:
    """Where a limit acts once, right after a step, cutting off a command is the best plan too."""
    joint = a_joint(command_delay={"delay": 1e-3})
    reference = np.where(np.arange(300) < 150, 20.0, -20.0)
    costs = []
    for name in ("lqg", "mpc"):
        law = make_controller(name, joint, DT, {"effort": 0.003, "drift": 1.0})
        law.torque_limit = 22.0
        costs.append(np.mean((track(joint, law, reference) - reference) ** 2))
    assert costs[1] < 0.95 * costs[0]


def test_predictive_control_solves_its_program() -> None:
    """The commands are those of a program that SciPy solves in its own way."""
    from scipy.optimize import lsq_linear

    joint = a_joint()
    law = ModelPredictive(SampledJoint(joint, DT), 0.05, 1.0, 25.0)
    rng = np.random.default_rng(1)
    root = np.linalg.cholesky(law._hessian).T
    for _ in range(20):
        error, shift = rng.normal(size=2) * [5e-3, 0.5], float(rng.normal() * 10.0)
        target = -np.linalg.solve(root.T, law._slope @ error)
        low, high = -25.0 - shift, 25.0 - shift
        expected = lsq_linear(root, target, (low, high), tol=1e-12).x[0]
        assert law._solve(error, shift) == pytest.approx(expected, abs=1e-3)


def test_the_friction_level_is_learnt() -> None:
    joint = a_joint(coulomb={"d_cm": 4.0, "d_cg": 2.0, "d_cl": 0.0, "dq_0": 0.002})
    law = make_controller("adaptive_friction", joint, DT)
    assert isinstance(law, LinearController)
    assert isinstance(law.addition, AdaptiveFriction)
    t = DT * np.arange(2000)
    reference = 40.0 * np.sin(2.0 * np.pi * 2.0 * t)
    learning = track(joint, law, reference)
    assert law.addition.level[0] == pytest.approx(6.0, rel=0.25)
    gains = default_gains("adaptive_friction", joint, DT) | {"share": 0.0}
    without = track(joint, make_controller("adaptive_friction", joint, DT, gains), reference)
    error = [np.sqrt(np.mean((one - reference)[1500:] ** 2)) for one in (learning, without)]
    assert error[0] < 0.8 * error[1]


def test_known_friction_is_fed_forward() -> None:
    joint = a_joint(coulomb={})
    t = DT * np.arange(1000)
    reference = 40.0 * np.sin(2.0 * np.pi * 2.0 * t)
    gains = default_gains("friction_feedforward", joint, DT)
    error = []
    for share in (0.8, 0.0):
        law = make_controller("friction_feedforward", joint, DT, gains | {"share": share})
        error.append(np.sqrt(np.mean((track(joint, law, reference) - reference)[500:] ** 2)))
    assert error[0] < 0.7 * error[1]


def test_ripple_is_learnt_over_the_angle() -> None:
    """The load turns under a joint that holds its torque, and cogging passes by."""
    joint = a_joint(cogging={"f": (480.0,), "a": (1.5,), "b": (0.8,)})
    gains = default_gains("ripple_learning", joint, DT) | {"rate": 8.0}
    law = make_controller("ripple_learning", joint, DT, gains)
    assert isinstance(law, LinearController)
    assert isinstance(law.addition, RippleLearning)
    np.testing.assert_array_equal(law.addition.periods, [480.0])
    samples = 3000
    load = np.full(samples, 0.1)
    torque = track(joint, law, np.zeros(samples), load)
    early, late = np.std(torque[150:600]), np.std(torque[-600:])
    assert late < 0.5 * early


TRIAL = 300
AGAIN = 20.0 * np.sin(2.0 * np.pi * np.arange(TRIAL) / TRIAL) ** 3
"""A trial of 0.3 s, from rest to rest."""


def errors_of_trials(joint: Joint, law: object, reference: Floats) -> Floats:
    torque = track(joint, law, reference)
    return np.sqrt(np.mean((torque - reference).reshape(-1, TRIAL) ** 2, axis=1))


def learner(joint: Joint, **gains: float) -> Controller:
    usual = default_gains("iterative_learning", joint, DT) | {"trial_s": TRIAL * DT}
    return make_controller("iterative_learning", joint, DT, usual | gains)


def test_a_repeated_reference_is_learnt_from_trial_to_trial() -> None:
    joint = a_joint(coulomb={}, command_delay={"delay": 1e-3})
    error = errors_of_trials(joint, learner(joint), np.tile(AGAIN, 8))
    assert np.all(np.diff(error[:5]) < 0.0)
    assert error[-1] < 0.2 * error[0]


def test_what_was_learnt_is_left_out_and_forgotten_when_the_reference_changes() -> None:
    joint = a_joint(coulomb={}, command_delay={"delay": 1e-3})
    other = 0.5 * AGAIN
    reference = np.concatenate([np.tile(AGAIN, 3), other])
    taught, fresh = (errors_of_trials(joint, learner(joint), x) for x in (reference, other))
    assert taught[-1] < 1.2 * fresh[0]


def test_the_error_shrinks_as_the_convergence_condition_says() -> None:
    """On a joint without friction and a reference of one tone, by |Q (1 - L G)| per trial."""
    joint = a_joint(command_delay={"delay": 1e-3})
    law = learner(joint, rate=0.4, cutoff_hz=20.0)
    assert isinstance(law, LinearController)
    assert isinstance(law.addition, IterativeLearning)
    assert law.linear is not None
    loop = law.addition.model.loop
    f = np.array([2.0 / (TRIAL * DT)])
    scale = answer(loop, law.linear, np.fft.rfftfreq(TRIAL, DT))
    g = answer(loop, law.linear, f)
    step = 0.4 * np.conj(g) / (np.abs(g) ** 2 + (0.1 * np.max(np.abs(scale))) ** 2)
    expected = abs(smoothing(f, 20.0) * (1.0 - step * g))[0]
    tone = 20.0 * np.sin(4.0 * np.pi * np.arange(TRIAL) / TRIAL)
    plant, now = SimulatedPlant(joint, 1, DT), None
    now = plant.reset(seed=0)
    seen = np.zeros((5, TRIAL))
    for trial in seen:
        for k, r in enumerate(tone):
            trial[k] = r - now.tau[0]  # the error that the law sees
            now = plant.step(law.act(now, np.array([r])))
    size = np.abs(np.fft.rfft(seen, axis=1)[:, 2])
    np.testing.assert_allclose(size[2:] / size[1:-1], expected, rtol=0.1)


def test_learning_that_would_not_converge_is_refused() -> None:
    joint = load_joint("lime_50_21000", "output_fixed", effects={"command_delay": {"delay": 2e-3}})
    gains = {"kp": 0.0, "kd": 0.0, "rate": 1.0, "cutoff_hz": 150.0}
    with pytest.raises(ConfigurationError, match=r"would not converge.*Lower cutoff_hz"):
        make_controller("iterative_learning", joint, DT, gains)


def test_the_port_is_the_spring_that_was_asked_for() -> None:
    """The load is moved slowly: what it feels is the rendered stiffness."""
    joint = a_joint(command_delay={"delay": 1e-3})
    gains = default_gains("impedance", joint, DT) | {"stiffness": 200.0, "damping": 5.0}
    law = make_controller("impedance", joint, DT, gains)
    assert isinstance(law, Impedance)
    speed = np.where(np.arange(1500) < 500, 0.2, 0.0)
    torque = track(joint, law, np.zeros(1500), speed)
    assert np.mean(torque[-200:]) == pytest.approx(-200.0 * 0.1, rel=0.02)


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_default_gains_are_robust_on_the_linear_joint(name: str) -> None:
    """|S| at the command stays below its limit, with all delays and filters of the joint."""
    joint = a_joint(
        command_delay={"delay": 1e-3},
        measurement_delay={"delay": 1e-3},
        velocity_differentiation={"cutoff": 200.0},
        torque_filter={"cutoff": 300.0},
        current_lag={"bandwidth": 400.0},
    )
    law = make_controller(name, joint, DT)
    if law.linear is None:
        return
    bench = make_bench(SampledJoint(joint, DT))
    assert all(is_stable(loop, law.linear) for loop in (bench.nominal, *bench.others))
    answer = law.linear.response(bench.f)[:, 1:]
    peak = np.max(np.abs(1.0 / (1.0 - np.sum(answer * bench.plant[:, :-1], axis=1))))
    assert peak <= PEAK


@pytest.mark.parametrize("effects", [{}, {"velocity_differentiation": {"cutoff": 100.0}}])
def test_the_loop_model_is_what_the_simulator_does(effects: dict[str, dict[str, float]]) -> None:
    """The closed loop's matrix predicts the response of the simulated joint to an offset."""
    more = {"command_delay": {"delay": 2e-3}, "torque_filter": {"cutoff": 150.0}}
    joint = a_joint("output_fixed", **effects, **more)
    model = SampledJoint(joint, DT)
    gains = {"shaping": 1.3, "damping": 10.0}
    law = make_controller("passivity", joint, DT, gains)
    assert law.linear is not None
    plant = SimulatedPlant(joint, 1, DT)
    now = plant.reset()
    measured = []
    for k in range(200):
        command = law.act(now, np.zeros(1))
        measured.append(now.tau[0])
        now = plant.step(command + 10.0 * (k == 0))
    loop = model.loop
    a, _, _ = loop.closed(law.linear)
    x = np.zeros(len(a))
    expected = []
    for k in range(200):
        expected.append(loop.c[0] @ x[: len(loop.b)])
        x = a @ x
        if k == 0:
            x[len(loop.b) + len(law.linear.c)] += 10.0
    np.testing.assert_allclose(measured, expected, rtol=0, atol=2e-6 * np.abs(expected).max())


def test_the_current_controller_refuses_what_it_cannot_do() -> None:
    with pytest.raises(ConfigurationError, match="needs a voltage drive, got drive 'current'"):
        CurrentController(a_joint(), 1e-4, 100.0)
    joint = load_joint(NAME, STRUCTURE, "rl")
    with pytest.raises(ConfigurationError, match=r"bandwidth_hz of CurrentController must be in"):
        CurrentController(joint, 1e-3, 100.0)
    law = CurrentController(joint, 1e-4, 100.0)
    with pytest.raises(ConfigurationError, match="must have one shape"):
        law.act(np.zeros(2), np.zeros((1, 2)), np.zeros(1), np.ones(1, dtype=np.bool_))


def test_a_loop_that_is_too_slow_is_refused() -> None:
    joint = a_joint(command_delay={"delay": 0.2})
    with pytest.raises(ConfigurationError, match="must be <= 100 control steps"):
        make_controller("lqi", joint, DT)
    inner = make_controller("passivity", a_joint(), DT).linear
    assert inner is not None
    with pytest.raises(ConfigurationError, match="stiffness of Impedance must be"):
        Impedance(inner, -1.0, 0.0)
