"""Run folders that a kill, a full disk or a second process left in disorder."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.errors import CjtGymError, ConfigurationError
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.run_folder import RunFolder, open_run
from cjt_gym.training.learning.runs import row_of
from cjt_gym.training.learning.train import train


def halved(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def swapped(path: Path) -> None:
    with np.load(path) as arrays:
        np.savez(path, **{name: np.zeros(3) for name in arrays.files})  # type: ignore[arg-type]


DAMAGES: dict[str, Callable[[Path], None]] = {
    "half a model": lambda folder: halved(folder / "model.zip"),
    "an empty model": lambda folder: (folder / "model.zip").write_bytes(b"") and None,
    "no model": lambda folder: (folder / "model.zip").unlink(),
    "half a state": lambda folder: halved(folder / "state.json"),
    "half of the statistics": lambda folder: halved(folder / "normalization.npz"),
    "other statistics": lambda folder: swapped(folder / "normalization.npz"),
}


@pytest.fixture
def stopped(finished: RunFolder, tmp_path: Path) -> RunFolder:
    run = RunFolder(Path(shutil.copytree(finished.path, tmp_path / "run")))
    run.note(status="running")
    return run


@pytest.mark.parametrize("damage", DAMAGES)
def test_the_checkpoint_before_is_tried(
    damage: str, stopped: RunFolder, tiny: TrainConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    older, newer = stopped.checkpoints()
    DAMAGES[damage](newer)
    assert train(tiny, stopped.path).facts["status"] == "finished"
    said = capsys.readouterr().err
    assert "Trying the checkpoint before it." in said
    assert str(newer) in said
    assert f"from step {int(older.name.split('_')[1])}" in said


def test_no_checkpoint_that_can_be_read_is_an_error(stopped: RunFolder, tiny: TrainConfig) -> None:
    for checkpoint in stopped.checkpoints():
        halved(checkpoint / "model.zip")
    with pytest.raises(ConfigurationError, match=r"No checkpoint of .* Delete the folder"):
        train(tiny, stopped.path, quiet=True)


@pytest.mark.parametrize("file", ["model.zip", "normalization.npz"])
def test_a_damaged_model_is_an_error_of_ours(file: str, stopped: RunFolder) -> None:
    halved(stopped.path / file)
    with pytest.raises(CjtGymError, match=file):
        load_policy(stopped.path)


def test_a_second_process_in_a_run_folder_is_refused(stopped: RunFolder, tiny: TrainConfig) -> None:
    hold = "import sys; from cjt_gym.disk import lock; file = open(sys.argv[1], 'a')\n"
    hold += "lock(file.fileno()); print('held', flush=True); sys.stdin.read()"
    words = [sys.executable, "-c", hold, str(stopped.path / ".lock")]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        before = stopped.facts
        with pytest.raises(ConfigurationError, match="Another process is training in"):
            train(tiny, stopped.path, quiet=True)
        assert stopped.facts == before
        other.communicate(b"")
    assert train(tiny, stopped.path, quiet=True).facts["status"] == "finished"


@pytest.mark.parametrize(
    ("name", "value"),
    [("status", 1), ("steps", "x"), ("joint", None), ("seed", True)],
)
def test_facts_of_another_type_are_an_error(name: str, value: object, stopped: RunFolder) -> None:
    facts = {**stopped.facts, name: value}
    (stopped.path / "run.json").write_text(json.dumps(facts))
    with pytest.raises(ConfigurationError, match=f"{name} of .*run.json must be"):
        row_of(open_run(stopped.path))


def test_a_row_that_was_cut_off_is_left_out(stopped: RunFolder) -> None:
    whole = stopped.progress()
    path = stopped.path / "progress.csv"
    path.write_bytes(path.read_bytes() + b"\xb5,1.2.3,\n")
    assert len(stopped.progress()) == len(whole) > 0
