"""How well diagnoses of real records predict: `python -m benchmarks.real FOLDER --cases FILE.py`.

FOLDER holds records (NPZ, with their TOML) and joint files; FILE.py defines `CASES`, a mapping of
names to (records to fit, records to validate on, what is known of the cause). Prints for each case
the table of horizons beside datasheet and least squares, the named effects, and what is known.

FILE.py may also define `KNOWN`, a mapping of names to {"must": [[effect, ...], ...], "must_not":
[effect, ...]}: of each group under "must", which are alternatives, one has to be named. How many
are is then counted, over groups and over cases of which at least one is, and of how many the
examination says that the record cannot tell them.
"""

from __future__ import annotations

import argparse
import runpy
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.errors import CjtGymError
from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.records import read_record

COUNTED = (0.1, 0.5)
"""Horizons over which the geometric means are taken [s]."""


@dataclass
class Causes:
    """Counts of the known causes that were named.

    Attributes:
        groups: Of each group of alternatives, whether one was named.
        open: Number of the others that the examination excludes.
        cases: Of each case with a known cause, whether one of its causes was.
        confirmed: Number of confirmed names.
        wrong: Names that must not be there: case, name and status.
    """

    groups: list[bool] = field(default_factory=list)
    open: int = 0
    cases: list[bool] = field(default_factory=list)
    confirmed: int = 0
    wrong: list[str] = field(default_factory=list)

    def count(self, name: str, found: Diagnosis, known: Mapping[str, Sequence[Any]]) -> str:
        """Count a case, and return which of its causes were missed, as text."""
        named, unwanted = {e.name for e in found.effects}, known.get("must_not", ())
        hits = [not named.isdisjoint(group) for group in known.get("must", ())]
        self.groups += hits
        self.cases += [any(hits)] if hits else []
        self.confirmed += sum(e.status == "confirmed" for e in found.effects)
        wrong = [e for e in found.effects if e.name in unwanted]
        self.wrong += [f"{name}: {e.name} ({e.status})" for e in wrong]
        exam = found.examination
        excluded = {row.name for row in exam.cannot_tell} if exam is not None else set()
        pairs = zip(known.get("must", ()), hits, strict=True)
        missed = [group for group, hit in pairs if not hit]
        told = [excluded.issuperset(group) for group in missed]
        self.open += sum(told)
        lines = (
            f"{' or '.join(group)}{' (cannot be told, says the examination)' if is_told else ''}"
            for group, is_told in zip(missed, told, strict=True)
        )
        return f"  missed: {', '.join(lines) or 'none'}"

    def __str__(self) -> str:
        named, cases = (f"{sum(x)} of {len(x)}" for x in (self.groups, self.cases))
        return (
            f"causes named: {named}, {self.open} more cannot be told; cases with one of theirs: "
            f"{cases}; confirmed names: {self.confirmed}; "
            f"named wrongly: {', '.join(self.wrong) or 'none'}"
        )


def one(folder: Path, fit: Sequence[str], validate: Sequence[str]) -> Diagnosis:
    """Return the diagnosis of a case."""
    fitted, held = (
        [read_record(folder / f"{n}.npz", allow_nan=True) for n in names]
        for names in (fit, validate)
    )
    return diagnose(fitted, validate=held)


def told(name: str, found: Diagnosis, known: str, seconds: float) -> str:
    """Return a case as text."""
    lines = [f"{name}: {found.verdict}, {seconds:.1f} s"]
    for row in found.horizons:
        cells = (row.datasheet, row.least_squares, row.found, row.floor)
        numbers = "".join(f"{'-' if x is None else format(x, '.3f'):>10}" for x in cells)
        lines.append(f"  {row.channel:<4}{row.seconds:>6.2f} s{numbers}")
    effects = ", ".join(f"{e.name} ({e.status})" for e in found.effects) or "none"
    return "\n".join([*lines, f"  named: {effects}", f"  known: {known}"])


def main(words: Sequence[str] | None = None) -> None:
    """Diagnose every case of a folder and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=Path, required=True, metavar="FILE.py")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    options = parser.parse_args(words)
    given = runpy.run_path(str(options.cases))
    cases, causes = given["CASES"], Causes()
    counted: dict[str, list[float]] = {"datasheet": [], "least_squares": [], "found": []}
    print("relative error on held-out data: datasheet, least squares, found, floor")
    for name, (fit, validate, known) in cases.items():
        if options.only and name not in options.only:
            continue
        started = time.perf_counter()
        try:
            found = one(options.folder, fit, validate)
        except CjtGymError as error:
            print(f"{name}: {error}")
            continue
        print(told(name, found, known, time.perf_counter() - started), flush=True)
        if name in given.get("KNOWN", {}):
            print(causes.count(name, found, given["KNOWN"][name]), flush=True)
        for row in found.horizons:
            if row.seconds in COUNTED and row.least_squares is not None:
                for column, values in counted.items():
                    values.append(getattr(row, column))
    means = {k: float(np.exp(np.mean(np.log(v)))) for k, v in counted.items() if v}
    print("geometric means at 0.1 and 0.5 s:", {k: round(v, 3) for k, v in means.items()})
    if causes.groups:
        print(causes)


if __name__ == "__main__":
    main(sys.argv[1:])
