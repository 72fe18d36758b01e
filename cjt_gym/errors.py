"""One tree of errors; every class is also the builtin that a caller would expect.

Every message names the thing, its owner, what is allowed with its unit, what was given, and the
remedy.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray


class CjtGymError(Exception):
    """Base of everything that this package raises on purpose."""


class CjtGymWarning(UserWarning):
    """Something that runs, and is hardly what was meant."""


class OutsideFoundWarning(CjtGymWarning):
    """A simulation leaves the ranges at which a diagnosis found the joint."""


class ParameterError(CjtGymError, ValueError):
    """A joint parameter, or the file that holds it, is missing, malformed or out of range.

    Attributes:
        mistakes: One message for each mistake that was found; the message itself if it is one.
    """

    mistakes: tuple[str, ...]

    def __init__(self, message: str, mistakes: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.mistakes = mistakes or (message,)


class ConfigurationError(CjtGymError, ValueError):
    """Options that are valid one by one do not fit together, or an option is out of range."""


class CommandError(ConfigurationError):
    """A controller's own code returned what is no motor torque."""


class ProtocolError(CjtGymError, ValueError):
    """A frame on the bus, or what is to be sent in one, breaks the drive's protocol."""


class RecordError(CjtGymError, ValueError):
    """A time series, or the file that holds it, breaks the record format."""


class UnknownNameError(CjtGymError, LookupError):
    """A name is not in the set that it has to come from."""


class MissingFileError(CjtGymError, FileNotFoundError):
    """A file that was asked for does not exist."""


class HardwareError(CjtGymError, RuntimeError):
    """A drive, a bus or a run on real hardware failed, and was stopped."""


class SimulationError(CjtGymError, FloatingPointError):
    """The simulation left the finite numbers.

    Attributes:
        last_good_states: States of the last finite step, as the simulator lays them out; None if
            there was none.
    """

    last_good_states: NDArray[np.float64] | None

    def __init__(self, message: str, last_good_states: NDArray[np.float64] | None = None) -> None:
        super().__init__(message)
        self.last_good_states = last_good_states


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``" Did you mean 'x'?"`` for the known name closest to `name`, or an empty string.

    Example:
        >>> did_you_mean("orang", ["orange", "lemon"])
        " Did you mean 'orange'?"
        >>> did_you_mean("k_B", ["k_t", "k_b"])
        " Did you mean 'k_b'?"
        >>> did_you_mean("lgq", ["lqi", "lqg"])
        " Did you mean 'lqg'?"
        >>> did_you_mean("dt", ["drive", "dt_control"])
        " Did you mean 'dt_control'?"
    """
    names = list(known)
    same = [one for one in names if one.lower() == name.lower()]
    close = get_close_matches(name, names, n=5)
    swapped = [one for one in close if sorted(one) == sorted(name)]
    begun = [one for one in names if one.startswith(f"{name}_")]
    matches = same or swapped or close or begun
    return f" Did you mean '{matches[0]}'?" if matches else ""


def unknown_name(what: str, name: str, known: Iterable[str]) -> UnknownNameError:
    """Return the error for a `name` that is not among the `known` ones.

    Args:
        what: Kind of the thing in words, such as "joint" or "effect".
        name: The name that was given.
        known: The names that exist.

    Example:
        >>> str(unknown_name("joint", "orang", ["orange", "lemon"]))
        "Unknown joint 'orang'. Did you mean 'orange'? Known: lemon, orange."
    """
    names = sorted(known)
    listing = ", ".join(names) if names else "none"
    return UnknownNameError(
        f"Unknown {what} '{name}'.{did_you_mean(name, names)} Known: {listing}."
    )


def unknown_key(owner: str, key: str, known: Collection[str], what: str = "key") -> str:
    """Return in words that a table has a key that is not among the `known` ones."""
    hint = did_you_mean(key, known)
    return f"{owner} has the unknown {what} '{key}'.{hint} Known: {', '.join(known)}."


def check_name(what: str, name: object, known: Collection[str]) -> None:
    """Raise `unknown_name` unless `name` is among the `known` ones."""
    try:
        is_known = name in known
    except TypeError:  # a list or a table is no key of a table
        is_known = False
    if not is_known:
        raise unknown_name(what, str(name), known)


def check_type(what: str, value: object, kinds: type | tuple[type, ...], wanted: str) -> None:
    """Check that a value is of one of some types.

    `what` is its name and whose it is, `wanted` says in words what it must be.

    Raises:
        ConfigurationError: It is of no such type.

    Example:
        >>> check_type("joint", None, str, "the name of a joint")
        Traceback (most recent call last):
        cjt_gym.errors.ConfigurationError: joint must be the name of a joint, got None.
    """
    if not isinstance(value, kinds):
        raise ConfigurationError(f"{what} must be {wanted}, got {value!r}.")


def check_range(
    what: str,
    value: Any,
    unit: str = "",
    *,
    low: float = -math.inf,
    above: float = -math.inf,
    high: float = math.inf,
    finite: bool = True,
    whole: bool = False,
) -> None:
    """Check that a value is a number, not less than `low`, more than `above`, at most `high`.

    `what` is its name and whose it is; it may be infinite unless it must be `finite`, and must be a
    `whole` number where that is said.

    Raises:
        ConfigurationError: It is no such number.

    Example:
        >>> check_range("dt of mine.toml", 0.2, "s", above=0.0, high=0.1)
        Traceback (most recent call last):
        cjt_gym.errors.ConfigurationError: dt of mine.toml must be > 0 and <= 0.1 s, got 0.2.
    """
    is_number = isinstance(value, Integral if whole else Real) and not isinstance(value, bool)
    number = float(value) if is_number else math.nan
    if above < number and low <= number <= high and (math.isfinite(number) or not finite):
        return
    ends = ((">", above), (">=", low), ("<=", high))
    allowed = [f"{sign} {end:.10g}" for sign, end in ends if math.isfinite(end)]
    if finite and not whole and math.isinf(high) and type(value) is not int:
        allowed.insert(0, "finite")
    kind = "a whole number " * whole + " and ".join(allowed)
    raise ConfigurationError(f"{what} must be {kind}{unit and ' '}{unit}, got {value!r}.")
