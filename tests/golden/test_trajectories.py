"""Simulated motion against the toolbox's equations, integrated by another program.

The recorded motions follow the toolbox as it is coded, so the joint is given what undoes its
deviations: 2 pi f for a ripple of f, and the coefficient that the code takes for the load's in
`rigid_gearbox`. Ripple in proportion to the transmitted torque sees the spring's share only
there; the kernel takes the whole torque, so those motions are compared with the independent
simulator of the physics tests, which can do both.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.golden.conftest import JointOf
from tests.golden.loader import Array, Trajectory, mechanical_trajectories, oracle_numbers
from tests.physics.cases import states
from tests.physics.independent import peak_errors, reference_states

LINEAR = mechanical_trajectories(nonlinear_ones=False)
NONLINEAR = mechanical_trajectories(nonlinear_ones=True)
STIFF = 1e-3
"""Load inertia [kg m^2] below which the torsion bar rings above 5 krad/s, hardly damped."""


def name_of(trajectory: Trajectory) -> str:
    return trajectory.name


def ripple_of(trajectory: Trajectory, kinds: tuple[int, ...]) -> dict[str, Any]:
    """Return f, a, b of the ripple rows of some kinds, with the spatial frequency as coded."""
    rows = {key: np.array(values) for key, values in trajectory.ripple.items()}
    pick = np.isin(rows["kind"], kinds)
    return {
        "f": tuple(2.0 * np.pi * rows["f"][pick]),
        "a": tuple(rows["a"][pick]),
        "b": tuple(rows["b"][pick]),
    }


def effects_of(trajectory: Trajectory) -> dict[str, dict[str, Any]]:
    """Return the effects that stand for a trajectory's nonlinear terms, as they are coded."""
    p = oracle_numbers(trajectory.joint)
    effects: dict[str, dict[str, Any]] = {}
    for term in trajectory.effects:
        if term == "torque_ripple":
            unit_torque = trajectory.structure == "rigid"
            added = ripple_of(trajectory, (1, 2) if unit_torque else (1,))
            shared = ripple_of(trajectory, () if unit_torque else (2,))
            effects |= {"cogging": added} if added["f"] else {}
            effects |= {"gear_ripple": shared} if shared["f"] else {}
        elif term == "viscous_asym":
            swapped = trajectory.structure == "rigid_gearbox"
            load = p["d_l"] + p["d_g_n"] - p["d_g"] if swapped else p["d_l_n"]
            effects[term] = {"d_m_n": p["d_m_n"], "d_g_n": p["d_g_n"], "d_l_n": load}
        else:
            effects[term] = {"dq_0": 0.002}
    return effects


def largest_error(x: Array, trajectory: Trajectory) -> float:
    """Return the largest deviation of a state relative to its peak; a fixed load is an input."""
    free = slice(0, 5) if trajectory.structure.startswith("output_fixed") else slice(0, 6)
    kept, golden = x[:: trajectory.every, free], trajectory.states[:, free]
    peak = np.abs(golden).max(axis=0)
    return float((np.abs(kept - golden).max(axis=0) / np.where(peak > 0.0, peak, 1.0)).max())


def is_stiff(trajectory: Trajectory) -> bool:
    fixed = trajectory.structure.startswith("output_fixed") or trajectory.structure == "rigid"
    return not fixed and oracle_numbers(trajectory.joint)["I_l"] < STIFF


@pytest.mark.parametrize("trajectory", LINEAR, ids=name_of)
def test_linear_motion_is_exact(trajectory: Trajectory, joint_of: JointOf) -> None:
    joint = joint_of(trajectory.joint, trajectory.structure)
    tau_m, load = trajectory.inputs.T
    record = joint.simulate(tau_m, load, dt=trajectory.dt, dt_physics=1e-4)
    assert largest_error(states(record), trajectory) < (1e-6 if is_stiff(trajectory) else 1e-8)


COMPARABLE = [t for t in NONLINEAR if "gear_ripple" not in effects_of(t)]


@pytest.mark.parametrize("trajectory", COMPARABLE, ids=name_of)
def test_nonlinear_motion(trajectory: Trajectory, joint_of: JointOf) -> None:
    """The kernel is of second order; with steps of 2 us it meets the figures' own accuracy."""
    joint = joint_of(trajectory.joint, trajectory.structure, effects=effects_of(trajectory))
    tau_m, load = trajectory.inputs.T
    record = joint.simulate(tau_m, load, dt=trajectory.dt, dt_physics=2e-6)
    assert largest_error(states(record), trajectory) < (1e-5 if is_stiff(trajectory) else 1e-6)


def sparing(trajectories: tuple[Trajectory, ...]) -> list[Any]:
    """Return the trajectories as test parameters, three quarters of them marked as slow."""
    return [
        pytest.param(t, id=t.name, marks=[pytest.mark.slow] if k % 4 else [])
        for k, t in enumerate(trajectories)
    ]


@pytest.mark.parametrize("trajectory", sparing(NONLINEAR))
def test_the_independent_simulator_gives_the_same_motion(trajectory: Trajectory) -> None:
    """It converges to 1e-10; what is left are the figures' own errors, largest in a stiff load."""
    tau_m, load = trajectory.inputs.T
    found = reference_states(
        oracle_numbers(trajectory.joint),
        trajectory.structure,
        effects_of(trajectory),
        tau_m,
        load,
        trajectory.dt,
        elastic_ripple=True,
    )
    assert largest_error(found, trajectory) < (1e-5 if is_stiff(trajectory) else 1e-7)


SHARING = [t for t in NONLINEAR if len(t.effects) > 1 and t.ripple and t.name.endswith("__chirp")]


@pytest.mark.parametrize("trajectory", SHARING, ids=name_of)
def test_gear_ripple_follows_the_whole_transmitted_torque(
    trajectory: Trajectory, joint_of: JointOf
) -> None:
    """The same motions with the damper's share, against the independent simulator, to order two."""
    effects = effects_of(trajectory) | {
        "cogging": ripple_of(trajectory, (1,)),
        "gear_ripple": ripple_of(trajectory, (2,)),
    }
    structure, dt = trajectory.structure, trajectory.dt
    tau_m, load = trajectory.inputs.T
    joint = joint_of(trajectory.joint, structure, effects=effects)
    record = joint.simulate(tau_m, load, dt=dt, dt_physics=2e-6)
    parameters = oracle_numbers(trajectory.joint)
    reference = reference_states(parameters, structure, effects, tau_m, load, dt)
    assert peak_errors(states(record), reference).max() < 2e-6
