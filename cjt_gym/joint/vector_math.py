"""Sine, cosine and hyperbolic tangent without branches, so that loops over joints vectorise.

A library call per joint keeps a loop from using the vector units. These are polynomials after a
reduction of the argument, in plain arithmetic on doubles: errors are below 1e-15 (sine and cosine,
for arguments up to 1e5) and 1e-15 (tanh), absolute, as a test confirms.

References:
    Cody, Waite (1980), Software Manual for the Elementary Functions, chapters 6, 8 and 13.
"""

from __future__ import annotations

import math

import numpy as np

from cjt_gym.joint.compiled import vectorisable

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
ONE, TWO, THREE, BIAS, MANTISSA = (np.int64(x) for x in (1, 2, 3, 1023, 52))


@vectorisable
def sine_cosine(x: float) -> tuple[float, float]:
    """Return sin(x) and cos(x) of an angle [rad] of at most 1e5."""
    shifted = x * TWO_OVER_PI + MAGIC
    quadrant = np.float64(shifted).view(np.int64)
    turns = shifted - MAGIC
    r = ((x - turns * HALF_PI_1) - turns * HALF_PI_2) - turns * HALF_PI_3
    z = r * r
    odd = -1.0 / 1307674368000.0
    odd = odd * z + 1.0 / 6227020800.0
    odd = odd * z - 1.0 / 39916800.0
    odd = odd * z + 1.0 / 362880.0
    odd = odd * z - 1.0 / 5040.0
    odd = odd * z + 1.0 / 120.0
    odd = odd * z - 1.0 / 6.0
    s = r + r * (z * odd)
    even = 1.0 / 20922789888000.0
    even = even * z - 1.0 / 87178291200.0
    even = even * z + 1.0 / 479001600.0
    even = even * z - 1.0 / 3628800.0
    even = even * z + 1.0 / 40320.0
    even = even * z - 1.0 / 720.0
    even = even * z + 1.0 / 24.0
    even = even * z - 0.5
    c = 1.0 + z * even
    swapped = (quadrant & ONE) != 0
    sine, cosine = (c, s) if swapped else (s, c)
    sine = -sine if (quadrant & TWO) != 0 else sine
    cosine = -cosine if ((quadrant + ONE) & TWO) != 0 else cosine
    return sine, cosine


@vectorisable
def tanh(x: float) -> float:
    """Return the hyperbolic tangent, (1 - e) / (1 + e) with e = exp(-2 |x|)."""
    a = abs(x)
    y = -2.0 * (a if a < SATURATED else SATURATED)
    shifted = y * LOG2_E + MAGIC
    power = np.float64(shifted).view(np.int64)
    whole = shifted - MAGIC
    r = (y - whole * LN_2_1) - whole * LN_2_2
    e = 1.0 / 6227020800.0
    e = e * r + 1.0 / 479001600.0
    e = e * r + 1.0 / 39916800.0
    e = e * r + 1.0 / 3628800.0
    e = e * r + 1.0 / 362880.0
    e = e * r + 1.0 / 40320.0
    e = e * r + 1.0 / 5040.0
    e = e * r + 1.0 / 720.0
    e = e * r + 1.0 / 120.0
    e = e * r + 1.0 / 24.0
    e = e * r + 1.0 / 6.0
    e = e * r + 0.5
    e = e * r + 1.0
    e = e * r + 1.0
    e *= np.int64((power + BIAS) << MANTISSA).view(np.float64)
    t = (1.0 - e) / (1.0 + e)
    return -t if x < 0.0 else t
