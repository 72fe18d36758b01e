"""C at work in this process, compiled by the compiler of this machine."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from cjt_gym.errors import ConfigurationError

COMPILERS = ("cc", "gcc", "clang")
# Contracted products would round otherwise than NumPy does.
OPTIONS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "-ffp-contract=off", "-fPIC")


def compiler() -> str | None:
    """Return the C compiler of this machine, None where there is none."""
    return next((name for name in COMPILERS if shutil.which(name)), None)


def compiled(source: str, headers: Mapping[str, str]) -> ctypes.CDLL:
    """Return the library of a C source and its headers, by file name."""
    name = compiler()
    if name is None:
        raise ConfigurationError(f"There is no C compiler ({', '.join(COMPILERS)}) to try it with.")
    with tempfile.TemporaryDirectory() as place:  # a library that is loaded needs no file
        folder = Path(place)
        for file, text in {**headers, "source.c": source}.items():
            (folder / file).write_text(text, encoding="utf-8")
        library, source_file = str(folder / "library.so"), str(folder / "source.c")
        words = [name, *OPTIONS, "-shared", "-o", library, source_file, "-lm"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ConfigurationError(f"{name} does not take the header: {done.stderr}")
        return ctypes.CDLL(library)
