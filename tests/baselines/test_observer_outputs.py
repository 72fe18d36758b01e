"""Observers take any measured signals of any structure, or say which mode does not show there."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym import load_joint
from cjt_gym.baselines.linear_law import MEASURED
from cjt_gym.baselines.observers import (
    LinearObserver,
    disturbance_observer,
    kalman_filter,
    luenberger_observer,
)
from cjt_gym.baselines.observers.luenberger import apart
from cjt_gym.baselines.observers.model import design_model, output_noise
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import STRUCTURES
from cjt_gym.plant import Measurement, SimulatedPlant

Floats = NDArray[np.float64]
DT, OFFSET = 1e-3, 3.0
FIXED = ("output_fixed", "output_fixed_rigid_gearbox")
SETS = (*((name,) for name in MEASURED), ("tau", "q_m"), ("q_m", "q_l"), ("tau", "dq_m"), MEASURED)
EVERY = [(s, o) for s, o in product(STRUCTURES, SETS)]


def a_joint(structure: str, torque: float = OFFSET) -> SampledJoint:
    """A joint with a load and with dampers everywhere, whose modes are slower than its samples."""
    load = {} if structure in FIXED else {"I_l": 3.0}
    gear = {"d_mg": 500.0} if structure in ("full_dynamics", "output_fixed") else {}
    bar = {} if structure == "rigid" else {"d_gl": 20.0}
    effects = {"torque_offset": {"torque": torque}, "command_delay": {"delay": DT}}
    joint = load_joint("orange_80_6000", structure, effects=effects, parameters=load | gear | bar)
    return SampledJoint(joint, DT)


@cache
def motion(structure: str) -> tuple[list[Measurement], Floats, dict[str, Floats]]:
    """Return what a joint measures while it is pushed about, the commands, and what is true."""
    plant, rng = SimulatedPlant(a_joint(structure).joint, 1, DT), np.random.default_rng(0)
    command = np.repeat(rng.normal(scale=20.0, size=10), 60)
    command = np.concatenate([command, np.full(500, command[-1])])
    now, seen, true = plant.reset(seed=0), [], []
    for u in command:
        seen.append(now)
        true.append(plant.batch.arrays.state[0].copy())
        now = plant.step(np.array([u]))
    return seen, command, dict(zip(MEASURED[1:], np.array(true).T, strict=True))


def error_at_the_end(observer: LinearObserver, structure: str) -> dict[str, float]:
    """Return how far states and disturbance are off after a motion, relative to what they did."""
    seen, command, true = motion(structure)
    sent = np.append(0.0, command)
    for k, measurement in enumerate(seen):
        found = observer.step(measurement, sent[k : k + 1], np.array([k == 0]))
    errors = {"disturbance": abs(float(found.pop("disturbance")[0]) - OFFSET) / OFFSET}
    for name, value in found.items():
        if name != "tau" and not name.startswith("innovation"):
            kind, _, ends = name.rpartition("_")
            state = true[f"{kind}_{ends[0]}"] - (true[f"{kind}_{ends[1]}"] if ends[1:] else 0.0)
            errors[name] = abs(float(value[0]) - state[-1]) / float(np.ptp(state))
    return errors


def is_shown(structure: str, outputs: tuple[str, ...]) -> bool:
    """Whether signals show all that moves, and a constant disturbance beside it."""
    shown = set(outputs)
    if structure in FIXED:  # a load that is held shows nothing, velocities no lasting torque
        return bool(shown & {"tau", "q_m", "q_g"})
    return bool(shown - {"tau"})  # the torque shows no turning


def poles(model: SampledJoint, outputs: tuple[str, ...]) -> list[complex]:
    """Return the joint's own poles where they are fast, and -100 rad/s for all the others."""
    own = np.log(np.linalg.eigvals(design_model(model, outputs).a).astype(complex)) / DT
    return [complex(pole) if pole.real < -200.0 else -100.0 + 0.0j for pole in own]


DESIGNS: dict[str, Callable[[SampledJoint, tuple[str, ...]], LinearObserver]] = {
    "luenberger": lambda model, outputs: luenberger_observer(model, poles(model, outputs), outputs),
    "kalman": lambda model, outputs: kalman_filter(model, 0.1, 0.5, outputs),
}


@pytest.mark.parametrize("design", DESIGNS)
@pytest.mark.parametrize(("structure", "outputs"), EVERY)
def test_states_and_disturbance_are_found_or_the_mode_is_named(
    structure: str, outputs: tuple[str, ...], design: str
) -> None:
    model = a_joint(structure)
    if not is_shown(structure, outputs):
        with pytest.raises(ConfigurationError, match=r"the modes? .* 1/s \(of .*\) do(es)? not"):
            DESIGNS[design](model, outputs)
        return
    errors = error_at_the_end(DESIGNS[design](model, outputs), structure)
    assert {"disturbance", "dq_m"} <= set(errors)
    for name, error in errors.items():
        assert error < 0.01, name


@pytest.mark.parametrize(("structure", "output"), list(product(STRUCTURES, MEASURED)))
def test_a_disturbance_observer_takes_any_signal_with_a_stable_inverse(
    structure: str, output: str
) -> None:
    model = a_joint(structure)
    if not is_shown(structure, (output,)):
        with pytest.raises(ConfigurationError, match="Choose another output: ") as caught:
            disturbance_observer(model, 10.0, output)
        (output, *_) = str(caught.value).split("output: ")[1].rstrip(".").split(", ")
    observer = disturbance_observer(model, 10.0, output)
    assert error_at_the_end(observer, structure)["disturbance"] < 0.01


@pytest.mark.parametrize("structure", STRUCTURES)
def test_a_kalman_filter_needs_no_disturbance(structure: str) -> None:
    observer = kalman_filter(a_joint(structure, 0.0), 0.1, 0.0, ("tau", "q_m"))
    assert "disturbance" not in observer.names
    assert np.abs(observer.poles()).max() < 1.0


def test_poles_at_one_place_are_set_apart_and_others_are_left() -> None:
    pair = -30.0 + 40.0j
    wanted = np.array([-100.0, pair, -100.0, pair.conjugate(), -200.0, -100.0])
    moved = [-95.0, pair, -100.0, pair.conjugate(), -200.0, -105.0]
    np.testing.assert_allclose(np.sort_complex(apart(wanted)), np.sort_complex(np.array(moved)))


def test_outputs_that_say_the_same_need_no_gain_of_their_own() -> None:
    """A joint without a damper in its bar measures the same by torque and by angle."""
    joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects={})
    observer = luenberger_observer(SampledJoint(joint, DT), [-300.0] * 3, ("tau", "q_m"))
    expected = np.exp(-300.0 * DT * np.array([0.95, 1.0, 1.05]))
    np.testing.assert_allclose(np.sort(observer.poles().real), np.sort(expected), rtol=1e-6)


def test_poles_that_cannot_be_placed_are_refused() -> None:
    """A load of next to nothing, whose mode is undamped and beyond the Nyquist frequency."""
    model = SampledJoint(load_joint("orange_80_6000", "full_dynamics", effects={}), DT)
    with (
        warnings.catch_warnings(action="error"),
        pytest.raises(ConfigurationError, match=r"(?s)come out at .* set them farther apart or"),
    ):
        luenberger_observer(model, [-300.0] * 7, ("q_m",))


@pytest.mark.parametrize("outputs", [("tau",), ("dq_m",), MEASURED])
def test_a_mode_that_dies_within_a_sample_is_no_raw_error(outputs: tuple[str, ...]) -> None:
    model = SampledJoint(load_joint("example", "full_dynamics", effects={}), DT)
    order = len(design_model(model, outputs, disturbance=False).b)
    with pytest.raises(ConfigurationError, match=r"(?s)Poles of the .*take a Kalman filter"):
        luenberger_observer(model, [-200.0] * order, outputs, disturbance=False)


def test_the_noise_of_a_velocity_is_that_of_its_filtered_angle() -> None:
    effects = {"velocity_differentiation": {"cutoff": 100.0}, "noise": {"q_m": 1e-5, "q_l": 0.0}}
    model = SampledJoint(load_joint("orange_80_6000", "rigid_gearbox", effects=effects), DT)
    plant = SimulatedPlant(model.joint, 64, DT)
    plant.reset(seed=1)
    seen = np.array([plant.step(np.zeros(64)).dq_m for _ in range(1000)])[200:]
    angle = output_noise(model, "q_m")
    assert np.std(seen) == pytest.approx(output_noise(model, "dq_m") * 1e-5 / angle, rel=0.02)
