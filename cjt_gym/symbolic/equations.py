"""Matrices and transfer functions of every structure, with symbols for parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import sympy as sp

from cjt_gym.errors import check_name
from cjt_gym.joint import JointParameters, get_structure
from cjt_gym.joint.files.parameters import PARAMETERS
from cjt_gym.joint.linear import OUTPUTS, body_matrices, state_matrices

S = sp.Symbol("s")
"""The Laplace variable."""
INPUTS = ("tau_m", "i", "v", "load")


def symbol(name: str) -> sp.Symbol:
    """Return the symbol of a parameter, which is positive.

    Raises:
        UnknownNameError: There is no such parameter.
    """
    check_name("parameter", name, PARAMETERS)
    return sp.Symbol(name, positive=True)


class _Symbols:
    def __getattr__(self, name: str) -> sp.Symbol:
        return symbol(name)

    def get(self, name: str, _: float) -> sp.Symbol:
        return symbol(name)


SYMBOLS = cast(JointParameters, _Symbols())
"""Parameters whose values are symbols."""


@dataclass(frozen=True)
class Dynamics:
    """I ddz + D dz + K z = forces, with z the coordinates of a structure.

    Attributes:
        inertia: Shape (size, size).
        damping: Shape (size, size).
        stiffness: Shape (size, size).
        motor: Where the motor torque acts, shape (size, 1).
        load: Where the load torque acts, shape (size, 1); where the output is fixed, the torques
            of its angle and velocity as a polynomial in s.
        selection: Bodies from coordinates, shape (3, size).
    """

    inertia: sp.Matrix
    damping: sp.Matrix
    stiffness: sp.Matrix
    motor: sp.Matrix
    load: sp.Matrix
    selection: sp.Matrix


def dynamics(structure: str) -> Dynamics:
    """Return the matrices of a structure.

    Raises:
        UnknownNameError: There is no such structure.
    """
    row = get_structure(structure)
    bodies = [_exact(m) for m in body_matrices(SYMBOLS, row)]
    select = sp.Matrix(row.selection.astype(int).tolist())
    inertia, damping, stiffness = (select.T * m * select for m in bodies)
    load = select[2, :].T
    if row.output_fixed:
        load = -select.T * (bodies[1][:, 2] * S + bodies[2][:, 2])
    return Dynamics(inertia, damping, stiffness, select[0, :].T, load, select)


def _exact(matrix: Any) -> sp.Matrix:
    """Return a matrix with integers for the floats 0 and 1."""
    return sp.Matrix(matrix.tolist()).applyfunc(sp.nsimplify)


def state_space(structure: str) -> tuple[sp.Matrix, sp.Matrix, sp.Matrix, sp.Matrix]:
    """Return A, B, C, D as in `cjt_gym.joint.linear.state_matrices`.

    Raises:
        UnknownNameError: There is no such structure.
    """
    a, b, c, d = map(_exact, state_matrices(SYMBOLS, get_structure(structure)))
    return a, b, c, d


def transfer_function(structure: str, output: str = "tau", input: str = "tau_m") -> sp.Expr:
    """Return a transfer function in s and the parameters.

    Args:
        structure: Name of a structure.
        output: One of q_m, q_g, q_l, dq_m, dq_g, dq_l, tau.
        input: "tau_m" motor torque, "i" motor current, "v" voltage at resistance and inductance,
            or "load": the load torque, or its velocity where the output is fixed.

    Raises:
        UnknownNameError: There is no such structure, output or input.
    """
    check_name("output", output, OUTPUTS)
    check_name("input", input, INPUTS)
    if input == "load":
        return _ratio(structure, output, by_motor=False)
    torque = _ratio(structure, output, by_motor=True)
    k = symbol("k_t") * symbol("n")
    if input == "i":
        torque = k * torque
    elif input == "v":
        speed = _ratio(structure, "dq_m", by_motor=True)
        torque = torque * k / (symbol("r") + symbol("l_a") * S + k**2 * speed)
    return tidy(torque)


def _ratio(structure: str, output: str, *, by_motor: bool) -> sp.Expr:
    """Return the transfer function from the motor torque, or from the load's input."""
    row, m = get_structure(structure), dynamics(structure)
    fixed = row.output_fixed and not by_motor
    force = m.motor if by_motor else m.load / (S if fixed else 1)
    z = (m.inertia * S**2 + m.damping * S + m.stiffness).LUsolve(force)
    q = m.selection * z
    if fixed:
        q[2] = 1 / S
    if output == "tau":  # zero where the bar is rigid, as both of its ends are then one
        return tidy((symbol("k_b") + symbol("d_gl") * S) * (q[1] - q[2]))
    body = {"m": 0, "g": 1, "l": 2}[output[-1]]
    return tidy(q[body] * (S if output.startswith("dq") else 1))


def tidy(expression: sp.Expr) -> sp.Expr:
    """Return a fraction of polynomials in s, common factors removed."""
    numerator, denominator = sp.fraction(sp.cancel(sp.together(expression)))
    return sp.collect(sp.expand(numerator), S) / sp.collect(sp.expand(denominator), S)
