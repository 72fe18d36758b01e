"""What looks wrong in a record but is not for the record to change: limits, units, signs, lateness.

Everything here follows from the columns alone. What takes a model of the joint is left to those
who have one.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

import numpy as np

from cjt_gym.records.checks import FloatArray
from cjt_gym.records.repair_notes import Repair, share

MANY_TURNS = 20.0 * pi
"""Range of an angle on the link side over which it is hardly in radians of the link [rad]."""
SLOW_LOG = 0.3
"""Sample time [s] from which times are hardly in seconds."""
STRONG = 300.0
"""Current from which it is hardly in ampere [A]."""
FACTORS = {180.0 / pi: "deg/s", 30.0 / pi: "rpm", 1e3: "mrad/s", 0.5 / pi: "rev/s"}
"""Ratio of a velocity to the slope of its angle, with the unit that makes it."""
PAIRS = (("q_m", "dq_m"), ("q_g", "dq_g"), ("q_l", "dq_l"))
ALIKE = 0.8
"""Correlation of a velocity and the slope of its angle from which they are the same motion."""
COPIED = 0.9999
"""Correlation of a velocity and its angle from which they are the same column."""
SIZES = (8, 32, 128)
"""Samples over which both are averaged where noise may hide that they are the same motion."""
PLAIN, UNLIKE = 0.9, 0.3
"""Correlation of neighbouring means of a slope from which it is motion rather than noise, and that
up to which a velocity does not follow it."""
FAR = 5.0
"""Ratio of the way that a velocity adds up to, to that of its angle, above which one is wrong."""
MOST_LATE = 50
"""Samples up to which a channel may be late."""
LATE = 0.7
"""Samples from which lateness is worth saying."""
CLIPPED = 20
"""Samples at the very end of a channel's range from which it looks cut off."""
MOSTLY_NEW = 0.05
"""Share of samples that repeat the one before above which a channel may well rest at an end."""

Columns = Mapping[str, FloatArray]


def doubts(columns: Columns, dt: float) -> list[Repair]:
    """Return what looks wrong in the columns of a record."""
    found = [_clipped(name, columns[name]) for name in ("tau", "i") if name in columns]
    positions = [name for name in columns if name.startswith("q_") and name != "q_ref"]
    currents = [name for name in ("i", "i_cmd") if name in columns]
    found += [_too_large(name, columns[name]) for name in positions + currents]
    if dt > SLOW_LOG:
        text = f"t: a sample every {dt:.3g} s. If these are milliseconds, map t with unit = 'ms'."
        found.append(Repair("unit", "t", len(next(iter(columns.values()))), False, text))
    for angle, velocity in PAIRS:
        if angle in columns and velocity in columns and dt <= SLOW_LOG:
            found.append(_against_slope(angle, velocity, columns, dt))
    return [repair for repair in found if repair is not None]


def _clipped(name: str, x: FloatArray) -> Repair | None:
    """Return that a channel stays at the very end of its range, where it is not at rest there."""
    known = x[np.isfinite(x)]
    if len(known) < 10 * CLIPPED:
        return None
    ends = (known.max(), known.min())
    inside = np.diff(known)[~np.isin(known[1:], ends)]
    if not len(inside) or np.mean(inside == 0.0) > MOSTLY_NEW:
        return None
    count = 0
    for end in ends:
        there, beside = int(np.sum(known == end)), np.abs(known - end) < 0.02 * np.ptp(known)
        count += there if there >= CLIPPED and there > 0.5 * np.sum(beside) else 0
    if not count:
        return None
    text = (
        f"{name}: stays at an end of its range, {known.min():.4g} or {known.max():.4g}, in "
        f"{share(count, len(x))} of the samples; it looks cut off there."
    )
    return Repair("saturation", name, count, False, text)


def _too_large(name: str, x: FloatArray) -> Repair | None:
    """Return that an angle of the joint or a current is too large to be in its unit."""
    known = x[np.isfinite(x)]
    if not len(known):
        return None
    if name.startswith("q_") and np.ptp(known) > MANY_TURNS:
        text = (
            f"{name}: spans {np.ptp(known):.4g} rad, {np.ptp(known) / (2.0 * np.pi):.3g} turns. If "
            "these are degrees or the rotor's angle, map the column with unit = 'deg' or side = "
            "'motor'."
        )
    elif name.startswith("i") and np.abs(known).max() > STRONG:
        text = (
            f"{name}: reaches {np.abs(known).max():.4g} A. If these are milliampere, map the "
            "column with unit = 'mA'."
        )
    else:
        return None
    return Repair("unit", name, len(x), False, text)


def _against_slope(angle: str, velocity: str, columns: Columns, dt: float) -> Repair | None:
    """Return how a velocity contradicts the slope of its angle: in sign, unit or lateness."""
    q, v = _filled(columns[angle]), _filled(columns[velocity])
    if q is None or v is None or len(q) < 4 * MOST_LATE:
        return None
    t = columns["t"] if "t" in columns else np.arange(len(q)) * dt
    slope = np.gradient(q, t)
    lag, alike = lag_of(slope, v)
    if alike < ALIKE:
        unlike = _unlike_slope(angle, velocity, q, v, slope) if abs(alike) < UNLIKE else None
        found = unlike or _farther(angle, velocity, q, v, dt)
        if found is not None or alike > -ALIKE:
            return found
    ratio = float(np.sign(alike) * np.sqrt(np.var(v) / max(np.var(slope), 1e-300)))
    if alike < 0.0:
        text = f"{velocity}: has the sign against the slope of {angle}. Map it with sign = -1."
        return Repair("sign", velocity, len(v), False, text)
    for factor, unit in FACTORS.items():
        if abs(ratio / factor - 1.0) < 0.1:
            text = (
                f"{velocity}: is {ratio:.4g} times the slope of {angle}, as if in {unit}. Map it "
                f"with unit = '{unit}'."
            )
            return Repair("unit", velocity, len(v), False, text)
    if abs(ratio * 180.0 / pi - 1.0) < 0.1:
        text = (
            f"{angle}: its slope is {1.0 / ratio:.4g} times {velocity}, as if in deg. Map it with "
            "unit = 'deg'."
        )
        return Repair("unit", angle, len(q), False, text)
    if abs(lag) > LATE:
        when = "late" if lag > 0 else "early"
        text = (
            f"{velocity}: {1e3 * abs(lag) * dt:.3g} ms {when} against the slope of {angle} "
            f"({abs(lag):.2g} samples)."
        )
        return Repair("lateness", velocity, len(v), False, text)
    return None


def _farther(angle: str, velocity: str, q: FloatArray, v: FloatArray, dt: float) -> Repair | None:
    """Return that a velocity adds up to far more than its angle moves, noise included."""
    added, moved = float(np.abs(v).sum() * dt), float(np.abs(np.diff(q)).sum())
    if added <= FAR * moved or moved == 0.0:
        return None
    text = (
        f"{velocity}: adds up to {added / moved:.2g} times as far as {angle} moves: its unit, "
        "or how its sign is coded, is wrong."
    )
    return Repair("unit", velocity, len(q), False, text)


def _unlike_slope(
    angle: str, velocity: str, q: FloatArray, v: FloatArray, slope: FloatArray
) -> Repair | None:
    """Return that a velocity is its angle over again, or does not follow a slope that is plain."""
    if abs(float(np.corrcoef(q, v)[0, 1])) > COPIED:
        what = f"is {angle} over again rather than its slope"
    else:
        smooth = [(_means(slope, size), _means(v, size)) for size in SIZES if len(q) > 20 * size]
        plain = [(a, b) for a, b in smooth if _alike(a[1:], a[:-1]) > PLAIN]
        if not plain or max(abs(_alike(a, b)) for a, b in plain) > UNLIKE:
            return None
        what = f"does not follow the slope of {angle}"
    text = f"{velocity}: {what}. Map the column that has the velocity, or leave {velocity} out."
    return Repair("unit", velocity, len(v), False, text)


def _means(x: FloatArray, size: int) -> FloatArray:
    count = len(x) // size
    return np.asarray(x[: count * size].reshape(count, size).mean(axis=1))


def _alike(x: FloatArray, y: FloatArray) -> float:
    return float(np.corrcoef(x, y)[0, 1]) if np.ptp(x) > 0.0 and np.ptp(y) > 0.0 else 0.0


def _filled(x: FloatArray) -> FloatArray | None:
    known = np.isfinite(x)
    if known.sum() < 2 or np.ptp(x[known]) == 0.0:
        return None
    index = np.arange(len(x))
    return x if known.all() else np.interp(index, index[known], x[known])


def lag_of(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return by how many samples y follows x, and how alike they then are, -1 to 1."""
    from scipy.signal import correlate  # takes long to import

    x, y = x - x.mean(), y - y.mean()
    lags = np.arange(-MOST_LATE, MOST_LATE + 1)
    cross = correlate(y, x, method="fft")[len(x) - 1 + lags]
    near = cross / np.sqrt(max(float((x @ x) * (y @ y)), 1e-300))
    k = int(np.argmax(np.abs(near)))
    if 0 < k < len(near) - 1:
        a, b, c = np.abs(near[k - 1 : k + 2])
        bend = a - 2.0 * b + c
        return float(lags[k] + (0.5 * (a - c) / bend if bend else 0.0)), float(near[k])
    return float(lags[k]), float(near[k])
