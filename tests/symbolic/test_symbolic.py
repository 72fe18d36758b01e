"""The symbolic joint against golden figures of the toolbox and against the numeric joint."""

from __future__ import annotations

import ast

import numpy as np
import pytest

sympy = pytest.importorskip("sympy")

from cjt_gym.errors import UnknownNameError  # noqa: E402
from cjt_gym.joint import JointParameters, load_joint  # noqa: E402
from cjt_gym.symbolic import (  # noqa: E402
    CODE,
    S,
    dynamics,
    evaluate,
    lock_output,
    state_space,
    stiffen_gearbox,
    to_code,
    to_latex,
    to_zero,
    transfer_function,
)
from tests.golden.loader import (  # noqa: E402
    STRUCTURES,
    frequencies,
    linear,
    oracle_numbers,
    oracle_sets,
)

OUTPUTS = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")


def golden(name: str) -> JointParameters:
    values = {k: v for k, v in oracle_numbers(name).items() if not k.endswith("_n")}
    return JointParameters.from_values(name, values)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_matrices_with_numbers_are_those_of_the_toolbox(structure: str) -> None:
    symbolic = state_space(structure)
    for name in ("oracle_asym", "cjt_Orange_80_6000"):
        for matrix, key in zip(symbolic, "ABCD", strict=True):
            ours = np.array(evaluate(matrix, golden(name)).tolist(), dtype=float)
            np.testing.assert_allclose(ours, linear(name, structure, key), rtol=1e-13, atol=0.0)


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize(("column", "name"), [(0, "tau_m"), (1, "load")])
def test_transfer_functions_with_numbers_are_those_of_the_toolbox(
    structure: str, column: int, name: str
) -> None:
    f = frequencies(structure)
    for output in ("tau", "q_m", "dq_l"):
        symbolic = transfer_function(structure, output, name)
        for joint in ("oracle_asym", oracle_sets()[0]):
            expression = evaluate(symbolic, golden(joint))
            ours = sympy.lambdify(S, expression, "numpy")(2j * np.pi * f) * np.ones(len(f))
            theirs = linear(joint, structure, "H")[OUTPUTS.index(output), column]
            np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-12)


def test_mass_and_stiffness_of_three_masses() -> None:
    m = dynamics("full_dynamics")
    assert str(m.inertia.diagonal()) == "Matrix([[I_m, I_g, I_l]])"
    assert sum(m.stiffness) == 0
    assert m.damping == m.damping.T


def test_a_stiff_gearbox_and_a_locked_output_are_the_smaller_structures() -> None:
    whole = transfer_function("full_dynamics")
    stiff = stiffen_gearbox(whole)
    assert sympy.simplify(stiff - transfer_function("rigid_gearbox")) == 0
    locked = lock_output(stiff)
    assert sympy.simplify(locked - transfer_function("output_fixed_rigid_gearbox")) == 0
    fixed = transfer_function("output_fixed")
    assert sympy.simplify(lock_output(whole) - fixed) == 0
    bare = to_zero(locked, "d_m", "d_g", "d_gl")
    assert str(bare) == "k_b/(k_b + s**2*(I_g + I_m))"


def test_current_and_voltage_drive_the_motor() -> None:
    torque = transfer_function("output_fixed_rigid_gearbox")
    current = transfer_function("output_fixed_rigid_gearbox", input="i")
    assert str(sympy.cancel(current / torque)) == "k_t*n"
    voltage = transfer_function("output_fixed_rigid_gearbox", input="v")
    p = load_joint("orange_80_6000").parameters
    assert float(evaluate(voltage, p).subs(S, 0)) == pytest.approx(p.k_t * p.n / p.r)


def test_code_computes_what_the_expression_says() -> None:
    p = load_joint("orange_80_6000").parameters
    symbolic = transfer_function("rigid_gearbox")
    code = to_code(symbolic, "python")
    names = {node.id for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Name)}
    values = {name: p.get(name, 0.0) for name in names - {"s"}}
    ours = eval(code, {"s": 40j, **values})
    assert ours == pytest.approx(complex(evaluate(symbolic, p).subs(S, 40j)))
    assert "pow(s, 2)" in to_code(symbolic, "c")
    assert all(to_code(symbolic, language) for language in CODE)
    with pytest.raises(UnknownNameError, match="Did you mean 'python'"):
        to_code(symbolic, "pyton")


def test_latex_has_upright_indices() -> None:
    assert to_latex(transfer_function("rigid", "dq_m")).startswith(r"\frac{1}{")
    assert r"k_{\mathrm{b}}" in to_latex(dynamics("rigid_gearbox").stiffness)


def test_names_that_are_unknown() -> None:
    with pytest.raises(UnknownNameError, match="structure"):
        transfer_function("rigit")
    with pytest.raises(UnknownNameError, match="output"):
        transfer_function("rigid", "torque")
    with pytest.raises(UnknownNameError, match="input"):
        transfer_function("rigid", input="current")
