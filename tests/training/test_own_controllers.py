"""Controllers of one's own, in every command by PATH.py:NAME, and imported only where named so."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from cjt_gym import load_joint
from cjt_gym.baselines import Controller, PdFeedForward, make_controller
from cjt_gym.baselines.compose import is_composed
from cjt_gym.baselines.gains import choose
from cjt_gym.cli import main
from cjt_gym.errors import CjtGymError, ConfigurationError, MissingFileError, UnknownNameError
from cjt_gym.training.benchmark.grid import Cell
from cjt_gym.training.learning.config import environment_arguments

JOINT = "orange_80_6000"
LAW = '''
from pathlib import Path
from cjt_gym.baselines import Gain, PdFeedForward
from cjt_gym.baselines.pd import ROW

with Path(__file__).with_name("imported").open("a") as file:
    file.write("x")

class Mine:
    """P with feed-forward."""
    tunable = (Gain("kp", "-", 0.0, 1.0, usual=0.25),)

    def __init__(self, joint, dt, kp):
        self.kp, self.resets = kp, []

    def reset(self, mask=None):
        self.resets.append(mask)

    def act(self, measurement, reference):
        return reference + self.kp * (reference - measurement.tau)

def ready(joint, dt):
    return PdFeedForward(0.25, 0.0, dt)

class Fixed:
    tunable = (Gain("kp", "-", 0.0, 1.0),)

class Bare:
    pass

class Words:
    def __init__(self, joint, dt): pass
    def reset(self, mask=None): pass
    def act(self, measurement, reference): return [float("nan")]

def number(joint, dt):
    return 3
'''


@pytest.fixture
def law(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(LAW, encoding="utf-8")
    return "./mine.py"


def imports() -> int:
    path = Path("imported")
    return len(path.read_text()) if path.exists() else 0


def made(word: str) -> Controller:
    return make_controller(word, load_joint(JOINT, "output_fixed", effects={}), 1e-3)


def test_classes_functions_and_rows_make_controllers(law: str) -> None:
    env = gymnasium.make(
        "CJT/TorqueTracking-v0", base_controller=lambda joint, dt: made(f"{law}:Mine")
    )
    env.reset(seed=0)
    first = env.step(np.zeros(1))[4]["base_action"]
    for name in ("ready", "Mine"):
        env = gymnasium.make("CJT/TorqueTracking-v0", base_controller=f"{law}:{name}")
        env.reset(seed=0)
        assert env.step(np.zeros(1))[4]["base_action"] == pytest.approx(first)
    assert made(f"{law}:ROW").dt == 1e-3
    assert imports() == 1, "a file is imported once while it stays as it is"


def test_its_past_is_forgotten_where_an_episode_ends(law: str) -> None:
    envs = gymnasium.make_vec(
        "CJT/TorqueTracking-v0", num_envs=3, base_controller=f"{law}:Mine", episode_steps=2
    )
    envs.reset(seed=0)
    for _ in range(3):
        envs.step(np.zeros((3, 1)))
    resets = envs.unwrapped.episodes.controller.law.resets  # type: ignore[attr-defined]
    assert resets[0] is None
    assert len(resets) == 2


@pytest.mark.parametrize(
    ("name", "kind", "message"),
    [
        ("Mien", UnknownNameError, "Did you mean 'Mine'"),
        ("Bare", ConfigurationError, r"must take \(joint, dt\)"),
        ("Fixed", ConfigurationError, "each with usual="),
        ("number", ConfigurationError, "must make a controller, with act.* got 3"),
    ],
)
def test_what_is_no_controller_is_refused(
    law: str, name: str, kind: type[CjtGymError], message: str
) -> None:
    with pytest.raises(kind, match=message):
        made(f"{law}:{name}")


def test_commands_that_are_no_numbers_are_refused(law: str) -> None:
    env = gymnasium.make("CJT/TorqueTracking-v0", base_controller=f"{law}:Words")
    env.reset(seed=0)
    with pytest.raises(ConfigurationError, match=r"finite motor torques of the shape \(1,\)"):
        env.step(np.zeros(1))


def test_files_that_are_gone_or_broken_are_refused(law: str) -> None:
    with pytest.raises(MissingFileError, match=r"there is no file gone\.py"):
        made("gone.py:Mine")
    Path("broken.py").write_text("\nx = 1 / 0\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"broken.py cannot .* division by zero \(line 2"):
        made("broken.py:Mine")
    assert main(["simulate", JOINT, "--controller", "broken.py:Mine", "--out", "r.csv"]) == 2


FAILING = """
class Mine:
    def __init__(self, joint, dt):
        self.gain = {construct}

    def reset(self, mask=None):
        {reset}

    def act(self, measurement, reference):
        return {act}
"""


@pytest.mark.parametrize(
    ("part", "code", "line"),
    [("construct", "dt.gain", 4), ("reset", "1 / 0", 7), ("act", "[][1]", 10)],
)
def test_code_that_fails_is_told_with_its_line(
    part: str, code: str, line: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "failing.py"
    fine = {"construct": "0", "reset": "pass", "act": "reference"}
    path.write_text(FAILING.format(**fine | {part: code}), encoding="utf-8")
    words = ["simulate", JOINT, "--duration", "0.1", "--out", str(tmp_path / "r.csv")]
    assert main([*words, "--controller", f"{path}:Mine"]) == 2
    told = capsys.readouterr().err
    assert f"The code of {path}:Mine fails: " in told
    assert f"(line {line})." in told


def test_a_file_without_a_name_is_told_what_is_in_it(law: str) -> None:
    with pytest.raises(ConfigurationError, match=f"as {law}:NAME. There: .*Mine"):
        made(law)


@pytest.mark.slow
def test_commands_take_it(law: str, capsys: pytest.CaptureFixture[str]) -> None:
    word = f"{law}:Mine"
    run = [
        "simulate",
        JOINT,
        "--reference",
        "step",
        "--duration",
        "0.2",
        "--out",
        "r.csv",
        "--json",
    ]
    assert main([*run, "--controller", word]) == 0
    error = json.loads(capsys.readouterr().out)["rmse"]
    # the usual kp is unstable, so that any that is stable takes its place
    tuned = ["--joint", JOINT, "--budget", "12", "--episodes", "4", "--out", "kp.toml", "--json"]
    for _ in range(2):  # the second time the file is there
        assert main(["tune", word, *tuned]) == 0
        assert set(json.loads(capsys.readouterr().out)["gains"]) == {"kp"}
    assert main([*run, "--controller", f"{word}@kp.toml"]) == 0
    assert json.loads(capsys.readouterr().out)["rmse"] != error
    several = ["--controller", word, f"{word}@kp.toml", "--task", "step", "--episodes", "2"]
    assert main(["benchmark", "--joint", JOINT, *several, "--out", "found", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["controller"] for row in rows] == ["Mine", "Mine@kp"]


def test_no_file_brings_code_in(law: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("kp.toml").write_text(
        f'controller = "{law}:Mine"\n[gains.kp]\nvalue = 0.1\nunit = "-"\n', encoding="utf-8"
    )
    with pytest.raises(ConfigurationError, match=r"name it as  \./mine\.py:Mine@kp\.toml"):
        choose("kp.toml")
    with pytest.raises(ConfigurationError, match="A file cannot name code"):
        environment_arguments({"base_controller": f"{law}:Mine"})
    assert not is_composed("./a+b.py:Mine"), "or a record that names it would bring it in"
    assert imports() == 0
    with pytest.raises(ConfigurationError, match=r"holds gains of .*Mine, not of .*ready"):
        choose(f"{law}:ready@kp.toml")


def test_a_cell_of_the_benchmark_changes_with_the_code(law: str) -> None:
    cell = Cell(f"{law}:Mine", False, JOINT, "output_fixed", ("step",))
    before = cell.key()
    Path("mine.py").write_text(LAW + "\n", encoding="utf-8")
    assert cell.key() != before


@pytest.mark.parametrize("name", ["pd_feedforward", "pd+reference+friction"])
def test_environments_take_the_names_of_controllers(name: str) -> None:
    found = []
    for given in (name, lambda joint, dt: make_controller(name, joint, dt)):
        env = gymnasium.make("CJT/TorqueTracking-v0", base_controller=given)
        env.reset(seed=0)  # whose reference begins with a step
        found.append(env.step(np.zeros(1))[4]["base_action"])
    assert found[0] == found[1] != 0.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (PdFeedForward, "must be a controller, got the class PdFeedForward itself. Give an inst"),
        (lambda joint, dt: PdFeedForward, "must return a controller, got the class PdFeedForward"),
        (3, "must be a controller, got 3"),
    ],
)
def test_a_class_is_no_controller(given: object, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        gymnasium.make("CJT/TorqueTracking-v0", base_controller=given)
    with pytest.raises(UnknownNameError, match="Did you mean 'pd_feedforward'"):
        gymnasium.make("CJT/TorqueTracking-v0", base_controller="pd_feedforwad")
