"""Policies that ship are listed with a card each, and stand wherever a run folder does."""

from __future__ import annotations

import json
import zipfile
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.errors import CjtGymError
from cjt_gym.training.deploy.exported import Exported
from cjt_gym.training.deploy.shipped import load_agent, policy_card, policy_names, policy_path
from cjt_gym.training.evaluation.conditions import realistic_conditions
from cjt_gym.training.evaluation.evaluate import evaluate

LARGEST = 100_000


def test_every_policy_has_a_card_and_is_small() -> None:
    assert policy_names()
    for name in policy_names():
        assert all(text.strip() for text in astuple(policy_card(name)))
        assert policy_path(name).stat().st_size < LARGEST


@pytest.mark.parametrize("name", policy_names())
def test_policy_is_a_whole_controller_without_pickle(name: str) -> None:
    with zipfile.ZipFile(policy_path(name)) as archive:
        for member in archive.namelist():
            with archive.open(member) as file:
                np.lib.format.read_array(file, allow_pickle=False)
    agent = load_agent(name)
    assert isinstance(agent, Exported)
    assert agent.trained_on[0] in policy_card(name).trained_on
    conditions = realistic_conditions(agent.trained_on[0], agent.config.env["structure"])
    (row,) = evaluate(agent, conditions, ["step"], episodes=1).rows
    assert row.nrmse < 0.5


def test_command_lists_them_and_shows_a_card(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["policies"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in policy_names())
    name = policy_names()[0]
    assert main(["policies", name]) == 0
    out = capsys.readouterr().out
    assert all(title in out for title in ("trained on:", "tested on:", "fails:"))
    assert main(["policies", "--json"]) == 0
    assert [row["name"] for row in json.loads(capsys.readouterr().out)] == policy_names()
    assert main(["policies", name + "x"]) == 2
    assert f"Did you mean '{name}'" in capsys.readouterr().err


@pytest.mark.slow
def test_benchmark_takes_a_policy_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = policy_names()[0]
    words = ["benchmark", "--joint", "orange_80_6000", "--policy", name, "--task", "step"]
    assert main([*words, "--episodes", "2", "--out", str(tmp_path / "out"), "--json"]) == 0
    told = capsys.readouterr()
    (row,) = json.loads(told.out)
    assert row["controller"] == name
    assert "was trained on" not in told.err
    words[2] = "lemon_50_6000"
    assert main([*words, "--episodes", "2", "--out", str(tmp_path / "out"), "--json"]) == 0
    assert f"{name} was trained on orange_80_6000" in capsys.readouterr().err


def test_a_folder_comes_before_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    name = policy_names()[0]
    (tmp_path / name).mkdir()
    assert policy_path(name) == Path(name)
    assert policy_path("runs/gone") == Path("runs/gone")
    with pytest.raises(CjtGymError, match="Unknown policy"):
        policy_path("gone")
