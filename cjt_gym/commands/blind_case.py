"""The diagnosing process of a blind test: it is given a folder, and nothing that tells the key."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

FILES = ("nominal.toml", "diagnose.npz", "diagnose.toml", "validate.npz", "validate.toml")
"""All that the folder of a case holds."""


def diagnose_case(folder: Path) -> dict[str, Any]:
    """Return the content of diagnosis.json for a case, or {"error": text} where there is none.

    Raises:
        ValueError: The folder holds more or less than the files of a case.
    """
    from cjt_gym.gap import diagnose
    from cjt_gym.records import read_record

    if sorted(path.name for path in folder.iterdir()) != sorted(FILES):
        raise ValueError(f"{folder} must hold {', '.join(FILES)} and nothing else.")
    try:
        record = read_record(folder / "diagnose.npz")
        check = read_record(folder / "validate.npz")
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
