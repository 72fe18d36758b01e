"""The torque of a bar by a table: a monotone cubic through measured points.

Rows [x, c_0, c_1, c_2, c_3] hold T(x_j + u) = c_0 + c_1 u + c_2 u^2 + c_3 u^3 up to the next point;
beyond both ends the slope of the end goes on. The kernel keeps them behind what a joint remembers.

References:
    Fritsch, Butland (1984), SIAM Journal on Scientific and Statistical Computing 5(2).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk.text import read_text
from cjt_gym.errors import MissingFileError, ParameterError
from cjt_gym.joint.kernel.arrays import MEMORY, Floats
from cjt_gym.joint.kernel.compiled import lean

NAME = "spring_table"
COLUMNS = 5
HEADER = ("deflection", "torque")


def spring_rows(effects: Mapping[str, Mapping[str, Any]], owner: str) -> NDArray[np.float64]:
    """Return the rows of the table among the effects, shape (points, 5); none without a table.

    Points of deflections >= 0 alone count for the other direction, too.
    """
    values = effects.get(NAME)
    if values is None or not any(values["torque"]):
        return np.zeros((0, COLUMNS))
    x, tau = np.array(values["deflection"]), np.array(values["torque"])
    if x.min() >= 0.0 and (np.diff(x) > 0.0).all():
        keep = x > 0.0
        zero = np.zeros(1)
        x = np.concatenate([-x[keep][::-1], zero, x[keep]])
        tau = np.concatenate([-tau[keep][::-1], zero, tau[keep]])
    for name, series in (("deflection", x), ("torque", tau)):
        if len(series) < 2 or not (np.diff(series) > 0.0).all():
            raise ParameterError(
                f"{NAME}.{name} of {owner} must rise from point to point, two at least, got "
                f"{', '.join(f'{v:g}' for v in series[:8])}. Sort the points, and leave out those "
                "at which the spring gives way."
            )
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(x, tau)
    last = np.array([[x[-1], tau[-1], float(curve.derivative()(x[-1])), 0.0, 0.0]])
    return np.vstack([np.column_stack([x[:-1], curve.c[::-1].T]), last])


def read_spring(path: str | Path) -> dict[str, tuple[float, ...]]:
    """Return the points of a file, as values of the effect `spring_table`.

    Args:
        path: CSV with the columns deflection [rad] and torque [N m], named in its first line.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: It has other columns, something that is no number, or no torque.

    Example:
        load_joint("orange_80_6000", effects={"spring_table": read_spring("bar.csv")})
    """
    try:
        lines = read_text(Path(path), ParameterError).split("\n")
    except FileNotFoundError:
        raise MissingFileError(f"The spring's points {path} do not exist.") from None
    rows = [line.split(",") for line in lines if line.strip() and not line.startswith("#")]
    names = tuple(word.strip() for word in rows[0]) if rows else ()
    if names != HEADER:
        raise ParameterError(
            f"The first line of {path} must be '{','.join(HEADER)}', got '{','.join(names)}'."
        )
    try:
        points = np.array([(float(one), float(other)) for one, other in rows[1:]]).reshape(-1, 2)
    except ValueError:
        raise ParameterError(
            f"Every line of {path} must hold two numbers, deflection [rad] and torque [N m]."
        ) from None
    if not points[:, 1].any():
        raise ParameterError(f"{path} must hold a point with a torque that is not 0 N m, got none.")
    return {name: tuple(points[:, j].tolist()) for j, name in enumerate(HEADER)}


@lean
def entry(memory: Floats, j: int, column: int) -> float:
    """Return a number of row j of the table."""
    return float(memory[MEMORY + COLUMNS * j + column])


@lean
def segment_of(memory: Floats, x: float) -> int:
    """Return the row that holds at a deflection, -1 before the first point."""
    low, high = -1, (memory.shape[0] - MEMORY) // COLUMNS - 1
    while low < high:
        middle = (low + high + 1) // 2
        if entry(memory, middle, 0) <= x:
            low = middle
        else:
            high = middle - 1
    return low


@lean
def value_in(memory: Floats, j: int, x: float) -> tuple[float, float]:
    """Return torque [N m] and stiffness [N m/rad] by row j; by the first point's slope for -1."""
    row = max(j, 0)
    u, c_0, c_1 = x - entry(memory, row, 0), entry(memory, row, 1), entry(memory, row, 2)
    if j < 0:
        return c_0 + c_1 * u, c_1
    c_2, c_3 = entry(memory, row, 3), entry(memory, row, 4)
    return c_0 + u * (c_1 + u * (c_2 + u * c_3)), c_1 + u * (2.0 * c_2 + 3.0 * u * c_3)


@lean
def table_torque(memory: Floats, x: float) -> tuple[float, float]:
    """Return torque [N m] and stiffness [N m/rad] of the table at a deflection [rad]."""
    return value_in(memory, segment_of(memory, x), x)


@lean
def mean_torque(memory: Floats, x0: float, x1: float) -> float:
    """Return the mean torque between two deflections [N m]: Simpson's rule, exact per segment."""
    if x1 == x0:
        torque, _ = table_torque(memory, x0)
        return torque
    low, high = min(x0, x1), max(x0, x1)
    total, here, j = 0.0, low, segment_of(memory, low)
    last = segment_of(memory, high)
    while True:
        end = high if j >= last else entry(memory, j + 1, 0)
        a, _ = value_in(memory, j, here)
        b, _ = value_in(memory, j, 0.5 * (here + end))
        c, _ = value_in(memory, j, end)
        total += (end - here) * (a + 4.0 * b + c) / 6.0
        if j >= last:
            return total / (high - low)
        here, j = end, j + 1
