"""Torch works on one thread where it is faster so, unless somebody chose otherwise."""

from __future__ import annotations

import pytest
import torch

from cjt_gym.envs import sb3
from cjt_gym.training.learning.algorithms import make_environment
from cjt_gym.training.learning.config import TrainConfig


@pytest.fixture
def several(monkeypatch: pytest.MonkeyPatch) -> None:
    """Begin as torch does on a machine with several cores."""
    counts = [4]
    monkeypatch.setattr(torch, "get_num_threads", lambda: counts[-1])
    monkeypatch.setattr(torch, "set_num_threads", counts.append)
    monkeypatch.setattr(sb3, "_seen", [])
    for name in sb3.CHOSEN:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("several")
def test_the_first_batch_sets_one_thread_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    sb3.TorqueTrackingVecEnv(2)
    assert torch.get_num_threads() == 1
    assert "torch now uses one thread" in capsys.readouterr().err
    torch.set_num_threads(3)
    sb3.TorqueTrackingVecEnv(2)
    assert torch.get_num_threads() == 3
    assert not capsys.readouterr().err


@pytest.mark.usefixtures("several")
def test_a_number_of_the_environment_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "4")
    sb3.TorqueTrackingVecEnv(2)
    assert torch.get_num_threads() == 4


@pytest.mark.usefixtures("several")
def test_a_configuration_chooses_without_a_word(
    tiny: TrainConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    make_environment(tiny)
    assert torch.get_num_threads() == tiny.threads
    assert not capsys.readouterr().err
