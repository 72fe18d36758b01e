"""What a machine withholds from everybody: a program that does nothing but wake up, and how late.

On each processor one process sleeps a millisecond at a time, with a higher real-time priority than
the loop that is measured where that is permitted. When even it wakes late, no program on that
processor could have been in time: the host of a virtual machine had taken the processor away, or
the kernel did not let go of it.

    python -m tests.canbus.witness CPU PRIORITY
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

NAP = 1e-3
"""Time between two looks [s]."""
LATE = 5e-3
"""Lateness from which a stall is written down [s]."""


@dataclass
class Witnesses:
    """What the witnesses of a run have seen.

    Attributes:
        stalls: Begin and end of every stall on any processor, on the clock of
            `time.perf_counter` [s]; sorted once the witnesses have gone.
    """

    stalls: list[tuple[float, float]] = field(default_factory=list)

    @contextmanager
    def watching(
        self, folder: Path, cpus: Sequence[int], priority: int | None
    ) -> Iterator[list[int]]:
        """Let a witness look on each processor while the code within runs; give their numbers."""
        files = [folder / f"witness_{cpu}" for cpu in cpus]
        processes = []
        for cpu, file in zip(cpus, files, strict=True):
            words = [sys.executable, __file__, str(cpu), str(priority or 0)]
            with file.open("w") as out:
                processes.append(subprocess.Popen(words, stdout=out))
        try:
            _await(files)
            yield [process.pid for process in processes]
        finally:
            for process in processes:
                process.terminate()
                process.wait()
            rows = [line.split() for file in files for line in file.read_text().splitlines()]
            self.stalls += sorted((float(a), float(b)) for a, b in (r for r in rows if len(r) == 2))

    def longest(self, begin: float, end: float) -> float:
        """Return the longest stall that overlaps a time [s]."""
        return max((b - a for a, b in self.stalls if a < end and b > begin), default=0.0)


def _await(files: Sequence[Path]) -> None:
    """Wait until every witness has begun; a busy machine takes seconds to start a process."""
    end = time.perf_counter() + 60.0
    while any(file.stat().st_size == 0 for file in files) and time.perf_counter() < end:
        time.sleep(0.05)


def main(cpu: int, priority: int) -> None:
    """Print begin and end of every stall of a processor, until it is told to stop."""
    os.sched_setaffinity(0, {cpu})
    if priority:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    sys.stdout.write("begun\n")
    sys.stdout.flush()
    parent, last = os.getppid(), time.perf_counter()
    while os.getppid() == parent:  # nobody is left watching for whoever was killed
        time.sleep(NAP)
        now = time.perf_counter()
        if now - last - NAP > LATE:
            sys.stdout.write(f"{last:.6f} {now:.6f}\n")
            sys.stdout.flush()
        last = time.perf_counter()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
