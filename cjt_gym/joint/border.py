"""Checks of arrays before they reach compiled code, which does no bounds checking."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from cjt_gym.errors import ConfigurationError

REAL = "fiub"
"""Kinds of dtypes that are numbers without an imaginary part."""


def checked_array(
    what: str,
    values: ArrayLike,
    shape: tuple[int | None, ...],
    dtype: DTypeLike = np.float64,
    *,
    finite: bool = True,
) -> NDArray[Any]:
    """Return values as a contiguous array of a given shape and type.

    Args:
        what: What error messages call it.
        values: Numbers.
        shape: Its length in each dimension; None where it may be any from 1 on.
        dtype: Type of the result.
        finite: Whether NaN and infinity are errors; of the type of the result, so that a number
            too large for it counts as infinite.

    Example:
        >>> checked_array("load", [1, 2], (2,))
        array([1., 2.])
    """
    try:
        given = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise ConfigurationError(f"{what} must be an array of numbers: {error}.") from None
    if given.dtype.kind not in REAL:
        raise ConfigurationError(f"{what} must hold real numbers, got {_kind(values, given)}.")
    if given.ndim != len(shape) or any(
        n < 1 if want is None else n != want for n, want in zip(given.shape, shape, strict=True)
    ):
        wanted = ", ".join("n" if want is None else str(want) for want in shape)
        comma = "," if len(shape) == 1 else ""
        raise ConfigurationError(
            f"{what} must have the shape ({wanted}{comma}), got {given.shape}."
        )
    with np.errstate(over="ignore"):
        array: NDArray[Any] = np.asarray(given, dtype=dtype, order="C")
    if finite and not np.isfinite(array).all():
        where = np.unravel_index(int(np.argmin(np.isfinite(array))), array.shape)
        at = f" at {tuple(map(int, where))}" if array.ndim else ""
        raise ConfigurationError(f"{what} must be finite, got {given[where]}{at}.")
    return array


def _kind(values: object, given: NDArray[Any]) -> str:
    """Return what was given instead of real numbers, in words."""
    single = given.dtype.kind == "O" and given.ndim == 0
    return f"a {type(values).__name__}" if single else f"the type {given.dtype}"
