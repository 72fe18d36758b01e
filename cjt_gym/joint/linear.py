"""The linear joint: matrices, state space, exact discretisation.

States are z, dz and, where the output is fixed, q_l between them, in the order
[q_m q_g q_l dq_m dq_g dq_l] with the merged and prescribed ones left out. Outputs are
[q_m q_g q_l dq_m dq_g dq_l tau] with tau = k_b (q_g - q_l) + d_gl (dq_g - dq_l).
"""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ParameterError, check_name
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.kernel.arrays import Complex
from cjt_gym.joint.structures import BODIES, Structure

if TYPE_CHECKING:  # it loads matplotlib, so it is imported only where it is used
    import control

Matrix = NDArray[np.float64]

OUTPUTS = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")


def body_matrices(p: JointParameters, structure: Structure) -> tuple[Matrix, Matrix, Matrix]:
    """Return inertia, damping and stiffness of the three bodies, each of shape (3, 3).

    Dampings that a joint file leaves out are zero; so are spring and damper between bodies that
    the structure joins rigidly.

    Source: Malzahn, Roozing, Tsagarakis, The Compliant Joint Toolbox for MATLAB, Table 1.
    """
    k_g, d_mg = (p.k_g, p.get("d_mg", 0.0)) if structure.has_gear else (0.0, 0.0)
    k_b, d_gl = (p.k_b, p.get("d_gl", 0.0)) if structure.has_spring else (0.0, 0.0)
    d_m, d_g, d_l = (p.get(name, 0.0) for name in ("d_m", "d_g", "d_l"))
    inertia = np.diag([p.I_m, p.get("I_g", 0.0), p.get("I_l", 0.0)])
    damping = np.array(
        [[d_m + d_mg, -d_mg, 0.0], [-d_mg, d_mg + d_g + d_gl, -d_gl], [0.0, -d_gl, d_gl + d_l]]
    )
    stiffness = np.array([[k_g, -k_g, 0.0], [-k_g, k_g + k_b, -k_b], [0.0, -k_b, k_b]])
    return inertia, damping, stiffness


def reduced_matrices(p: JointParameters, structure: Structure) -> tuple[Matrix, Matrix, Matrix]:
    """Return S'IS, S'DS and S'KS, each of shape (size, size)."""
    s = structure.selection
    inertia, damping, stiffness = (s.T @ m @ s for m in body_matrices(p, structure))
    check_inertias(p, structure)
    return inertia, damping, stiffness


def check_inertias(p: JointParameters, structure: Structure) -> None:
    """Reject a joint with a body that moves freely and has no inertia.

    Raises:
        ParameterError: The total inertia of a coordinate of the structure is absent or zero.
    """
    for group in range(structure.size):
        names = [f"I_{b[0]}" for b, g in zip(BODIES, structure.groups, strict=True) if g == group]
        total = sum(p.get(name, 0.0) for name in names)
        if total > 0.0:
            continue
        getattr(p, names[0])  # raises where it is absent, and says where to add it
        raise ParameterError(
            f"{' + '.join(names)} of {p.origin} must be > 0 {p.unit('I_m')} for structure "
            f"{structure.name}, got {total:g}. Give the inertia or choose a structure that "
            "joins these bodies to another."
        )


def state_matrices(
    p: JointParameters, structure: Structure
) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return A, B, C, D of the continuous joint.

    Inputs are (tau_m, tau_l) with tau_l > 0 accelerating the load or, where the output is
    fixed, (tau_m, dq_l). For `rigid` the joint has no torsion bar and the row of tau is zero.
    """
    inertia, damping, stiffness = reduced_matrices(p, structure)
    _, body_damping, body_stiffness = body_matrices(p, structure)
    s, size, order = structure.selection, structure.size, structure.order
    mass_inverse = np.diag(1.0 / np.diag(inertia))
    position, velocity = slice(0, size), slice(order - size, order)
    kind = inertia.dtype  # floats, or objects where the parameters are symbols
    a, b = np.zeros((order, order), kind), np.zeros((order, 2), kind)
    a[position, velocity] = np.eye(size)
    a[velocity, position] = -mass_inverse @ stiffness
    a[velocity, velocity] = -mass_inverse @ damping
    b[velocity, 0] = mass_inverse @ s[0]
    c, d = np.zeros((7, order), kind), np.zeros((7, 2), kind)
    c[0:3, position] = c[3:6, velocity] = s
    if structure.output_fixed:
        a[velocity, size] = -mass_inverse @ s.T @ body_stiffness[:, 2]
        b[velocity, 1] = -mass_inverse @ s.T @ body_damping[:, 2]
        b[size, 1] = c[2, size] = d[5, 1] = 1.0
    else:
        b[velocity, 1] = mass_inverse @ s[2]
    bar = np.array([0.0, 1.0, -1.0])
    k_b, d_gl = body_stiffness[2, 2], -body_damping[1, 2]
    c[6] = k_b * bar @ c[0:3] + d_gl * bar @ c[3:6]
    d[6] = d_gl * bar @ d[3:6]
    return a, b, c, d


def state_names(structure: Structure) -> tuple[str, ...]:
    """Return the names of the states in their order."""
    first = {g: body for body, g in reversed(list(zip("mgl", structure.groups, strict=True)))}
    z = [first[g] for g in range(structure.size)]
    return (
        *(f"q_{body}" for body in z),
        *(("q_l",) if structure.output_fixed else ()),
        *(f"dq_{body}" for body in z),
    )


def zero_order_hold(a: Matrix, b: Matrix, dt: float) -> tuple[Matrix, Matrix]:
    """Return the exact discrete A and B for inputs held over dt [s] (matrix exponential).

    The states are balanced beforehand: stiff torsion bars give entries of 1e8 beside ones.
    """
    n, m = b.shape
    joined = np.zeros((n + m, n + m))
    joined[:n, :n], joined[:n, n:] = a * dt, b * dt
    from scipy.linalg import expm, matrix_balance  # takes long to import

    _, (scale, _) = matrix_balance(joined[:n, :n], permute=False, separate=True)
    full = np.concatenate([scale, np.ones(m)])
    exact = expm(joined * full[None, :] / full[:, None]) * full[:, None] / full[None, :]
    return exact[:n, :n], exact[:n, n:]


def frequency_response(
    a: Matrix, b: Matrix, c: Matrix, d: Matrix, s: NDArray[np.complexfloating[Any, Any]]
) -> Complex:
    """Return C (s - A)^-1 B + D, shape (points, outputs, inputs).

    Of a sampled system the points s, shape (points,), are z = exp(s dt).
    """
    x = np.linalg.solve(s[:, None, None] * np.eye(len(a)) - a, b + 0j)
    return np.asarray(c @ x + d, dtype=np.complex128)


def state_space(p: JointParameters, structure: Structure, dt: float | None) -> control.StateSpace:
    """Return the joint as a python-control system, continuous or sampled with zero-order hold."""
    import control

    a, b, c, d = state_matrices(p, structure)
    names = {
        "states": list(state_names(structure)),
        "inputs": ["tau_m", "dq_l" if structure.output_fixed else "tau_l"],
        "outputs": list(OUTPUTS),
    }
    if dt is None:
        return control.ss(a, b, c, d, **names)
    a_d, b_d = zero_order_hold(a, b, dt)
    return control.ss(a_d, b_d, c, d, dt, **names)


INVISIBLE = 1e-9
"""Largest sine of an angle at which a direction counts as within a subspace."""


def minimal_transfer(
    system: control.StateSpace, output: str, input: str
) -> control.TransferFunction:
    """Return the minimal transfer function between two named signals."""
    import control
    from scipy.signal import BadCoefficients

    for what, name, known in (
        ("output", output, system.output_labels),
        ("input", input, system.input_labels),
    ):
        check_name(f"{what} of the joint", name, known)
    row, column = system.output_labels.index(output), system.input_labels.index(input)
    a, b, c = system.A, system.B[:, [column]], system.C[[row]]
    shift = np.eye(len(a)) if system.isdtime(strict=True) else np.zeros_like(a)
    a, b, c = _observable(a - shift, b, c)
    a, c, b = (x.T for x in _observable(a.T, c.T, b.T))
    d = system.D[[row]][:, [column]]
    shift = np.eye(len(a)) if system.isdtime(strict=True) else np.zeros_like(a)
    with warnings.catch_warnings():  # of leading zeros, which are what a transfer function has
        warnings.simplefilter("ignore", BadCoefficients)
        found = control.tf(control.ss(a + shift, b, c, d, system.dt))
    found.update_names(name=f"{output}/{input}", inputs=[input], outputs=[output])
    return found


def _observable(a: Matrix, b: Matrix, c: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Return a system without its unobservable states."""
    from scipy.linalg import matrix_balance

    if not (len(a) and c.any()):
        return np.zeros((0, 0)), np.zeros((0, b.shape[1])), np.zeros((c.shape[0], 0))
    balanced, transform = matrix_balance(a, permute=False)
    inward, outward = np.linalg.solve(transform, b), c @ transform
    unit = balanced / max(float(np.abs(balanced).max()), 1e-300)
    seen = outward / np.linalg.norm(outward)
    while True:
        more = seen @ unit
        more -= more @ seen.T @ seen
        _, size, rows = np.linalg.svd(more)
        fresh = rows[: len(size)][size > INVISIBLE]
        if not len(fresh):
            return seen @ balanced @ seen.T, seen @ inward, outward @ seen.T
        seen = np.linalg.qr(np.vstack([seen, fresh]).T)[0].T


def resonance(p: JointParameters) -> float:
    """Return the undamped resonance with locked output, sqrt(k_b / (I_m + I_g)) / (2 pi) [Hz]."""
    return math.sqrt(p.k_b / (p.I_m + p.get("I_g", 0.0))) / (2.0 * math.pi)
