"""The decorator of the compiled functions of this package, and their cache on disk.

Numba renews the cache of a function when its own file changes, not when a function that it calls
does. So all cached functions older than the newest source file are deleted on import.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

from numba import njit

jit = njit(cache=True, error_model="numpy")


def drop_old_cache(folder: Path) -> None:
    """Delete the compiled functions of a folder if one of its source files is newer."""
    newest = max(source.stat().st_mtime_ns for source in folder.glob("*.py"))
    cached = list((folder / "__pycache__").glob("*.nb[ic]"))
    with contextlib.suppress(OSError):  # a folder that cannot be written to stays as it is
        if any(entry.stat().st_mtime_ns < newest for entry in cached):
            for entry in cached:
                entry.unlink(missing_ok=True)


drop_old_cache(Path(__file__).parent)
