"""Limits of symbolic expressions, and their values for a joint."""

from __future__ import annotations

import sympy as sp

from cjt_gym.joint import JointParameters
from cjt_gym.symbolic.equations import S, symbol, tidy


def to_infinity(expression: sp.Expr, *names: str) -> sp.Expr:
    """Return a rational expression where parameters grow without bound, one after the other.

    Raises:
        UnknownNameError: There is no such parameter.
    """
    small = sp.Symbol("epsilon", positive=True)
    for name in names:
        inverted = sp.cancel(sp.together(expression.subs(symbol(name), 1 / small)))
        expression = tidy(inverted.subs(small, 0))
    return expression


def to_zero(expression: sp.Expr, *names: str) -> sp.Expr:
    """Return a rational expression without some parameters, such as small dampings.

    Raises:
        UnknownNameError: There is no such parameter.
    """
    return tidy(sp.cancel(expression.subs({symbol(name): 0 for name in names})))


def stiffen_gearbox(expression: sp.Expr) -> sp.Expr:
    """Return an expression with a rigid gearbox, k_g to infinity."""
    return to_infinity(expression, "k_g")


def lock_output(expression: sp.Expr) -> sp.Expr:
    """Return an expression with a locked output, I_l to infinity."""
    return to_infinity(expression, "I_l")


def evaluate(expression: sp.Expr, p: JointParameters) -> sp.Expr:
    """Return an expression with the numbers of a joint; s stays.

    Parameters that a joint file may leave out (dampings, frictions, I_g, I_l) are zero there.

    Raises:
        ParameterError: The joint lacks a parameter.
    """
    values = {}
    for name in sorted(str(x) for x in expression.free_symbols if x != S):
        optional = name in ("I_g", "I_l") or name.startswith("d_")
        values[symbol(name)] = p.get(name, 0.0) if optional else getattr(p, name)
    return expression.subs(values)
