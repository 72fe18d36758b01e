"""What results come from, as one hash: code, shipped gains, versions."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import lru_cache
from importlib import resources
from importlib.metadata import version
from importlib.resources.abc import Traversable

COUNTED = ("analysis", "baselines", "envs", "joint", "params", "plant", "signals", "training")
"""Parts of the package that results come from; gains that ship are in them."""
LIBRARIES = ("numba", "numpy", "scipy")


@lru_cache
def code_hash(parts: tuple[str, ...] = COUNTED) -> str:
    """Return the SHA-256 over the code and the gains that results come from, in hexadecimal."""
    digest = hashlib.sha256()
    for name in ("cjt-gym", *LIBRARIES):
        digest.update(f"{name} {version(name)}\n".encode())
    for part in parts:
        for path, content in sorted(sources(resources.files(f"cjt_gym.{part}"), part)):
            digest.update(f"{path}\n".encode() + content)
    return digest.hexdigest()


def sources(folder: Traversable, name: str) -> Iterator[tuple[str, bytes]]:
    """Give the files of a folder that results come from.

    Yields:
        Path and content.
    """
    for entry in folder.iterdir():
        path = f"{name}/{entry.name}"
        if entry.is_dir():
            yield from sources(entry, path)
        elif path.endswith((".py", ".toml")):
            yield path, entry.read_bytes()
