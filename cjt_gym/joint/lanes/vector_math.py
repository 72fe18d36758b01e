"""Sine, cosine and exponential function of vectors, without branches.

Polynomials after a reduction of the argument: errors are below 1e-15, absolute (sine and cosine
for arguments up to 1e5), as a test confirms.

References:
    Cody, Waite (1980), Software Manual for the Elementary Functions, chapters 6, 8 and 13.
"""

from __future__ import annotations

import math
from typing import Any

from cjt_gym.joint.kernel.compiled import inlined
from cjt_gym.joint.lanes.vectors import choose, has_bit, least, madd, power_of_two

# 1.5 * 2^52: adding it leaves the nearest whole number in the low bits.
MAGIC = 6755399441055744.0
TWO_OVER_PI = 2.0 / math.pi
# pi / 2 in parts of 33 bits, so that a whole number below 2^20 times a part is exact.
HALF_PI_1 = float.fromhex("0x1.921fb54400000p+0")
HALF_PI_2 = float.fromhex("0x1.0b4611a600000p-34")
HALF_PI_3 = float.fromhex("0x1.3198a2e037073p-69")
LOG2_E = 1.0 / math.log(2.0)
LN_2_1 = float.fromhex("0x1.62e42fee00000p-1")
LN_2_2 = float.fromhex("0x1.a39ef35793c76p-33")
SATURATED = 20.0  # beyond it tanh, of which `decay` is a part, is 1 in doubles
# Polynomials through the nodes of Chebyshev, lowest power first:
# (sin r / r - 1) / z and (cos r - 1 + z / 2) / z^2 over z = r^2, for |r| <= pi / 4,
ODD = (
    -0.16666666666666666,
    0.008333333333330925,
    -0.00019841269836722418,
    2.755731608381636e-06,
    -2.5051127944014188e-08,
    1.5917848524808262e-10,
)
EVEN = (
    0.041666666666666664,
    -0.0013888888888887382,
    2.480158729874307e-05,
    -2.7557317260008837e-07,
    2.0876143827993133e-09,
    -1.1382456778061306e-11,
)
# and (exp r - 1 - r) / r^2 over r, for |r| <= log(2) / 2.
EXPONENTIAL = (
    0.5000000000000001,
    0.16666666666666669,
    0.041666666666623824,
    0.008333333333330039,
    0.0013888888917367081,
    0.00019841269863171557,
    2.4801521057868204e-05,
    2.7557268276905696e-06,
    2.7620201591031547e-07,
    2.5100472505694996e-08,
)


@inlined
def six(x: Any, c: tuple[float, ...]) -> Any:
    """Return a polynomial of degree five; the order of sums keeps the chain of products short."""
    y = x * x
    first, second = madd(x, c[1], c[0]), madd(x, c[3], c[2])
    return madd(y, madd(y, madd(x, c[5], c[4]), second), first)


@inlined
def sine_cosine(x: Any) -> tuple[Any, Any]:
    """Return sin(x) and cos(x) of an angle [rad] of at most 1e5."""
    shifted = madd(x, TWO_OVER_PI, MAGIC)
    turns = shifted - MAGIC
    r = madd(turns, -HALF_PI_1, x)
    r = madd(turns, -HALF_PI_2, r)
    r = madd(turns, -HALF_PI_3, r)
    z = r * r
    s = madd(r * z, six(z, ODD), r)
    c = madd(z * z, six(z, EVEN), madd(z, -0.5, 1.0))
    swapped = has_bit(shifted, 1)
    sine, cosine = choose(swapped, c, s), choose(swapped, s, c)
    sine = choose(has_bit(shifted, 2), 0.0 - sine, sine)
    cosine = choose(has_bit(shifted + 1.0, 2), 0.0 - cosine, cosine)
    return sine, cosine


@inlined
def decay(x: Any) -> Any:
    """Return exp(-2 |x|)."""
    y = -2.0 * least(abs(x), SATURATED)
    shifted = madd(y, LOG2_E, MAGIC)
    whole = shifted - MAGIC
    r = madd(whole, -LN_2_1, y)
    r = madd(whole, -LN_2_2, r)
    z = r * r
    fourth = z * z
    high = madd(r, EXPONENTIAL[9], EXPONENTIAL[8])
    high = madd(z, high, madd(r, EXPONENTIAL[7], EXPONENTIAL[6]))
    e = madd(fourth, high * z, six(r, EXPONENTIAL[:6]))
    return madd(z, e, 1.0 + r) * power_of_two(shifted)
