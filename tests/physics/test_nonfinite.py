"""Non-finite commands, loads and states are caught at once; impossible parameters are refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError, ParameterError, SimulationError
from cjt_gym.joint import DRIVES, STRUCTURES, load_joint
from cjt_gym.plant import SimulatedPlant
from tests.physics.cases import states

NAME = "orange_80_6000"
Floats = NDArray[np.float64]
BAD = [math.nan, math.inf, -math.inf]


def last_good(error: SimulationError) -> Floats:
    """Return the states that the error carries; they are finite."""
    assert error.last_good_states is not None
    assert np.isfinite(error.last_good_states).all()
    return error.last_good_states


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("which", ["tau_m", "load", "x0"])
def test_simulate_refuses_inputs_that_are_not_finite(which: str, bad: float) -> None:
    inputs: dict[str, Any] = {"tau_m": np.zeros(10), "load": np.zeros(10), "x0": np.zeros(6)}
    inputs[which][3] = bad
    with pytest.raises(ConfigurationError, match="finite"):
        load_joint(NAME).simulate(**inputs)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_a_state_that_runs_away_is_reported_with_the_last_good_ones(structure: str) -> None:
    """The load is torn away after 20 samples; the first 21 rows are good."""
    load = np.where(np.arange(50) < 20, 0.0, 1e20)
    joint = load_joint(NAME, structure)
    with pytest.raises(SimulationError, match="after 21 samples") as caught:
        joint.simulate(np.full(50, 5.0), load, dt_physics=1e-4)
    good = last_good(caught.value)
    assert good.shape == (21, 6)
    kept = joint.simulate(np.full(21, 5.0), dt_physics=1e-4)
    free = slice(0, 5 if joint.structure_row.output_fixed else 6)
    np.testing.assert_array_equal(good[:, free], states(kept)[:, free])


def stepped(plant: SimulatedPlant, bad_load: float = 0.0, bad_command: float = 0.0) -> None:
    """Take good steps, then one with a bad input for joint 1, then good ones."""
    good, command, load = np.full(3, 4.0), np.full(3, 4.0), np.zeros(3)
    command[1] += bad_command
    load[1] += bad_load
    for k in range(12):
        plant.step(command if k == 6 else good, load if k == 6 else np.zeros(3))


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("effects", [{}, {"coulomb": {}}, {"coulomb": {"dq_0": 0.0}}])
def test_a_command_of_nan_is_caught(drive: str, structure: str, effects: dict[str, Any]) -> None:
    plant = SimulatedPlant(load_joint(NAME, structure, drive, effects=effects), num=3)
    plant.reset(seed=0)
    with pytest.raises(SimulationError, match="joint 1") as caught:
        stepped(plant, bad_command=math.nan)
    assert last_good(caught.value).shape == (3, 6)


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("bad", BAD)
def test_a_load_that_is_not_finite_is_caught(structure: str, bad: float) -> None:
    plant = SimulatedPlant(load_joint(NAME, structure), num=3)
    plant.reset(seed=0)
    with pytest.raises(SimulationError, match="joint 1") as caught:
        stepped(plant, bad_load=bad)
    assert last_good(caught.value).shape == (3, 6)


def test_a_bad_command_is_caught_before_its_delay_has_passed() -> None:
    effects = {"command_delay": {"delay": 2.5e-3}}
    plant = SimulatedPlant(load_joint(NAME, effects=effects), num=3)
    plant.reset(seed=0)
    with pytest.raises(SimulationError, match="joint 1.*after 6 control steps"):
        stepped(plant, bad_command=math.nan)


def test_an_infinite_command_is_clipped_like_any_other_that_is_too_large() -> None:
    one, other = (SimulatedPlant(load_joint(NAME)) for _ in range(2))
    one.reset(seed=0)
    other.reset(seed=0)
    measured = one.step(np.array([math.inf]))
    expected = other.step(np.array([one.limits.tau]))
    assert measured.q_m[0] == expected.q_m[0]


def test_the_others_go_on_and_a_reset_repairs() -> None:
    plant = SimulatedPlant(load_joint(NAME), num=3)
    plant.reset(seed=0)
    with pytest.raises(SimulationError):
        stepped(plant, bad_command=math.nan)
    plant.reset(mask=np.array([False, True, False]))
    measured = plant.step(np.full(3, 4.0))
    assert np.isfinite(measured.q_m).all()
    assert measured.q_m[0] == measured.q_m[2] != 0.0
    fresh = SimulatedPlant(load_joint(NAME))
    fresh.reset(seed=0)
    assert measured.q_m[1] == fresh.step(np.array([4.0])).q_m[0]


# ------------------------------------------------------------------------------ parameters


@pytest.mark.parametrize("structure", [s for s in STRUCTURES if s != "rigid"])
def test_a_spring_without_stiffness_is_refused(structure: str) -> None:
    with pytest.raises(ParameterError, match="k_b"):
        load_joint(NAME, structure, parameters={"k_b": 0.0})


@pytest.mark.parametrize(
    ("structure", "symbol"), [("full_dynamics", "I_l"), ("output_fixed", "I_g")]
)
def test_a_coordinate_without_inertia_is_refused(structure: str, symbol: str) -> None:
    with pytest.raises(ParameterError, match=f"{symbol} .*must be > 0"):
        load_joint(NAME, structure, parameters={symbol: 0.0})


@pytest.mark.parametrize("drive", ["static", "rl", "dq"])
@pytest.mark.parametrize("symbol", ["r", "v_0"])
def test_a_voltage_drive_needs_resistance_and_supply(drive: str, symbol: str) -> None:
    with pytest.raises(ParameterError, match=f"{symbol} .*> 0"):
        load_joint(NAME, drive=drive, parameters={symbol: 0.0})


@pytest.mark.parametrize("steps", [(0.0, 1e-4), (1e-3, 0.0), (-1e-3, 1e-4), (math.nan, 1e-4)])
def test_steps_have_to_be_positive(steps: tuple[float, float]) -> None:
    with pytest.raises(ConfigurationError, match="^dt(_physics)? must be finite and > 0 s"):
        load_joint(NAME).simulate(np.zeros(3), dt=steps[0], dt_physics=steps[1])


def test_the_control_step_is_a_whole_multiple_of_the_substep() -> None:
    with pytest.raises(ConfigurationError, match=r"^dt must be a whole .*Take .*0\.00025 s"):
        load_joint(NAME).simulate(np.zeros(3), dt=1e-3, dt_physics=3e-4)
