"""A reader in a process of its own, which a file may end."""

from __future__ import annotations

import multiprocessing
import tempfile
from pathlib import Path
from typing import Any

from tests.fuzz.run import Findings, fuzz
from tests.fuzz.targets import targets


def fuzz_apart(name: str, inputs: int, seed: int, folder: Path) -> tuple[Findings, int]:
    """Fuzz a reader; return what was found, and the status of the process if a file ended it.

    That file then lies in the folder.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(name, inputs, seed, folder, theirs))
    process.start()
    theirs.close()
    try:
        found: Findings = ours.recv()
    except EOFError:
        found = Findings()
    process.join()
    return found, process.exitcode or 0


def _work(name: str, inputs: int, seed: int, folder: Path, pipe: Any) -> None:
    with tempfile.TemporaryDirectory() as seeds:
        pipe.send(fuzz(targets(Path(seeds))[name], folder, inputs, seed))
