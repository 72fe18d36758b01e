"""List training runs side by side."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from cjt_gym.errors import ConfigurationError, MissingFileError
from cjt_gym.training.learning.run_folder import MARKER, RunFolder, open_run

COLUMNS = (
    ("run", "run", "{}"),
    ("status", "status", "{}"),
    ("algorithm", "algorithm", "{}"),
    ("joint", "joint", "{}"),
    ("structure", "structure", "{}"),
    ("base", "base", "{}"),
    ("seed", "seed", "{}"),
    ("steps", "steps", "{:,}"),
    ("minutes", "minutes", "{:.1f}"),
    ("best error [N m]", "best_rmse", "{:.3g}"),
    ("at step", "best_steps", "{:,}"),
)


def find_runs(paths: Sequence[str | Path]) -> list[RunFolder]:
    """Return the runs in some folders and below them, by path."""
    found: dict[Path, RunFolder] = {}
    for path in map(Path, paths):
        if not path.is_dir():
            raise MissingFileError(f"The folder {path} does not exist.")
        for run in _runs_below(path):
            found.setdefault(run.path.resolve(), run)
    if not found:
        raise ConfigurationError(
            f"There is no training run in {', '.join(map(str, paths))}. Make one:  "
            "cjt-gym train CONFIG --out runs/NAME"
        )
    return [found[path] for path in sorted(found)]


def _runs_below(path: Path) -> Iterable[RunFolder]:
    for marker in sorted(path.rglob(MARKER)):
        try:
            yield open_run(marker.parent)
        except ConfigurationError:  # a file of that name that belongs to somebody else
            continue


def row_of(run: RunFolder) -> dict[str, Any]:
    """Return what a list shows of a run, as plain data; what is not known yet is None."""
    facts, config = run.facts, run.config
    seconds = facts.get("seconds")
    return {
        "run": str(run.path),
        "status": facts["status"],
        "reason": facts.get("reason"),
        "algorithm": config.algorithm,
        "joint": facts["joint"],
        "structure": facts["structure"],
        "base": config.env.get("base_controller"),
        "seed": facts["seed"],
        "steps": facts["steps"],
        "minutes": None if seconds is None else seconds / 60.0,
        "best_rmse": facts.get("best_validation_rmse"),
        "best_steps": facts.get("best_steps"),
        "differs": None,
    }


def compared(runs: Sequence[RunFolder]) -> list[dict[str, Any]]:
    """Return the rows of runs, the best error first among those on the same joint.

    "differs" lists the options of the configuration in which a run is not as the first.
    """
    rows = [row_of(run) for run in runs]
    first = _flat(runs[0].config.to_dict())
    for run, row in zip(runs, rows, strict=True):
        here = _flat(run.config.to_dict())
        names = sorted(n for n in {*first, *here} if first.get(n) != here.get(n))
        row["differs"] = {name: here.get(name) for name in names}
    return sorted(rows, key=_order)


def _order(row: dict[str, Any]) -> tuple[str, str, float, str]:
    best = row["best_rmse"]
    return row["joint"], row["structure"], math.inf if best is None else best, row["run"]


def _flat(data: Any, path: str = "") -> dict[str, Any]:
    if not isinstance(data, dict) or not data:
        return {path: data if not isinstance(data, tuple) else list(data)}
    found: dict[str, Any] = {}
    for key, value in data.items():
        found |= _flat(value, f"{path}.{key}" if path else str(key))
    return found
