"""What commands share: options, signs of life, ends, tables."""

from __future__ import annotations

from typing import Any

Answer = tuple[Any, str]
"""What a command answers: plain data, which `--json` prints, and the same in words."""
