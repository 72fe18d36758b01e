"""Accuracy against an independent integrator with tight tolerances, and the order of convergence.

The headline: at the default step of `Joint.simulate` the largest error of any state over one
second is at most 1e-4 of that state's peak. Most of the grid is marked `slow`; what is left are the
joints with the least and those with the most demanding parameters.
"""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.joint import STRUCTURES, Joint, load_joint
from cjt_gym.joint.joint import DT_PHYSICS
from tests.physics.cases import DT, Floats, excitation, known_grid, smooth_effects, states
from tests.physics.independent import peak_errors, reference_states

ALLOWED = 1e-4
QUICK = {
    ("emps", "rigid"),
    ("example", "output_fixed"),
    ("lemon_50_6000", "output_fixed_rigid_gearbox"),
    ("avocado_100_21000", "rigid"),
    ("generic", "full_dynamics"),
    *(("orange_80_6000", structure) for structure in STRUCTURES),
}
GRID = [
    pytest.param(name, structure, marks=[] if (name, structure) in QUICK else [pytest.mark.slow])
    for name, structure in known_grid()
]


def reference(joint: Joint, tau_m: Floats, load: Floats) -> Floats:
    numbers = {symbol: q.value for symbol, q in joint.parameters.quantities.items()}
    effects = {name: dict(values) for name, values in joint.effects.items()}
    return reference_states(numbers, joint.structure, effects, tau_m, load, DT)


@pytest.mark.parametrize(("name", "structure"), GRID)
def test_error_over_one_second_at_the_default_step(name: str, structure: str) -> None:
    joint = load_joint(name, structure, effects=smooth_effects(name, ripple_by_torque=True))
    tau_m, load = excitation(joint, 1001)
    error = peak_errors(
        states(joint.simulate(tau_m, load, dt=DT)), reference(joint, tau_m, load)
    ).max()
    assert DT_PHYSICS == 1e-5
    assert error <= ALLOWED


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize(("name", "tolerance"), [("orange_80_6000", 0.1), ("generic", 0.2)])
def test_second_order(name: str, tolerance: float, structure: str) -> None:
    """The slope of log error over log step; friction is wide enough to resolve at every step.

    `viscous_asym` is left out: the kink at rest leaves the order, not its regularity, intact. The
    gear ripple of `generic` is in proportion to a torque that friction, damping and ripple
    themselves change; a rigid joint has that without dry friction.
    """
    effects = smooth_effects(name, ripple_by_torque=name == "generic")
    del effects["viscous_asym"]
    effects["coulomb"]["dq_0"] = 0.02
    if (name, structure) == ("generic", "rigid"):
        del effects["coulomb"]
    found = order(load_joint(name, structure, effects=effects))
    assert found == pytest.approx(2.0, abs=tolerance)


def order(joint: Joint) -> float:
    """Return the measured order over steps of 100, 50, 20 and 10 us, in 0.3 s."""
    tau_m, load = excitation(joint, 301)
    exact = reference(joint, tau_m, load)
    steps = np.array([1e-4, 5e-5, 2e-5, 1e-5])
    errors = [
        peak_errors(states(joint.simulate(tau_m, load, dt=DT, dt_physics=h)), exact).max()
        for h in steps
    ]
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
