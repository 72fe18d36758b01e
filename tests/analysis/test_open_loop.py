"""The joint by itself against golden figures, python-control and what modes mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym.analysis.open_loop import (
    frequency_response,
    matrices,
    poles,
    step,
    system,
    zeros,
)
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.joint import STRUCTURES, Joint, load_joint
from cjt_gym.joint.linear import OUTPUTS
from tests.golden.loader import frequencies, linear, write_joint

COMPOSED = {"static": "vd0", "rl": "vdL"}


def orange(structure: str = "output_fixed_rigid_gearbox", drive: str = "current") -> Joint:
    return load_joint("orange_80_6000", structure, drive, effects={})


@pytest.mark.parametrize("structure", STRUCTURES)
def test_responses_are_those_of_the_toolbox(structure: str, tmp_path: Path) -> None:
    path = write_joint(tmp_path / "joint.toml", "oracle_asym")
    joint, f = load_joint(path, structure, effects={}), frequencies(structure)
    golden = linear("oracle_asym", structure, "H")
    for output in OUTPUTS if structure != "rigid" else OUTPUTS[:6]:
        for column, name in enumerate(("tau_m", "load")):
            ours = frequency_response(joint, f, name, output)
            theirs = golden[OUTPUTS.index(output), column]
            np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("drive", COMPOSED)
def test_a_voltage_gives_the_poles_of_the_toolbox(drive: str, tmp_path: Path) -> None:
    path = write_joint(tmp_path / "joint.toml", "oracle_asym")
    joint = load_joint(path, "rigid_gearbox", drive, effects={})
    golden = np.linalg.eigvals(linear("oracle_asym", "rigid_gearbox", f"{COMPOSED[drive]}_A"))
    ours = np.linalg.eigvals(matrices(joint, "v", "tau")[0])
    np.testing.assert_allclose(np.sort_complex(ours), np.sort_complex(golden), rtol=1e-7, atol=1e-6)


def test_current_is_torque_over_the_constant_of_the_link() -> None:
    f = np.array([1.0, 20.0])
    ratio = frequency_response(orange(), f, "i") / frequency_response(orange(), f)
    np.testing.assert_allclose(ratio, 0.078 * 80.0)


def test_the_system_is_one_of_python_control_and_held_inputs_are_exact() -> None:
    joint = orange("full_dynamics", "rl")
    whole = system(joint, "v", "dq_l")
    assert (whole.input_labels, whole.output_labels, whole.nstates) == (["v"], ["dq_l"], 7)
    response = frequency_response(joint, np.array([7.0]), "v", "dq_l")
    assert whole(2j * np.pi * 7.0) == pytest.approx(response[0])
    held = system(orange(), dt=1e-3)
    own = orange().state_space(1e-3)
    z = np.exp(2j * np.pi * 10.0 * 1e-3)
    assert held(z) == pytest.approx(own(z)[OUTPUTS.index("tau"), 0])
    at = frequency_response(orange(), np.array([10.0]), dt=1e-3)
    assert at[0] == pytest.approx(held(z))


def test_modes_have_their_physical_names() -> None:
    assert [mode.name for mode in poles(orange())] == ["resonance"]
    assert poles(orange())[0].frequency == pytest.approx(22.444, rel=1e-4)
    free = poles(orange("rigid_gearbox"))
    assert [mode.name for mode in free] == ["free motion", "drag", "torsion-bar mode"]
    assert free[2].frequency == pytest.approx(np.sqrt(6000.0 / 1e-4) / (2.0 * np.pi), rel=1e-3)
    heavy = load_joint("orange_80_6000", "rigid_gearbox", effects={}, parameters={"I_l": 2.0})
    assert [mode.name for mode in poles(heavy)] == ["free motion", "drag", "resonance"]
    (zero, pair) = zeros(heavy, "tau_m", "dq_m")
    assert (zero.name, pair.name) == ("zero", "anti-resonance")
    assert pair.frequency == pytest.approx(np.sqrt(6000.0 / 2.0) / (2.0 * np.pi), rel=1e-6)
    soft = load_joint(
        "orange_80_6000", "output_fixed", effects={}, parameters={"d_mg": 1.0, "I_g": 0.02}
    )
    assert [mode.name for mode in poles(soft)] == ["resonance", "gearbox mode"]
    slow = load_joint("orange_80_6000", "rigid", "rl", effects={}, parameters={"k_t": 1e-3})
    assert [mode.name for mode in poles(slow, "v")] == ["free motion", "drag", "electrical"]


def test_zeros_are_where_the_response_vanishes() -> None:
    joint = orange("output_fixed")
    a, b, c, d = matrices(joint, "tau_m", "dq_m")
    for mode in zeros(joint, "tau_m", "dq_m"):
        at = c @ np.linalg.solve(mode.value * np.eye(len(a)) - a, b + 0j) + d
        assert abs(at[0, 0]) < 1e-9
    assert zeros(orange()) == ()


def test_the_step_of_a_mass_on_a_spring() -> None:
    joint = orange()
    answer, mode = step(joint), poles(joint)[0]
    assert answer.final == pytest.approx(1.0)
    overshoot = np.exp(-np.pi * mode.damping / np.sqrt(1.0 - mode.damping**2))
    assert answer.overshoot == pytest.approx(overshoot, rel=1e-3)
    assert answer.settling_s == pytest.approx(np.log(20.0) / -mode.value.real, rel=0.05)
    assert np.isnan(step(orange("rigid_gearbox"), output="q_m").final)


def test_what_cannot_be_asked_for() -> None:
    with pytest.raises(UnknownNameError, match="input"):
        matrices(orange(), "voltage")
    with pytest.raises(UnknownNameError, match="output"):
        matrices(orange(), "tau_m", "torque")
    with pytest.raises(ConfigurationError, match="static, rl, dq"):
        matrices(orange(), "v")
    with pytest.raises(ConfigurationError, match="no torsion bar"):
        matrices(orange("rigid"))


def test_a_step_that_ends_at_rest_has_no_figures() -> None:
    """The motor of a locked joint comes to rest, at exactly zero: nothing to be relative to."""
    answer = step(load_joint("orange_80_6000", "output_fixed", effects={}), "tau_m", "dq_m")
    assert np.isnan(answer.final)
    assert np.isfinite(answer.y).all()


def test_a_joint_with_values_of_its_own_is_the_one_that_has_them() -> None:
    own = {"inertia": {"I_m": 0.4}, "damping": {"d_m": 3.0}, "stiffness": {"k_b": 5e3}}
    found = load_joint("orange_80_6000", "output_fixed", effects=own)
    values = {"I_m": 0.4, "d_m": 3.0, "k_b": 5e3}
    given = load_joint("orange_80_6000", "output_fixed", effects={}, parameters=values)
    f = np.geomspace(0.5, 50.0, 7)
    np.testing.assert_allclose(frequency_response(found, f), frequency_response(given, f))
    np.testing.assert_allclose(found.state_space().A, given.state_space().A)
    assert [p.value for p in poles(found)] == pytest.approx([p.value for p in poles(given)])
    assert found.parameters.I_m != 0.4, "controllers know the joint file's"
