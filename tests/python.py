"""Programs that run in an interpreter of their own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def run_python(
    program: str, *words: str, cwd: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a program as a user would, and return what it printed and its exit status."""
    command = [sys.executable, "-c", program, *words]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)
