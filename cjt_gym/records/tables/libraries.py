"""Libraries that only some formats need, imported when such a file is met."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from cjt_gym.errors import RecordError

PACKAGES = {"can": "python-can", "mcap_ros2": "mcap-ros2-support"}
"""What to install for a module of another name."""


def library(name: str, path: Path, extra: str, otherwise: str = "") -> Any:
    """Return a module that a file needs; the error names what to install, and what else to do."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        top = name.partition(".")[0]
        raise RecordError(
            f"{path} needs {PACKAGES.get(top, top)}, which is not installed: pip install "
            f"cjt-gym[{extra}].{otherwise}"
        ) from error
