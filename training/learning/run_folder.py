"""The folder of a training run: what it holds, how it is begun, continued and read."""

from __future__ import annotations

import csv
import json
import math
import platform
import shutil
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from cjt_gym.disk import lock, parsing, read_json, to_toml, write_text
from cjt_gym.errors import CjtGymError, ConfigurationError, MissingFileError
from cjt_gym.joint import Joint, load_joint_file
from cjt_gym.joint.configure import plain_effects
from cjt_gym.plant.randomization import resolve_randomization
from cjt_gym.training.learning.config import (
    BASE_GAINS,
    VALIDATION_SEEDS,
    TrainConfig,
    base_of,
    environment_arguments,
    load_config,
)

SCHEMA = 1
LOCK = ".lock"
MARKER = "run.json"
KIND = "cjt_gym training run"
PACKAGES = ("cjt-gym", "numpy", "numba", "gymnasium", "stable-baselines3", "torch")
CHECKPOINTS_KEPT = 2  # one is whole while the next is written
FACTS: dict[str, Any] = {
    "status": str,
    "joint": str,
    "structure": str,
    "steps": int,
    "seed": int,
    "seconds": (int, float),
    "best_validation_rmse": (int, float),
    "best_steps": int,
    "reason": str,
    "begun_times": int,
}
"""Types of those facts that are read again."""
OPTIONAL = ("seconds", "best_validation_rmse", "best_steps", "reason", "begun_times")
WORDS: dict[Any, str] = {str: "a text", int: "a whole number", (int, float): "a number"}
PROGRESS = ("steps", "seconds", "rmse", "return", "validation_rmse")


class TrainingError(CjtGymError, RuntimeError):
    """A training stopped because of what it computed, such as a loss that is not a number."""


@dataclass(frozen=True)
class RunFolder:
    """A folder made by cjt-gym.

    It holds `config.toml` (with the gains of a gain file spelt out, and `joint.toml` beside it if
    the joint came from a file), `randomization.toml`
    (every variation of the joint, fully spelt out, as [env.randomization] takes it), `run.json`
    (status, seeds, versions, git revision, parameter hash), `model.zip` (the model that was best in
    validation), `normalization.npz` where observations or rewards were normalised, `progress.csv`,
    `tensorboard/` and `checkpoints/`.
    """

    path: Path

    @property
    def config(self) -> TrainConfig:
        """The configuration of the run."""
        return load_config(self.path / "config.toml")

    @property
    def facts(self) -> dict[str, Any]:
        """What `run.json` says."""
        path = self.path / MARKER
        facts = read_json(path, ConfigurationError)
        if not isinstance(facts, dict):
            raise ConfigurationError(f"{path} must hold a table of facts, got {facts!r:.100}.")
        for name, kind in FACTS.items():
            value = facts.get(name)
            missing = value is None and name in OPTIONAL
            if not missing and (isinstance(value, bool) or not isinstance(value, kind)):
                raise ConfigurationError(
                    f"{name} of {path} must be {WORDS[kind]}, got {value!r:.100}."
                )
        return facts

    def note(self, **facts: Any) -> None:
        """Add facts to `run.json`."""
        write_text(self.path / MARKER, json.dumps({**self.facts, **facts}, indent=2) + "\n")

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other processes from training in this folder.

        The lock is that of the operating system, which takes it back from a process that ends,
        however it ends.
        """
        with (self.path / LOCK).open("a", encoding="utf-8") as file:
            try:
                lock(file.fileno())
            except OSError:
                raise ConfigurationError(
                    f"Another process is training in {self.path}. Wait for it, or choose another "
                    "folder."
                ) from None
            yield

    def checkpoints(self) -> list[Path]:
        """Return the complete checkpoints, oldest first."""
        return sorted((self.path / "checkpoints").glob("step_*"))

    def drop_old_checkpoints(self) -> None:
        """Keep the last few checkpoints."""
        for old in self.checkpoints()[:-CHECKPOINTS_KEPT]:
            shutil.rmtree(old)

    def progress(self) -> list[dict[str, float]]:
        """Return the rows of `progress.csv`; what a row lacks is NaN.

        A row without a readable number of steps, such as one that a full disk cut off, is left out.
        """
        path = self.path / "progress.csv"
        if not path.is_file():
            return []
        with (
            parsing(f"{path} must be a table of numbers", ConfigurationError),
            path.open(encoding="utf-8", newline="", errors="replace") as file,
        ):
            rows = [{k: _number(row.get(k)) for k in PROGRESS} for row in csv.DictReader(file)]
        return [row for row in rows if math.isfinite(row["steps"])]

    def add_progress(self, row: Mapping[str, float]) -> None:
        """Append a row to `progress.csv`."""
        path = self.path / "progress.csv"
        new = not path.is_file()
        with path.open("a", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, PROGRESS, restval="")
            if new:
                writer.writeheader()
            writer.writerow({k: f"{v:.8g}" for k, v in row.items()})

    def forget_progress_after(self, steps: int) -> None:
        """Drop the rows of what a continued run will do again."""
        kept = [row for row in self.progress() if row["steps"] <= steps]
        (self.path / "progress.csv").unlink(missing_ok=True)
        for row in kept:
            self.add_progress({k: v for k, v in row.items() if v == v})


def open_run(path: str | Path) -> RunFolder:
    """Return the run in a folder."""
    folder = Path(path)
    if folder.is_file():
        raise ConfigurationError(
            f"A policy must be a run folder, or a file exported with --to numpy (.npz), got {path}."
        )
    if not folder.is_dir():
        raise MissingFileError(
            f"The run folder {path} does not exist. Make one:  cjt-gym train CONFIG --out {path}"
        )
    if not _is_ours(folder):
        raise ConfigurationError(
            f"{path} is not a run folder of cjt-gym (its {MARKER} is missing or not ours)."
        )
    return RunFolder(folder)


def begin_run(path: str | Path, config: TrainConfig, joint: Joint) -> RunFolder:
    """Return the run folder for a configuration: a new one, or the one that is there already."""
    folder = Path(path)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        if not folder.is_dir() or not _is_ours(folder):
            raise ConfigurationError(
                f"{path} exists and is not a run folder of cjt-gym. Choose another folder."
            )
        run = RunFolder(folder)
        _check_same(run, config)
        return run
    (folder / "checkpoints").mkdir(parents=True, exist_ok=True)
    name, written = config.env.get("joint", ""), config.to_dict()
    written["env"] = _without_gain_file(written["env"])
    if str(name).endswith(".toml"):
        shutil.copyfile(str(name), folder / "joint.toml")
        written["env"]["joint"] = "joint.toml"
    write_text(folder / "config.toml", to_toml(written))
    write_text(folder / "randomization.toml", to_toml(resolved_randomization(config, joint)))
    write_text(folder / MARKER, json.dumps(_facts(config, joint), indent=2) + "\n")
    return RunFolder(folder)


def _without_gain_file(env: Mapping[str, Any]) -> dict[str, Any]:
    """Return a section [env] in which the gains of a gain file stand themselves."""
    base = base_of(env)
    if base is None or not base.gains:
        return dict(env)
    return {**env, "base_controller": base.controller, BASE_GAINS: dict(base.gains)}


def resolved_randomization(config: TrainConfig, joint: Joint) -> dict[str, dict[str, Any]]:
    """Return what varies in a training, by name, with all that a preset leaves unsaid."""
    arguments = environment_arguments(config.env)
    spec, dt = arguments["randomization"], arguments["dt_control"]
    return {name: v.to_dict() for name, v in resolve_randomization(joint, spec, dt).items()}


def _facts(config: TrainConfig, joint: Joint) -> dict[str, Any]:
    return {
        "kind": KIND,
        "schema": SCHEMA,
        "status": "running",
        "steps": 0,
        "begun": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "begun_times": 0,
        "seed": config.seed,
        "environment_seeds": "seed + num_envs * (times begun - 1) + index of the environment",
        "validation_seeds": VALIDATION_SEEDS,
        "joint": joint.parameters.name,
        "structure": joint.structure,
        "drive": joint.drive,
        "effects": plain_effects(joint.effects),
        "parameter_hash": joint.file.hash_hex(),
        "versions": versions(),
        "git_revision": git_revision(),
    }


def versions() -> dict[str, str]:
    """Return the versions of what a run depends on."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def git_revision() -> str | None:
    """Return the revision of the git tree that holds this package, with "+" if it was changed."""
    here = Path(__file__).resolve().parent
    try:
        revision = _git(here, "rev-parse", "HEAD").strip()
        changed = _git(here, "status", "--porcelain", "--untracked-files=no").strip()
    except (OSError, subprocess.SubprocessError):
        return None
    return revision + ("+" if changed else "")


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout


def _number(text: object) -> float:
    try:
        return float(str(text or "nan"))
    except ValueError:
        return math.nan


def _is_ours(folder: Path) -> bool:
    try:
        facts = read_json(folder / MARKER, ConfigurationError)
    except (OSError, ConfigurationError):
        return False
    return isinstance(facts, dict) and facts.get("kind") == KIND


def _check_same(run: RunFolder, config: TrainConfig) -> None:
    there, here = _comparable(run.config), _comparable(config)
    different = [key for key in here if here[key] != there.get(key)]
    if different:
        raise ConfigurationError(
            f"{run.path} holds a run of another configuration (it differs in "
            f"{', '.join(different)}). Choose another folder, or delete this one."
        )


def _comparable(config: TrainConfig) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(json.dumps(config.to_dict()))
    data["env"] = _without_gain_file(data["env"])
    if str(data["env"].get("joint", "")).endswith(".toml"):
        data["env"]["joint"] = load_joint_file(Path(data["env"]["joint"])).hash_hex()
    return data
