"""The examples of how to extend the package run, and packages bring rows along."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.errors import CjtGymError
from cjt_gym.joint import EFFECTS
from cjt_gym.joint.effects import Effect, EffectParameter, register_effect
from cjt_gym.training.evaluation.tasks import BENCHMARK_TASKS
from tests.docs.pages import DOCS, blocks, page
from tests.python import run_python

RUNNING = sorted(path.stem for path in (DOCS / "extend").glob("*.md") if blocks(path.read_text()))
DRAG = EffectParameter("drag", "N m", 0.0, 0.0, 20.0, "Drag", ("d_cm", "d_cm_n"))


@pytest.fixture(autouse=True)
def _tables_as_before() -> Iterator[None]:
    before = [(table, dict(table)) for table in (EFFECTS, BENCHMARK_TASKS)]
    yield
    for table, rows in before:
        table.clear()  # type: ignore[attr-defined]
        table.update(rows)  # type: ignore[attr-defined]


def run_page(name: str) -> None:
    for block in blocks(page(f"extend/{name}")):
        exec(compile(block, f"{name}.md", "exec"), {"__name__": "example"})


def test_all_five_have_an_example() -> None:
    assert RUNNING == ["controller", "effect", "reference", "reward", "task"]


@pytest.mark.parametrize("name", RUNNING)
def test_example_runs(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    run_page(name)
    assert capsys.readouterr().out


def test_an_own_effect_does_what_the_fields_say(capsys: pytest.CaptureFixture[str]) -> None:
    run_page("effect")
    torques, drawn = capsys.readouterr().out.strip().splitlines()[-2:]
    assert "-6" in torques
    assert "seal.drag" in drawn
    assert main(["joints", "seal"]) == 0
    assert "lip seal" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"name": "coulomb"}, "no other effect has"),
        ({"name": "my seal"}, "must be an identifier"),
        ({"stage": "motr"}, "Did you mean 'motor'"),
        ({"size": ("drg",)}, "Did you mean 'drag'"),
        ({"parameters": ()}, "Unknown size"),
        ({"parameters": (), "size": ()}, "must have parameters"),
    ],
)
def test_rows_that_make_no_effect_are_refused(changes: dict[str, object], told: str) -> None:
    row = {
        "name": "seal",
        "stage": "motor",
        "summary": "",
        "source": "",
        "parameters": (DRAG,),
        "size": ("drag",),
    }
    with pytest.raises(CjtGymError, match=told):
        register_effect(Effect(**{**row, **changes}))  # type: ignore[arg-type]
    assert "seal" not in EFFECTS


def test_references_that_are_arrays_or_functions_are_followed() -> None:
    values = np.linspace(0.0, 3.0, 7)
    for reference in (values, lambda t: 500.0 * t):
        env = gym.make("CJT/TorqueTracking-v0", reference=reference, episode_steps=6, preview=2)
        env.reset(seed=0)
        found = [env.step(np.zeros(1, np.float32))[-1]["tau_reference"] for _ in range(6)]
        np.testing.assert_allclose(found, values[1:], atol=1e-9)
    with pytest.raises(CjtGymError, match="reference must have the shape"):
        gym.make("CJT/TorqueTracking-v0", reference=np.zeros((2, 3)))


def test_a_reward_must_give_a_number_per_joint() -> None:
    envs = gym.make_vec("CJT/TorqueTracking-v0", num_envs=3, reward=lambda step: step["tau"][:2])
    envs.reset(seed=0)
    with pytest.raises(CjtGymError, match="the return value of the reward function must have"):
        envs.step(np.zeros((3, 1), np.float32))
    with pytest.raises(CjtGymError, match="reward must be a function"):
        gym.make("CJT/TorqueTracking-v0", reward="tracking")


MODULE = '''
from cjt_gym.joint.effects import Effect, EffectParameter

DRAG = EffectParameter("drag", "N m", 0.0, 0.0, 20.0, "Drag", ("d_cm", "d_cm_n"))
SEAL = Effect("seal", "motor", "A seal", "mine", (DRAG,), ("drag",))


class Damped:
    """Damped."""

    def __init__(self, joint, dt):
        pass

    def reset(self, mask=None):
        pass

    def act(self, measurement, reference):
        return reference


def staircase():
    from cjt_gym.training.evaluation.tasks import Task

    return Task("staircase", "steps", None)


def __getattr__(name):
    if name == "STAIRCASE":
        return staircase()
    raise AttributeError(name)
'''
POINTS = """
[cjt_gym.controllers]
damped = rows_of_mine:Damped
pd = rows_of_mine:Damped
broken = rows_of_mine:Nobody
[cjt_gym.effects]
seal = rows_of_mine:SEAL
[cjt_gym.tasks]
staircase = rows_of_mine:STAIRCASE
"""


def test_a_package_brings_its_rows_along(tmp_path: Path) -> None:
    (tmp_path / "rows_of_mine.py").write_text(MODULE)
    facts = tmp_path / "rows_of_mine-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: rows-of-mine\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(POINTS)
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r});"
        "from cjt_gym.baselines import CONTROLLERS; from cjt_gym.joint import EFFECTS;"
        "from cjt_gym.training.evaluation.tasks import BENCHMARK_TASKS;"
        "print(CONTROLLERS['damped'].summary, CONTROLLERS['pd'].summary != 'Damped.',"
        "EFFECTS['seal'].summary, BENCHMARK_TASKS['staircase'].summary)"
    )
    run = run_python(program)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == "Damped. True A seal steps"
    for told in ("pd of rows-of-mine", "the name is taken", "broken of rows-of-mine"):
        assert told in run.stderr
