"""The joint in symbols: matrices, transfer functions, limits, LaTeX and code. It needs SymPy.

The equations are those of `cjt_gym.joint.linear`, which are asked for with symbols in the places of
numbers; the structures are the same selections.

Example:
    >>> G = transfer_function("output_fixed_rigid_gearbox")
    >>> print(G)  # doctest: +NORMALIZE_WHITESPACE
    (d_gl*s + k_b)/(k_b + s**2*(I_g + I_m) + s*(d_g + d_gl + d_m))
"""

from cjt_gym.symbolic.equations import (
    Dynamics,
    S,
    dynamics,
    state_space,
    symbol,
    transfer_function,
)
from cjt_gym.symbolic.export import CODE, to_code, to_latex
from cjt_gym.symbolic.simplify import (
    evaluate,
    lock_output,
    stiffen_gearbox,
    to_infinity,
    to_zero,
)

__all__ = [
    "CODE",
    "Dynamics",
    "S",
    "dynamics",
    "evaluate",
    "lock_output",
    "state_space",
    "stiffen_gearbox",
    "symbol",
    "to_code",
    "to_infinity",
    "to_latex",
    "to_zero",
    "transfer_function",
]
