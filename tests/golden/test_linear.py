"""The linear joint against the toolbox: nine parameter sets in five structures."""

from __future__ import annotations

import numpy as np
import pytest

from tests.golden.conftest import JointOf
from tests.golden.loader import STRUCTURES, frequencies, linear, oracle_sets

CASES = [(name, structure) for name in oracle_sets() for structure in STRUCTURES]
each_case = pytest.mark.parametrize(("name", "structure"), CASES)


@each_case
def test_continuous_matrices(name: str, structure: str, joint_of: JointOf) -> None:
    system = joint_of(name, structure).state_space()
    for key in "ABCD":
        np.testing.assert_allclose(
            getattr(system, key), linear(name, structure, key), rtol=1e-14, atol=0.0, err_msg=key
        )


@each_case
def test_sampled_matrices_are_the_exact_hold(name: str, structure: str, joint_of: JointOf) -> None:
    """The figures themselves deviate by 5e-11 from an independent matrix exponential."""
    system = joint_of(name, structure).state_space(dt=1e-3)
    for key in "ABCD":
        golden = linear(name, structure, f"zoh_{key}")
        peak = np.abs(golden).max()
        np.testing.assert_allclose(getattr(system, key), golden, rtol=0.0, atol=1e-10 * peak)


@each_case
def test_eigenvalues(name: str, structure: str, joint_of: JointOf) -> None:
    """Relative to the fastest one: the double one at zero is only good to its square root."""
    golden = linear(name, structure, "eig")
    poles = joint_of(name, structure).state_space().poles()
    distance = np.abs(poles[:, None] - golden[None, :])
    fastest = np.abs(golden).max()
    assert distance.min(axis=0).max() < 1e-9 * fastest
    assert distance.min(axis=1).max() < 1e-9 * fastest


@each_case
def test_frequency_responses(name: str, structure: str, joint_of: JointOf) -> None:
    """Torque of a free joint cancels at low frequency, so that 1e-6 is all the figure holds.

    The equations are solved here: which of its two ways python-control takes depends on whether
    slycot is installed, and one of them is only good to 1e-7.
    """
    system = joint_of(name, structure).state_space()
    golden = linear(name, structure, "H")
    s = 2j * np.pi * frequencies(structure)[:, None, None]
    inner = np.linalg.solve(s * np.eye(system.nstates) - system.A, system.B[None] + 0j * s)
    computed = np.moveaxis(system.C @ inner + system.D, 0, 2)
    peak = np.abs(golden).max(axis=2, keepdims=True)
    error = np.abs(computed - golden) / np.where(peak > 0.0, peak, 1.0)
    assert error[6, 0].max() < 1e-6
    error[6, 0] = 0.0
    assert error.max() < 1e-9


@pytest.mark.parametrize("name", oracle_sets())
def test_transfer_function_has_the_same_response(name: str, joint_of: JointOf) -> None:
    structure = "output_fixed_rigid_gearbox"
    transfer = joint_of(name, structure).transfer_function("tau", "tau_m")
    golden = linear(name, structure, "H")[6, 0]
    response = np.array([transfer(2j * np.pi * f) for f in frequencies(structure)])
    np.testing.assert_allclose(response, golden, rtol=1e-9)
