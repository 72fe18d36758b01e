"""Collects the mistakes in a joint file, so that all are reported at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from cjt_gym.errors import ParameterError


class Mistakes:
    """The mistakes found in one file or table.

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
        """Collect the ParameterError that the block raises, and continue after it."""
        try:
            yield
        except ParameterError as error:
            self.found += error.mistakes

    def check(self) -> None:
        """Raise the collected mistakes as one ParameterError, if there are any."""
        found = tuple(dict.fromkeys(self.found))
        if len(found) == 1:
            raise ParameterError(found[0])
        if found:
            listing = "\n".join(f"({k}) {text}" for k, text in enumerate(found, 1))
            raise ParameterError(f"{self.origin} has {len(found)} mistakes:\n{listing}", found)
