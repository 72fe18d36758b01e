"""Observers: poles where they were asked for, white innovations, unbiased disturbances."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym import load_joint
from cjt_gym.baselines.observers import (
    LinearObserver,
    TimeVaryingKalman,
    disturbance_observer,
    extended_state_observer,
    kalman_filter,
    luenberger_observer,
    momentum_observer,
)
from cjt_gym.baselines.observers.kalman import noise_model, steady_gain
from cjt_gym.baselines.observers.model import current_observer, design_model
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.plant import SimulatedPlant

Floats = NDArray[np.float64]
DT = 1e-3
FIXED = ("output_fixed", "output_fixed_rigid_gearbox")
FREE = ("full_dynamics", "rigid_gearbox")


def sampled(name: str, structure: str, **effects: dict[str, float]) -> SampledJoint:
    parameters = {} if structure in FIXED else {"I_l": 3.0}
    joint = load_joint(name, structure, effects=effects, parameters=parameters)
    return SampledJoint(joint, DT)


def watch(
    observer: LinearObserver | TimeVaryingKalman,
    model: SampledJoint,
    command: Floats,
    num: int = 1,
) -> dict[str, Floats]:
    """Run an observer on a simulated joint; each estimate has the shape (samples, num)."""
    plant = SimulatedPlant(model.joint, num, DT)
    now, sent = plant.reset(seed=0), np.zeros(num)
    rows = []
    for k, u in enumerate(command):
        rows.append(observer.step(now, sent, np.full(num, k == 0)))
        sent = np.full(num, u)
        now = plant.step(sent)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def wave(samples: int) -> Floats:
    t = DT * np.arange(samples)
    return np.asarray(20.0 * (np.sin(2.0 * np.pi * 3.0 * t) + np.sin(2.0 * np.pi * 11.0 * t)))


@pytest.mark.parametrize("structure", FIXED)
@pytest.mark.parametrize("name", ["orange_80_6000", "lime_50_21000", "pomegranate_160_9000"])
@pytest.mark.parametrize("delay", [0.0, 2e-3])
def test_luenberger_poles_are_those_that_were_asked_for(
    name: str, structure: str, delay: float
) -> None:
    effects = {"command_delay": {"delay": delay}} if delay else {}
    model = sampled(name, structure, **effects)
    order = len(design_model(model).b)
    wanted = -2.0 * np.pi * (60.0 + 10.0 * np.arange(order))
    observer = luenberger_observer(model, wanted.tolist())
    poles = np.sort(np.abs(observer.poles()))
    assert np.all(poles[:-order] < 1e-12)  # of the commands on their way
    np.testing.assert_allclose(poles[-order:], np.sort(np.exp(wanted * DT)), rtol=1e-5)


def test_luenberger_follows_the_joint_exactly_and_forgets_a_wrong_start() -> None:
    model = sampled("orange_80_6000", "output_fixed", command_delay={"delay": 2e-3})
    observer = luenberger_observer(model, (-2.0 * np.pi * np.array([60, 65, 70, 75, 80])).tolist())
    plant = SimulatedPlant(model.joint, 1, DT)
    start = np.array([[2e-3, 1e-3, 0.0, 0.1, 0.1, 0.0]])
    now, sent, errors = plant.reset(start=start), np.zeros(1), []
    for k, u in enumerate(wave(400)):
        found = observer.step(now, sent, np.array([k == 0]))
        state = plant.batch.arrays.state[0]
        errors.append([found["q_ml"][0] - state[0], found["dq_m"][0] - state[3]])
        sent = np.array([u])
        now = plant.step(sent)
    errors_, moved = np.abs(errors), np.array([1e-3, 0.3])
    assert np.all(errors_[0] > 1e-2 * moved)
    assert np.all(errors_[100:] < 1e-6 * moved)


@pytest.mark.parametrize("structure", FIXED)
def test_the_kalman_gain_is_that_of_an_independent_program(structure: str) -> None:
    model = sampled("orange_80_6000", structure)
    design, q, r = noise_model(model, 0.5, 0.05, ("tau", "q_m"))
    scale = np.array([1e3] * (len(q) // 2) + [1.0] * (len(q) - len(q) // 2))
    a = design.a * scale[:, None] / scale
    unit = np.sqrt(np.diag(r))
    expected = control.dlqe(
        a, np.eye(len(a)), design.c / scale / unit[:, None], q * np.outer(scale, scale), np.eye(2)
    )[0]
    np.testing.assert_allclose(
        design.a @ steady_gain(design, q, r),
        expected / unit / scale[:, None],
        rtol=1e-5,
        atol=1e-12,
    )


@pytest.mark.parametrize("structure", FIXED)
def test_innovations_of_the_kalman_filter_are_white_and_as_large_as_it_says(structure: str) -> None:
    torque_noise = 0.5
    joint = sampled("orange_80_6000", structure).joint
    sensors = joint.file.sensors
    noise = {name: float(np.max(sensors[name]["noise"].value)) for name in ("q_m", "tau")}
    model = sampled(
        "orange_80_6000",
        structure,
        command_noise={"std": torque_noise},
        noise={"i": 0.0, "q_g": 0.0, "q_l": 0.0, **noise},
    )
    design, q, _ = noise_model(model, torque_noise, 0.0, ("tau", "q_m"))
    r = np.diag([noise["tau"] ** 2, noise["q_m"] ** 2])
    gain = steady_gain(design, q, r)
    found = watch(current_observer(design, gain), model, wave(6000), num=4)
    spread = control.dlyap(
        design.a @ (np.eye(len(q)) - gain @ design.c),
        q + design.a @ gain @ r @ gain.T @ design.a.T,
    )
    expected = np.diag(design.c @ spread @ design.c.T + r)
    for j, name in enumerate(("tau", "q_m")):
        v = found[f"innovation_{name}"][500:]
        assert np.mean(v**2) == pytest.approx(expected[j], rel=0.06)
        bound = 4.0 / math.sqrt(v.size)  # four standard deviations of a white series
        for lag in (1, 2, 3, 5, 8, 13):
            rho = np.mean(v[lag:] * v[:-lag]) / np.mean(v**2)
            assert abs(rho) < bound, (name, lag)


def test_the_time_varying_filter_begins_bold_and_becomes_the_steady_one() -> None:
    model = sampled("orange_80_6000", "output_fixed_rigid_gearbox", noise={}, quantization={})
    steady = kalman_filter(model, 0.1, 0.02)
    start = np.array([1e-2, 1.0, 5.0])
    varying = TimeVaryingKalman(model, 0.1, 0.02, start)
    slow = watch(steady, model, wave(3000))
    quick = watch(varying, model, wave(3000))
    for name in ("q_ml", "dq_m", "disturbance"):
        late = np.abs(slow[name][2500:] - quick[name][2500:]).max()
        assert late < 1e-3 * np.abs(slow[name]).max(), name


OFFSET = 3.0


@pytest.mark.parametrize("delay", [0.0, 2e-3])
@pytest.mark.parametrize(
    ("name", "sign"),
    [("momentum", -1.0), ("disturbance", 1.0), ("extended", 1.0), ("kalman", 1.0)],
)
@pytest.mark.parametrize("structure", FIXED)
def test_a_constant_disturbance_is_found_without_bias(
    structure: str, name: str, sign: float, delay: float
) -> None:
    """A torque offset at the motor; the momentum observer also sees viscous friction."""
    effects = {"torque_offset": {"torque": OFFSET}}
    if delay:
        effects["command_delay"] = {"delay": delay}
    model = sampled("orange_80_6000", structure, **effects)
    made = {
        "momentum": lambda: momentum_observer(model, 30.0),
        "disturbance": lambda: disturbance_observer(model, 40.0),
        "extended": lambda: extended_state_observer(model, 40.0),
        "kalman": lambda: kalman_filter(model, 0.1, 0.5),
    }
    observer = made[name]()
    rest = np.zeros(3000)
    found = watch(observer, model, rest)["disturbance"]
    assert found[-1, 0] == pytest.approx(sign * OFFSET, rel=1e-3)
    if name != "momentum":  # while it moves, the models that know the damping stay unbiased
        moving = watch(observer, model, wave(3000))["disturbance"][1000:, 0]
        assert np.mean(moving) == pytest.approx(sign * OFFSET, rel=0.02)


@pytest.mark.parametrize("structure", [*FIXED, *FREE])
def test_the_momentum_observer_sees_coulomb_friction(structure: str) -> None:
    model = sampled(
        "orange_80_6000", structure, coulomb={"d_cm": 4.0, "d_cg": 2.0, "d_cl": 0.0, "dq_0": 1e-3}
    )
    observer = momentum_observer(model, 60.0)
    plant = SimulatedPlant(model.joint, 1, DT)
    now, sent, pairs = plant.reset(), np.zeros(1), []
    for k in range(1500):
        seen = observer.step(now, sent, np.array([k == 0]))["disturbance"][0]
        pairs.append((plant.batch.arrays.state[0, 3], seen))
        sent = np.array([60.0 * np.sin(2.0 * np.pi * 1.0 * k * DT)])
        now = plant.step(sent)
    speed, friction = np.array(pairs)[200:].T
    fast = np.abs(speed) > 0.5 * np.abs(speed).max()
    p = model.joint.parameters
    dry = (friction - (p.d_m + p.d_g) * speed) * np.sign(speed)  # viscous friction counts too
    assert np.median(dry[fast]) == pytest.approx(6.0, abs=1.0)


@pytest.mark.parametrize("structure", FREE)
def test_a_free_load_hides_a_constant_disturbance_from_the_joint_torque(structure: str) -> None:
    model = sampled("orange_80_6000", structure)
    with pytest.raises(
        ConfigurationError, match=r"from tau: the mode 0 1/s \(of .*disturbance\) does"
    ):
        luenberger_observer(model, [-100.0] * 6)
    with pytest.raises(ConfigurationError, match="not observable from tau"):
        extended_state_observer(model, 30.0)
    with pytest.raises(ConfigurationError, match=r"cannot be inverted: .* Choose .*: .*dq_l\."):
        disturbance_observer(model, 30.0)
    design_model(model, ("tau", "dq_m", "dq_l"))  # velocities show it


def test_bad_requests_are_refused() -> None:
    model = sampled("orange_80_6000", "output_fixed")
    with pytest.raises(ConfigurationError, match="poles of the Luenberger observer must be 5"):
        luenberger_observer(model, [-100.0] * 3)
    with pytest.raises(ConfigurationError, match="negative real part"):
        luenberger_observer(model, [-1.0, -2.0, -3.0, -4.0, 5.0])
    with pytest.raises(ConfigurationError, match="conjugate pairs"):
        luenberger_observer(model, [-1.0, -2.0, -3.0, -4.0, -5.0 + 1j])
    with pytest.raises(UnknownNameError, match="output of an observer"):
        luenberger_observer(model, [-1.0] * 5, outputs=("i",))
    with pytest.raises(ConfigurationError, match="must be different ones of tau, q_m"):
        luenberger_observer(model, [-1.0] * 5, outputs=("tau", "tau"))
    with pytest.raises(ConfigurationError, match="must be >= 0 N m and one of them > 0"):
        kalman_filter(model, 0.0, 0.0)
    with pytest.raises(ConfigurationError, match=r"must be in \(0, 500\) Hz"):
        momentum_observer(model, 500.0)
    with pytest.raises(ConfigurationError, match="start must have the shape"):
        TimeVaryingKalman(model, 0.1, 0.1, np.zeros(2))
    observer = momentum_observer(model, 30.0)
    with pytest.raises(UnknownNameError, match="Unknown estimate"):
        observer.block(friction=1.0)
    now = SimulatedPlant(model.joint, 2, DT).reset()
    with pytest.raises(ConfigurationError, match="must have the shape"):
        observer.step(now, np.zeros(1), np.ones(1, dtype=np.bool_))
