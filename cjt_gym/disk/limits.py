"""Limits on what is read, so that a small file cannot cost all memory or hours."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cjt_gym.errors import CjtGymError, ConfigurationError


@dataclass(frozen=True)
class Limit:
    """How much of something a file may hold.

    Attributes:
        variable: Environment variable that replaces it.
        usual: Its value where that variable is not set.
        unit: What is counted.
        per_byte: How many a byte of the file may stand for; a large file may hold as many, even
            beyond the value.
    """

    variable: str
    usual: int
    unit: str
    per_byte: int = 0

    @property
    def value(self) -> int:
        """The limit as the environment has it."""
        text = os.environ.get(self.variable, "")
        if text and not (text.isascii() and text.isdigit() and len(text) < 19 and int(text) > 0):
            raise ConfigurationError(
                f"The environment variable {self.variable} must be a whole number > 0, got "
                f"{text!r}."
            )
        return int(text or self.usual)

    def check(self, count: int, path: Path, error: type[CjtGymError]) -> None:
        """Raise `error` if a file holds more than it may."""
        if count <= self.value:
            return
        if not self.per_byte or count > self.per_byte * path.stat().st_size:
            raise error(
                f"{path} holds {count} {self.unit}, more than the {self.value} that are read from "
                f"a file{' of its size' if self.per_byte else ''}. If it may cost more memory and "
                f"time, set the environment variable {self.variable} to a larger number."
            )


COLUMNS: Final = Limit("CJT_GYM_MAX_COLUMNS", 4_000, "columns")
NUMBERS: Final = Limit("CJT_GYM_MAX_NUMBERS", 50_000_000, "numbers", per_byte=16)
BYTES_OF_TEXT: Final = Limit("CJT_GYM_MAX_BYTES_OF_TEXT", 8_000_000, "bytes")
