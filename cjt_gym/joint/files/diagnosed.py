"""The `[found]` tables of a diagnosed joint: covariance of its numbers, and where they hold.

``[found.covariance]`` has `names` (such as "damping.d_m", as randomisations call them), `values`
and `matrix`, in the units of the file. ``[found.speed]``, ``torque``, ``frequency`` and
``temperature`` have `low`, `high` and `unit`. ``[found.input]`` has
`share`, `load_share` and `dt`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ParameterError
from cjt_gym.joint.files.joint_file import JointFile

QUANTITIES = ("speed", "torque", "frequency", "temperature")
"""What a range may be of."""
ROUNDING = 1e-4
"""Negative part of a covariance, relative to its largest, that is its digits'."""
SIMILAR = 1.5
"""Ratio of two sample times up to which a record is like another."""
REMEDY = "Write the file with  cjt-gym diagnose  again, or remove the table."


@dataclass(frozen=True, eq=False)
class Covariance:
    """The uncertainty of the numbers of a joint, and how they vary together."""

    names: tuple[str, ...]  # numbers of the file, such as "damping.d_m"
    values: NDArray[np.float64]  # their values, shape (n,)
    matrix: NDArray[np.float64]  # their covariance, shape (n, n)


@dataclass(frozen=True)
class Range:
    """A range of values in which a joint was identified."""

    low: float  # lowest value
    high: float  # highest value
    unit: str  # unit of both


def covariance_of(file: JointFile) -> Covariance | None:
    """Return the covariance in a joint file, or None."""
    table = file.found.get("covariance")
    if table is None:
        return None
    owner = f"[found.covariance] of {file.parameters.origin}"
    if not isinstance(table, Mapping) or not {"names", "values", "matrix"} <= table.keys():
        raise ParameterError(f"{owner} must have names, values and matrix. {REMEDY}")
    names = table["names"]
    if not isinstance(names, tuple) or not all(isinstance(name, str) for name in names):
        raise ParameterError(f"names of {owner} must be a list of texts, got {names!r}. {REMEDY}")
    count = len(names)
    values = _numbers(table["values"], (count,), f"values of {owner}")
    matrix = _numbers(table["matrix"], (count, count), f"matrix of {owner}")
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scaled = matrix / np.outer(*(2 * [np.where(size > 0.0, size, 1.0)]))
    even = np.allclose(scaled, scaled.T, atol=ROUNDING)
    if not even or np.linalg.eigvalsh(0.5 * (scaled + scaled.T)).min(initial=0.0) < -ROUNDING:
        raise ParameterError(
            f"matrix of {owner} must be symmetric and without negative variances. {REMEDY}"
        )
    return Covariance(tuple(map(str, names)), values, 0.5 * (matrix + matrix.T))


def ranges_of(file: JointFile) -> dict[str, Range]:
    """Return the ranges in which a joint was identified, by quantity."""
    return {name: _range(file, name) for name in QUANTITIES if name in file.found}


def shares_of(file: JointFile, dt: float) -> tuple[float, float]:
    """Return how torque and load of a record act from row to row, as a diagnosis found it.

    Args:
        file: The joint.
        dt: Sample time of the record [s].

    Returns:
        Rows after its own at which is logged what acts from a row to the next, of the torque and of
        the load: zero where they are held, and where the sample time is another.
    """
    table = file.found.get("input")
    if table is None:
        return 0.0, 0.0
    owner = f"[found.input] of {file.parameters.origin}"
    if not isinstance(table, Mapping) or not {"share", "load_share", "dt"} <= table.keys():
        raise ParameterError(f"{owner} must have share, load_share and dt. {REMEDY}")
    given = (table["share"], table["load_share"], table["dt"])
    share, load, known = _numbers(given, (3,), f"share, load_share and dt of {owner}").tolist()
    if not (share >= 0.0 and load >= 0.0 and known > 0.0):
        raise ParameterError(
            f"{owner} must have share and load_share >= 0 and dt > 0, got {share:g}, {load:g} and "
            f"{known:g}. {REMEDY}"
        )
    return (share, load) if known / SIMILAR <= dt <= SIMILAR * known else (0.0, 0.0)


def _range(file: JointFile, name: str) -> Range:
    table, owner = file.found[name], f"[found.{name}] of {file.parameters.origin}"
    if not isinstance(table, Mapping) or not {"low", "high", "unit"} <= table.keys():
        raise ParameterError(f"{owner} must have low, high and unit. {REMEDY}")
    low, high = _numbers((table["low"], table["high"]), (2,), f"low and high of {owner}").tolist()
    if low > high:
        raise ParameterError(f"{owner} must have low <= high, got {low:g} and {high:g}. {REMEDY}")
    return Range(low, high, str(table["unit"]))


def _numbers(values: object, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.full(1, np.nan)
    if found.shape != shape or not np.isfinite(found).all():
        text = " x ".join(map(str, shape))
        raise ParameterError(f"{what} must be {text} finite numbers. {REMEDY}")
    return found
