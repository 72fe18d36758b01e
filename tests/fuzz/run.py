"""Run a reader on many changed files, and keep what is neither an answer nor an error of ours."""

from __future__ import annotations

import logging
import random
import re
import shutil
import signal
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cjt_gym.errors import CjtGymError
from tests.fuzz.mutate import mutated
from tests.fuzz.targets import Parts, Target

PATIENCE = 5
"""Time of the processor that a file of a few kilobytes may take [s]."""
KEPT = 300
"""Inputs with outcomes of their own that are changed further."""


class TooLongError(BaseException):
    """A file took too long to read; no handler of exceptions catches this."""


@dataclass
class Findings:
    """What came of a run.

    Attributes:
        inputs: How many.
        refused: How many of them were refused with an error of ours.
        kinds: Of other outcomes, by what and where: how often, and the first such input.
    """

    inputs: int = 0
    refused: int = 0
    kinds: dict[str, tuple[int, Parts]] = field(default_factory=dict)

    def add(self, kind: str, parts: Parts) -> None:
        """Count an outcome that should not be."""
        count, first = self.kinds.get(kind, (0, parts))
        self.kinds[kind] = (count + 1, first)


def fuzz(target: Target, folder: Path, inputs: int, seed: int) -> Findings:
    """Read so many files; what leads to an outcome that is new is changed further.

    Args:
        target: The reader.
        folder: Where files are written.
        inputs: How many.
        seed: Of the changes.
    """
    rng, found, outcomes = random.Random(seed), Findings(), set()
    corpus: list[Parts] = list(target.seeds)
    logging.disable()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for k in range(inputs):
            parts = target.seeds[k] if k < len(target.seeds) else mutated(rng, rng.choice(corpus))
            outcome = tried(target, folder, parts, found)
            if outcome not in outcomes and len(corpus) < KEPT:
                outcomes.add(outcome)
                corpus.append(parts)
    logging.disable(logging.NOTSET)
    return found


def tried(target: Target, folder: Path, parts: Parts, found: Findings) -> str:
    """Read a file; return what came of it, without what differs from file to file."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, data in target.files(parts).items():
        (folder / name).write_bytes(data)
    found.inputs += 1
    try:
        with _limited():
            target.run(folder)
    except CjtGymError as error:
        found.refused += 1
        return re.sub(r"\d+|'[^']*'", "", str(error))[:120]
    except (Exception, TooLongError) as error:
        kind = _kind(error)
        found.add(kind, parts)
        return kind
    return "read"


def _kind(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    foreign = ("site-packages", "/lib/python")
    ours = [f for f in frames if not any(part in f.filename for part in foreign)]
    place = ours[-1] if ours else frames[-1]
    where = f"{Path(place.filename).name}:{place.lineno}"
    return f"{type(error).__name__} at {where} ({str(error)[:80]})"


@contextmanager
def _limited() -> Iterator[None]:
    def stop(number: int, frame: Any) -> None:
        raise TooLongError(f"more than {PATIENCE} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
