"""Symbolic expressions as LaTeX and as code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import sympy as sp

from cjt_gym.errors import check_name

CODE: Mapping[str, Callable[[sp.Expr], str]] = MappingProxyType(
    {
        "python": sp.pycode,
        "c": sp.ccode,
        "fortran": sp.fcode,
        "julia": sp.julia_code,
        "matlab": sp.octave_code,
    }
)
"""Languages that expressions are written in."""


def to_latex(expression: sp.Expr | sp.Matrix) -> str:
    r"""Return LaTeX; indices are set upright.

    Example:
        >>> from cjt_gym.symbolic import symbol
        >>> to_latex(symbol("k_b") / symbol("I_m"))
        '\\frac{k_{\\mathrm{b}}}{I_{\\mathrm{m}}}'
    """
    names = {}
    for x in expression.free_symbols:
        base, _, low = str(x).partition("_")
        if low:
            names[x] = f"{base}_{{\\mathrm{{{low}}}}}"
    return str(sp.latex(expression, symbol_names=names))


def to_code(expression: sp.Expr, language: str = "python") -> str:
    """Return an expression as code in which parameters have their own names.

    Raises:
        UnknownNameError: The language is not known.
    """
    check_name("language", language, CODE)
    return str(CODE[language](expression))
