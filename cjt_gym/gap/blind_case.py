"""The diagnosing process of a blind test: it sees a case's folder, but never the key."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

FILES = ("nominal.toml", "diagnose.npz", "diagnose.toml", "validate.npz", "validate.toml")
"""Complete contents of a case's folder."""


def diagnose_case(folder: Path) -> dict[str, Any]:
    """Return the result of `diagnose_files` for a folder verified to hold nothing but a case.

    Raises:
        ValueError: The folder does not hold exactly the files of a case.
    """
    if sorted(path.name for path in folder.iterdir()) != sorted(FILES):
        raise ValueError(f"{folder} must hold {', '.join(FILES)} and nothing else.")
    return diagnose_files(folder)


def diagnose_files(folder: Path) -> dict[str, Any]:
    """Return the content of diagnosis.json for a case, or {"error": text} if the diagnosis failed.

    The result also has `cpu_seconds`, the processor time of the diagnosis.
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
    except Exception as error:  # any failure counts against the diagnosis
        return {"error": f"{type(error).__name__}: {error}"}


def warm_up() -> None:
    """Load and compile everything a diagnosis needs, so the first case is timed like the rest."""
    from cjt_gym.gap import diagnose
    from cjt_gym.records import read_record

    diagnose(read_record("emps").slice(0, 2000))
