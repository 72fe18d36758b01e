"""`make fuzz`: every reader of a file on many changed files, each in a process of its own.

The first file of every kind of exception that is not ours is kept in FOLDER/READER-K, and one that
ends its process in FOLDER/READER.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.fuzz.apart import fuzz_apart
from tests.fuzz.run import Findings
from tests.fuzz.targets import Parts, targets

Files = Callable[[Parts], dict[str, bytes]]


def main() -> int:
    """Run, print a table, and return 1 where anything was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=float, default=1e6, help="per reader, default 1e6")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", nargs="+", help="default: all")
    parser.add_argument("--out", type=Path, default=Path("fuzz"), metavar="FOLDER")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        readers = targets(Path(folder))
        _tell(f"{'reader':10}{'inputs':>10}{'refused':>10}{'kinds':>7}{'seconds':>9}")
        failed = False
        for name in options.reader or readers:
            begun = time.monotonic()
            place = options.out / name
            found, code = fuzz_apart(name, int(options.inputs), options.seed, place)
            seconds = f"{time.monotonic() - begun:9.0f}"
            ended = f"  ended with status {code} by the file in {place}" if code else ""
            counts = f"{found.inputs:10}{found.refused:10}{len(found.kinds):7}"
            _tell(f"{name:10}{counts}{seconds}{ended}")
            for line in _kept(found, options.out, name, readers[name].files):
                _tell(line)
            failed |= bool(code or found.kinds)
    return int(failed)


def _kept(
    found: Findings, out: Path, name: str, files: Callable[[Parts], dict[str, bytes]]
) -> Iterator[str]:
    """Keep the first file of every kind; yield what to tell of it."""
    for k, (kind, (count, parts)) in enumerate(sorted(found.kinds.items())):
        kept = out / f"{name}-{k}"
        kept.mkdir(parents=True, exist_ok=True)
        for file, data in files(parts).items():
            (kept / file).write_bytes(data)
        yield f"    {count} x {kind}: {kept}"


def _tell(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
