"""`cjt-gym blind-test`: the diagnosis on joints with hidden effects.

One process draws the cases and keeps the keys; others, which are handed a copy of a case's files
and nothing else, diagnose them; then keys and diagnoses are laid side by side.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cjt_gym.blind import draw_case, write_case
from cjt_gym.blind.mix import BLOCKS, Recipe, recipe
from cjt_gym.blind.plant import STRUCTURES
from cjt_gym.blind.score import score_case, summarise
from cjt_gym.blind.table import table
from cjt_gym.console import Answer
from cjt_gym.disk import read_json, write_text
from cjt_gym.errors import ConfigurationError, check_name, check_range, unknown_name
from cjt_gym.gap.blind_case import diagnose_case, warm_up

SETTINGS = ("seed", "structure", "strength", "duration", "logs")
"""Options that a test keeps when it is resumed."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add how many cases, of what kind, and where to write them."""
    add = parser.add_argument
    add("--cases", type=int, required=True, metavar="N", help="number of joints to draw")
    text = "folder; an interrupted test is resumed"
    add("--out", type=Path, required=True, metavar="DIR", help=text)
    add("--seed", type=int, default=0, help="seed of all joints, default 0")
    text = f"structure of all joints; default: mixed. One of {', '.join(STRUCTURES)}"
    add("--structure", help=text)
    text = "scale factor for all effects, such as 0.1; default 1"
    add("--strength", type=float, default=1.0, help=text)
    add("--duration", type=float, default=10.0, help="duration of each record [s], default 10")
    add(
        "--logs",
        default="clean",
        help="clean (default), rough as real ones are, or bare: with as short a datasheet as most",
    )
    add("--workers", type=int, default=2, help="processes, default 2")


def run(options: argparse.Namespace) -> Answer:
    """Draw, diagnose, score; write `blind_test.json`, `cases.csv` and `report.html`."""
    from cjt_gym.console.blind_report import write_csv, write_report  # loads matplotlib

    _check(options)
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    settings = {key: getattr(options, key) for key in SETTINGS}
    _settle(settings, out / "settings.json")
    names = {f"case_{k:03d}": k for k in range(options.cases)}
    _draw(names, settings, out, options.workers)
    _diagnose(names, out, options.workers)
    rows = [
        score_case(name, _read(_label(out, name)), _read(_diagnosis(out, name))) for name in names
    ]
    summary = summarise(rows)
    result = {"settings": settings, "summary": summary, "cases": rows}
    _write(out / "blind_test.json", result)
    write_csv(rows, out / "cases.csv")
    write_report(result, out / "report.html")
    return result, table(summary)


def _check(options: argparse.Namespace) -> None:
    for name, low in (("cases", 1), ("workers", 1), ("seed", 0), ("duration", 2.0)):
        check_range(f"--{name}", getattr(options, name), low=low)
    check_range("--strength", options.strength, low=0.0, high=3.0)
    if options.structure is not None and options.structure not in STRUCTURES:
        raise unknown_name("structure", options.structure, STRUCTURES)
    check_name("kind of logs", options.logs, BLOCKS)


def _settle(settings: dict[str, Any], path: Path) -> None:
    """Keep the settings of a test beside it; a resumed test must have the same."""
    if path.is_file() and (other := {"logs": "clean"} | _read(path)) != settings:
        raise ConfigurationError(
            f"{path.parent} holds a blind test with other settings, {other}, not {settings}. "
            "Give another --out."
        )
    _write(path, settings)


def _label(out: Path, name: str) -> Path:
    return out / "labels" / f"{name}.json"


def _diagnosis(out: Path, name: str) -> Path:
    return out / "diagnoses" / f"{name}.json"


def _draw(names: dict[str, int], settings: dict[str, Any], out: Path, workers: int) -> None:
    """Draw the cases that are not there yet."""
    made = settings["structure"], settings["logs"]
    jobs = {
        name: (recipe(settings["seed"], k, *made), settings["strength"], settings["duration"], out)
        for name, k in names.items()
        if not _label(out, name).is_file()
    }
    for name, _ in _each(draw_one, {n: (n, *job) for n, job in jobs.items()}, workers):
        sys.stderr.write(f"{name} drawn\n")


def draw_one(name: str, made: Recipe, strength: float, duration: float, out: Path) -> None:
    """Draw one case: its files in OUT/cases, its key, last, in OUT/labels."""
    case = draw_case(
        made.seed,
        effects=made.effects,
        structure=made.structure,
        strength=strength,
        duration=duration,
        defects=made.defects,
    )
    write_case(case, out / "cases" / name)
    _write(_label(out, name), case.label)


def _diagnose(names: Iterable[str], out: Path, workers: int) -> None:
    """Diagnose the cases that are not diagnosed yet, or could not be."""
    missing = [
        name
        for name in names
        if not _diagnosis(out, name).is_file() or "error" in _read(_diagnosis(out, name))
    ]
    with tempfile.TemporaryDirectory(prefix="case-") as place:
        copies = {
            name: (Path(shutil.copytree(out / "cases" / name, Path(place) / name)),)
            for name in missing
        }
        for name, result in _each(diagnose_case, copies, workers, warm_up):
            _write(_diagnosis(out, name), result)
            said = result.get("error") or f"{result['verdict']}, {result['seconds']:.1f} s"
            sys.stderr.write(f"{name} diagnosed: {said}\n")


def _each(
    work: Callable[..., Any],
    jobs: dict[str, tuple[Any, ...]],
    workers: int,
    prepare: Callable[[], None] | None = None,
) -> Iterable[tuple[str, Any]]:
    """Yield name and result of each job, as they end, from fresh processes."""
    if not jobs:
        return
    count = min(workers, len(jobs))
    with ProcessPoolExecutor(count, get_context("spawn"), prepare) as pool:
        running = {pool.submit(work, *arguments): name for name, arguments in jobs.items()}
        for future in as_completed(running):
            yield running[future], future.result()


def _read(path: Path) -> Any:
    return read_json(path, ConfigurationError)


def _write(path: Path, content: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
