"""Sine, cosine and hyperbolic tangent of vectors, without branches.

Polynomials after a reduction of the argument: errors are below 1e-15, absolute (sine and cosine
for arguments up to 1e5), as a test confirms.

References:
    Cody, Waite (1980), Software Manual for the Elementary Functions, chapters 6, 8 and 13.
"""

from __future__ import annotations

import math
from typing import Any

from cjt_gym.joint.compiled import lean
from cjt_gym.joint.vectors import choose, has_bit, least, madd, power_of_two, size

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
SATURATED = 20.0  # beyond it tanh is 1 in doubles


@lean
def sine_cosine(x: Any) -> tuple[Any, Any]:
    """Return sin(x) and cos(x) of an angle [rad] of at most 1e5."""
    shifted = madd(x, TWO_OVER_PI, MAGIC)
    turns = shifted - MAGIC
    r = madd(turns, -HALF_PI_1, x)
    r = madd(turns, -HALF_PI_2, r)
    r = madd(turns, -HALF_PI_3, r)
    z = r * r
    odd = madd(z, -1.0 / 1307674368000.0, 1.0 / 6227020800.0)
    odd = madd(z, odd, -1.0 / 39916800.0)
    odd = madd(z, odd, 1.0 / 362880.0)
    odd = madd(z, odd, -1.0 / 5040.0)
    odd = madd(z, odd, 1.0 / 120.0)
    odd = madd(z, odd, -1.0 / 6.0)
    s = madd(r, z * odd, r)
    even = madd(z, 1.0 / 20922789888000.0, -1.0 / 87178291200.0)
    even = madd(z, even, 1.0 / 479001600.0)
    even = madd(z, even, -1.0 / 3628800.0)
    even = madd(z, even, 1.0 / 40320.0)
    even = madd(z, even, -1.0 / 720.0)
    even = madd(z, even, 1.0 / 24.0)
    even = madd(z, even, -0.5)
    c = madd(z, even, 1.0)
    swapped = has_bit(shifted, 1)
    sine, cosine = choose(swapped, c, s), choose(swapped, s, c)
    sine = choose(has_bit(shifted, 2), 0.0 - sine, sine)
    cosine = choose(has_bit(shifted + 1.0, 2), 0.0 - cosine, cosine)
    return sine, cosine


@lean
def tanh(x: Any) -> Any:
    """Return the hyperbolic tangent, (1 - e) / (1 + e) with e = exp(-2 |x|)."""
    y = -2.0 * least(size(x), SATURATED)
    shifted = madd(y, LOG2_E, MAGIC)
    whole = shifted - MAGIC
    r = madd(whole, -LN_2_1, y)
    r = madd(whole, -LN_2_2, r)
    e = madd(r, 1.0 / 6227020800.0, 1.0 / 479001600.0)
    e = madd(e, r, 1.0 / 39916800.0)
    e = madd(e, r, 1.0 / 3628800.0)
    e = madd(e, r, 1.0 / 362880.0)
    e = madd(e, r, 1.0 / 40320.0)
    e = madd(e, r, 1.0 / 5040.0)
    e = madd(e, r, 1.0 / 720.0)
    e = madd(e, r, 1.0 / 120.0)
    e = madd(e, r, 1.0 / 24.0)
    e = madd(e, r, 1.0 / 6.0)
    e = madd(e, r, 0.5)
    e = madd(e, r, 1.0)
    e = madd(e, r, 1.0) * power_of_two(shifted)
    t = (1.0 - e) / (1.0 + e)
    return choose(x < 0.0, 0.0 - t, t)
