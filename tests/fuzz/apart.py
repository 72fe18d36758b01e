"""A reader in a process of its own, which a file may end."""

from __future__ import annotations

import multiprocessing
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import can.io.player

from tests.fuzz.run import Findings, fuzz
from tests.fuzz.targets import targets

INPUT = "input"
MEMORY = Path("/dev/shm")
"""Folder in memory, where there is one: files in it cost no disk."""


def fuzz_apart(name: str, inputs: int, seed: int, folder: Path) -> tuple[Findings, int]:
    """Fuzz a reader; return what was found, and the status of the process if a file ended it.

    That file then lies in the folder.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as room:
        process = context.Process(target=_work, args=(name, inputs, seed, Path(room), theirs))
        process.start()
        theirs.close()
        try:
            found: Findings = ours.recv()
        except EOFError:
            found = Findings()
        process.join()
        if process.exitcode:
            shutil.copytree(Path(room) / INPUT, folder, dirs_exist_ok=True)
    return found, process.exitcode or 0


def _work(name: str, inputs: int, seed: int, room: Path, pipe: Any) -> None:
    # python-can looks for plugins among all installed packages whenever it opens a trace
    can.io.player.read_entry_points = cache(can.io.player.read_entry_points)
    pipe.send(fuzz(targets(room / "seeds")[name], room / INPUT, inputs, seed))
