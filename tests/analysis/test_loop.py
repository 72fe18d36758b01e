"""Closed loops against what is known of them analytically, and against the simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym.analysis import (
    LinearLaw,
    LinearPlant,
    Loop,
    Responses,
    System,
    analyse,
    figures_of,
    identify,
    margins,
    port_shortage,
    probe_law,
    realize,
    step_response,
    stiffest_rendered,
)
from cjt_gym.analysis.probe import CHANNELS, TRUE, linear_joint
from cjt_gym.baselines import OpenLoop, PdFeedForward
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.joint import Joint, load_joint
from cjt_gym.plant import Measurement, SimulatedPlant

Floats = NDArray[np.float64]
DT = 1e-3
STRUCTURE = "output_fixed_rigid_gearbox"


@pytest.fixture(scope="module")
def joint() -> Joint:
    effects = {
        "coulomb": {},
        "command_delay": {"delay": 1.3e-3},
        "measurement_delay": {"delay": 1e-3},
        "velocity_differentiation": {"cutoff": 200.0},
    }
    return load_joint("orange_80_6000", STRUCTURE, effects=effects)


def pd(kp: float = 0.5, kd: float = 0.002) -> PdFeedForward:
    return PdFeedForward(kp, kd, DT)


@dataclass
class Integrator:
    """u = r + sum of errors, with a friction term that no linear model has."""

    rate: float
    friction: float = 0.0
    state: Floats | None = None

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        self.state = None

    def act(self, measurement: Measurement, reference: Floats) -> Floats:
        if self.state is None:
            self.state = np.zeros_like(reference)
        command = reference + self.state + self.friction * np.tanh(measurement.dq_m / 1e-3)
        self.state = self.state + self.rate * DT * (reference - measurement.tau)
        return np.asarray(command)


def test_a_system_is_realised_from_its_impulse_response_with_its_integrator() -> None:
    rng = np.random.default_rng(1)
    a = np.diag([1.0, 0.9, -0.5, 0.2]) + np.triu(rng.normal(size=(4, 4)), 1)
    known = System(a, rng.normal(size=(4, 2)), rng.normal(size=(3, 4)), np.ones((3, 2)), DT)
    found, missed = realize(known.impulse(400), DT)
    assert found.a.shape == (4, 4)
    assert missed < 1e-8
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(found.a)), [-0.5, 0.2, 0.9, 1], atol=1e-8)
    f = np.geomspace(0.1, 400.0, 20)
    np.testing.assert_allclose(found.response(f), known.response(f), rtol=1e-6)


def test_margins_of_an_integrator_with_dead_time() -> None:
    crossover, delay = 2.0 * math.pi * 10.0, 8e-3
    f = np.geomspace(0.02, 500.0, 20000)
    omega = 2.0 * np.pi * f
    loop = crossover / (1j * omega) * np.exp(-1j * omega * delay)
    s = 1.0 / (1.0 + loop)
    found = margins(Responses(f, loop, s, s, s, s, s))
    phase = 0.5 * math.pi - crossover * delay
    assert found.gain == pytest.approx(0.5 * math.pi / (crossover * delay), rel=1e-3)
    assert found.gain_down == 0.0
    assert found.phase == pytest.approx(math.degrees(phase), rel=1e-3)
    assert found.delay == pytest.approx(phase / crossover, rel=1e-3)
    assert found.sensitivity > 1.0 / (2.0 * math.sin(0.5 * phase))


def test_a_probed_law_is_the_law(joint: Joint) -> None:
    law = probe_law(Integrator(30.0), joint, DT)
    assert law.is_linear
    assert law.channels == ("tau",)
    f = np.array([0.1, 3.0, 100.0])
    integral = 30.0 * DT / (np.exp(2j * np.pi * f * DT) - 1.0)
    expected = np.column_stack([1.0 + integral, -integral])
    np.testing.assert_allclose(law.system.response(f)[:, 0], expected, rtol=1e-6)


def test_a_law_that_is_not_linear_is_called_so(joint: Joint) -> None:
    law = probe_law(Integrator(30.0, friction=2.0), joint, DT)
    assert not law.is_linear
    assert "dq_m" in law.channels


def test_the_loop_gain_is_that_of_the_design(joint: Joint) -> None:
    whole = replace(joint, effects={**joint.effects, "command_delay": {"delay": 1e-3}})
    loop, law = analyse(pd(), whole, DT), pd().linear
    assert law is not None
    f = np.geomspace(0.5, 400.0, 50)
    answers = SampledJoint(whole, DT).loop.response(f)[:, :-1]
    expected = -np.sum(law.response(f)[:, 1:] * answers, axis=1)
    np.testing.assert_allclose(loop.responses(f).loop, expected, rtol=1e-6)
    assert loop.plant.left_out == ("coulomb",)


def test_delay_margin_is_the_delay_at_which_the_loop_becomes_unstable(joint: Joint) -> None:
    margin = figures_of(analyse(pd(), joint, DT)).delay_margin
    for share, stable in ((0.9, True), (1.1, False)):
        delay = {"delay": joint.effects["command_delay"]["delay"] + share * margin}
        late = replace(joint, effects={**joint.effects, "command_delay": delay})
        assert analyse(pd(), late, DT, 1e-5).is_stable() == stable
    assert margin > 1e-4


def test_gain_margin_is_the_gain_at_which_the_loop_becomes_unstable(joint: Joint) -> None:
    margin = figures_of(analyse(pd(), joint, DT)).gain_margin
    for share, stable in ((0.98, True), (1.02, False)):
        loop = analyse(pd(0.5 * share * margin, 0.002 * share * margin), joint, DT)
        assert loop.is_stable() == stable
        assert figures_of(loop).stable == stable


def test_steps_and_noise_are_those_of_the_simulation(joint: Joint) -> None:
    noisy = {"noise": {"tau": 0.05}} | {n: v for n, v in joint.effects.items() if n != "coulomb"}
    real = load_joint("orange_80_6000", STRUCTURE, effects=noisy)
    loop, law = analyse(pd(), real, DT), pd()
    plant = SimulatedPlant(real, 16, DT)
    measured = plant.reset(seed=3)
    commands = np.empty((3000, 16))
    for k in range(3000):
        commands[k] = law.act(measured, np.zeros(16))
        measured = plant.step(commands[k])
    assert figures_of(loop).noise_amplification == pytest.approx(
        float(commands[500:].std()) / 0.05, rel=0.03
    )
    quiet = linear_joint(real)
    plant, law = SimulatedPlant(quiet, 1, DT), pd()
    measured = plant.reset(seed=0)
    measured = plant.step(law.act(measured, np.zeros(1)))  # a law begins without a jump
    tau = np.empty(200)
    for k in range(200):
        tau[k] = plant.batch.arrays.tau[0]
        measured = plant.step(law.act(measured, np.ones(1)))
    np.testing.assert_allclose(step_response(loop, 0.2)[:, 0], tau, atol=1e-8)


def test_the_port_of_a_bare_joint_is_spring_and_mass_and_passive(joint: Joint) -> None:
    loop = analyse(OpenLoop(DT), joint, DT)
    p, f = joint.parameters, np.geomspace(0.5, 100.0, 30)
    s = 2j * np.pi * f
    mass = (p.I_m + p.I_g) * s + p.get("d_m", 0.0) + p.get("d_g", 0.0)
    spring = p.k_b / s + p.get("d_gl", 0.0)
    expected = mass * spring / (mass + spring)
    np.testing.assert_allclose(loop.responses(f).port, expected, rtol=0.05)
    assert figures_of(loop).port_passive


def mass_and_damper(mass: float, damping: float) -> LinearPlant:
    """Return a sampled mass with a damper, driven by motor and load alike."""
    rate = math.exp(-damping / mass * DT)
    gain = (1.0 - rate) / damping
    a = np.array([[1.0, (1.0 - rate) * mass / damping], [0.0, rate]])
    b = np.array([[(DT - gain * mass) / damping], [gain]])
    rows = np.zeros((len(CHANNELS + TRUE), 2))
    for name, column in (("q_l", 0), ("dq_l", 1), ("true_q_l", 0), ("true_dq_l", 1)):
        rows[(CHANNELS + TRUE).index(name), column] = 1.0
    system = System(a, np.hstack([b, b]), rows, np.zeros((len(rows), 2)), DT)
    return LinearPlant(system.impulse(600), DT, False, ())


def test_the_stiffest_wall_is_that_of_colgate_and_schenkel() -> None:
    empty = np.zeros((0, 0))
    direct = System(empty, np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)), DT)
    damping = 2.0
    loop = Loop(LinearLaw(direct, (), 0.0), mass_and_damper(0.05, damping))
    assert stiffest_rendered(loop) == pytest.approx(2.0 * damping / DT, rel=0.05)
    with pytest.raises(ConfigurationError, match="must be finite and >= 0"):
        loop.rendering(-1.0)


def test_feedback_costs_passivity_and_an_environment_gives_it_back(joint: Joint) -> None:
    loop = analyse(pd(0.5, 0.004), joint, DT)
    shortage = port_shortage(loop)
    assert shortage > 0.0
    assert stiffest_rendered(loop) == 0.0
    assert stiffest_rendered(loop, environment=2.0 * shortage) > 0.0


@pytest.mark.parametrize("place", ["reference", "disturbance"])
def test_a_linear_loop_is_identified_exactly(place: str, joint: Joint) -> None:
    found = identify(pd(), linear_joint(joint), DT, 3.0, place, low=1.0, phases=2)
    known = analyse(pd(), joint, DT).responses(found.f)
    expected = known.reference if place == "reference" else known.sensitivity
    np.testing.assert_allclose(found.response, expected, rtol=1e-3)
    assert found.distortion < 1e-3


def test_friction_is_seen_as_odd_distortion(joint: Joint) -> None:
    found = identify(pd(), joint, DT, 3.0, low=1.0, phases=4)
    assert found.distortion > 0.02
    assert np.median(found.odd) > 2.0 * np.median(found.even)
    with pytest.raises(UnknownNameError, match="place"):
        identify(pd(), joint, DT, 3.0, "load")
    with pytest.raises(ConfigurationError, match="at least 2"):
        identify(pd(), joint, DT, 3.0, phases=1)
