"""Collects the mistakes of a joint file, so that they are reported at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from cjt_gym.errors import ParameterError


class Mistakes:
    """The mistakes that were found in one place.

    Example:
        >>> mistakes = Mistakes("mine.toml")
        >>> with mistakes.collected():
        ...     raise ParameterError("k_b of mine.toml must be > 0 N m/rad, got -6.")
        >>> mistakes.found
        ['k_b of mine.toml must be > 0 N m/rad, got -6.']
    """

    def __init__(self, origin: str) -> None:
        """Begin without any; `origin` says where they are looked for."""
        self.origin = origin
        self.found: list[str] = []

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Take down the ParameterError that the block raises, and go on behind it."""
        try:
            yield
        except ParameterError as error:
            self.found += error.mistakes

    def check(self) -> None:
        """Raise all that was found as one ParameterError, if there is anything."""
        found = tuple(dict.fromkeys(self.found))
        if len(found) == 1:
            raise ParameterError(found[0])
        if found:
            listing = "\n".join(f"({k}) {text}" for k, text in enumerate(found, 1))
            raise ParameterError(f"{self.origin} has {len(found)} mistakes:\n{listing}", found)
