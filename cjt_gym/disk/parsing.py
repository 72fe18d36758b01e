"""Third-party parsers may raise anything; users get one error of this package."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from cjt_gym.errors import CjtGymError

Item = TypeVar("Item")
LONGEST = 300
"""Characters of a foreign message that are shown."""


@contextmanager
def parsing(what: str, error: type[CjtGymError], remedy: str = "") -> Iterator[None]:
    """Turn any exception into an error of this package that says what was read and what is wrong.

    Args:
        what: What must be what, such as "run.mat must be a MATLAB file".
        error: Class of the error.
        remedy: What to do about it, as a sentence.

    Raises:
        CjtGymError: Of the given class for any other exception; our own ones pass.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of parsers about files that are refused or read
            yield
    except CjtGymError:
        raise
    except Exception as reason:  # no list of what they raise is ever complete
        raise error(f"{what}: {reason_of(reason)}. {remedy}".strip()) from reason


def parsed_each(items: Iterable[Item], what: str, error: type[CjtGymError]) -> Iterator[Item]:
    """Yield items that a foreign parser makes one by one; see `parsing`."""
    try:
        yield from items  # what is raised where they are used does not come here
    except CjtGymError:
        raise
    except Exception as reason:
        raise error(f"{what}: {reason_of(reason)}.") from reason


def reason_of(reason: BaseException) -> str:
    """Return an exception as one line that can be shown."""
    text = " ".join(str(reason).split()) or type(reason).__name__
    if isinstance(reason, KeyError):
        text = f"there is no {text}"
    elif isinstance(reason, RecursionError):
        text = "it is nested too deeply"
    elif isinstance(reason, MemoryError):
        text = "it needs more memory than there is"
    text = "".join(c if c.isprintable() else "?" for c in text).rstrip(".")
    return text if len(text) <= LONGEST else text[:LONGEST] + " ..."
