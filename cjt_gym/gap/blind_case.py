"""The diagnosing process of a blind test: it is given a folder, and nothing that tells the key."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

FILES = ("nominal.toml", "diagnose.npz", "diagnose.toml", "validate.npz", "validate.toml")
"""All that the folder of a case holds."""


def diagnose_case(folder: Path) -> dict[str, Any]:
    """Return what `diagnose_files` does, of a folder that is known to hold no more than a case.

    Raises:
        ValueError: The folder holds more or less than the files of a case.
    """
    if sorted(path.name for path in folder.iterdir()) != sorted(FILES):
        raise ValueError(f"{folder} must hold {', '.join(FILES)} and nothing else.")
    return diagnose_files(folder)


def diagnose_files(folder: Path) -> dict[str, Any]:
    """Return the content of diagnosis.json for a case, or {"error": text} where there is none.

    Beside it stands `cpu_seconds`, the time of a processor that the diagnosis took.
    """
    from cjt_gym.gap import diagnose
    from cjt_gym.records import read_record

    try:
        record, check = (
            read_record(folder / f"{name}.npz", allow_nan=True) for name in ("diagnose", "validate")
        )
        started = time.process_time()
        result = diagnose(record, validate=check).to_dict()
        return result | {"cpu_seconds": time.process_time() - started}
    except Exception as error:  # whatever goes wrong counts against the diagnosis
        return {"error": f"{type(error).__name__}: {error}"}


def warm_up() -> None:
    """Load and compile what a diagnosis needs, so that the first case is timed like the others."""
    from cjt_gym.gap import diagnose
    from cjt_gym.records import read_record

    diagnose(read_record("emps").slice(0, 2000))
