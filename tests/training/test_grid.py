"""The benchmark over a grid: tasks, ranking, resuming, clusters, and the files it writes."""

from __future__ import annotations

import json
import shutil
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym.baselines.gains import write_gains
from cjt_gym.baselines.shipped import FOLDER
from cjt_gym.cli import main
from cjt_gym.commands.benchmark import _tell
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.joint import load_joint_file, to_toml
from cjt_gym.training.benchmark import grid
from cjt_gym.training.benchmark.code_hash import code_hash, sources
from cjt_gym.training.benchmark.grid import Cell, make_cells, run_cell, run_grid
from cjt_gym.training.benchmark.results import merge, rankings
from cjt_gym.training.evaluation.conditions import realistic_conditions
from cjt_gym.training.evaluation.ranking import rank
from cjt_gym.training.evaluation.rollout import ControllerAgent, joint_of, run_task
from cjt_gym.training.evaluation.tasks import BENCHMARK_TASKS, get_task

JOINT, FIXED, FREE = "orange_80_6000", "output_fixed_rigid_gearbox", "rigid_gearbox"


def small(agent: str, seed: int = 0, structure: str = FIXED) -> Cell:
    return Cell(agent, False, JOINT, structure, ("smooth",), seed, 2)


CELLS = [small(agent, seed) for agent in ("open_loop", "pd_feedforward") for seed in (0, 1)]


@pytest.mark.parametrize("task", ["reversal", "load_motion", "contact", "impedance"])
def test_every_task_moves_what_it_says(task: str) -> None:
    conditions = realistic_conditions(JOINT, FREE)
    setting = get_task(task).setting(conditions, joint_of(conditions))
    runs = [
        run_task(ControllerAgent(name), setting, 2, 0) for name in ("open_loop", "pd_feedforward")
    ]
    assert runs[0].tau.shape == (2, round(setting.duration / 1e-3))
    assert all(np.isfinite(run.tau).all() and not run.terminated.any() for run in runs)
    assert runs[1].error.std() < runs[0].error.std()
    if task == "impedance":
        assert np.ptp(runs[0].reference) > 0.1 * conditions.amplitude
    else:
        np.testing.assert_array_equal(runs[0].reference, runs[1].reference)
    if task == "contact":
        assert runs[0].reference.min() >= 0.0
        assert "contact" in setting.conditions.effects


def test_tasks_exist_where_they_make_sense() -> None:
    assert not BENCHMARK_TASKS["contact"].applies(FIXED)
    assert BENCHMARK_TASKS["contact"].applies(FREE)
    assert not BENCHMARK_TASKS["load_motion"].applies("rigid")
    assert not BENCHMARK_TASKS["impedance"].applies(FREE, "learned")
    with pytest.raises(ConfigurationError, match="contact does not exist"):
        make_cells(["open_loop"], [], [JOINT], [FIXED], ["contact"], [0], 2)
    cells = make_cells(["open_loop"], [], [JOINT], [FIXED, FREE], ["contact"], [0, 1], 2)
    assert [(cell.structure, cell.seed) for cell in cells] == [(FREE, 0), (FREE, 1)]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, Any]]]:
    """Return the folder and the results of two controllers and two seeds."""
    folder = tmp_path_factory.mktemp("cells")
    return folder, run_grid(CELLS, folder)


def test_a_grid_goes_on_where_it_was_stopped(
    ran: tuple[Path, list[dict[str, Any]]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(ran[0], tmp_path, dirs_exist_ok=True)
    (tmp_path / f"{CELLS[1].key()}.json").write_text("{ broken")
    (tmp_path / f"{CELLS[2].key()}.json").unlink()
    again: list[Cell] = []

    def run(cell: Cell) -> dict[str, Any]:
        again.append(cell)
        return ran[1][CELLS.index(cell)]

    monkeypatch.setattr(grid, "run_cell", run)
    seen: list[dict[str, Any]] = []
    for _ in range(2):
        assert run_grid(CELLS, tmp_path, report=seen.append) == ran[1]
        assert again == CELLS[1:3]
    assert len(seen) == 2 * len(CELLS)


def test_what_a_cell_depends_on_changes_its_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_gains(tmp_path / "g.toml", "pd_feedforward", {"kp": 0.2}, {})
    keys = [small("open_loop").key(), small("open_loop", 1).key(), small(str(path)).key()]
    assert keys[0] == small("open_loop").key()
    write_gains(path, "pd_feedforward", {"kp": 0.3}, {})
    assert len({*keys, small(str(path)).key()}) == 4
    monkeypatch.setattr(grid, "code_hash", lambda: "another")
    assert small("open_loop").key() not in keys


def test_code_and_shipped_gains_are_counted() -> None:
    counted = dict(sources(resources.files("cjt_gym.baselines"), "baselines"))
    assert "baselines/observers/kalman.py" in counted
    assert {
        f"baselines/tuned/{path.relative_to(FOLDER)}" for path in FOLDER.glob("*/*/*.toml")
    } <= {*counted}
    assert len(code_hash()) == 64


def test_a_controller_that_renders_takes_part_in_that_alone() -> None:
    tasks = ["smooth", "impedance"]
    cells = make_cells(["passivity_momentum", "impedance"], [], [JOINT], [FIXED], tasks, [0], 2)
    assert [cell.tasks for cell in cells] == [("smooth", "impedance"), ("impedance",)]
    conditions = realistic_conditions(JOINT, FIXED)
    setting = get_task("impedance").setting(conditions, joint_of(conditions))
    asked, own = (
        run_task(ControllerAgent(name), setting, 2, 0)
        for name in ("passivity_momentum", "impedance")
    )
    assert np.ptp(own.reference) > 0.1 * conditions.amplitude
    assert own.error.std() < 1.3 * asked.error.std()  # the same law inside, asked by itself
    done = {"status": "done", "cell": {"joint": JOINT, "structure": FIXED}}
    results = [
        {**done, "agent": name, "renders": name == "impedance", "squares": s, "powers": s}
        for name, s in (("pd", {"smooth": [1.0]}), ("impedance", {"impedance": [1.0]}))
    ]
    (places,) = rankings(results).values()
    assert [place.agent for place in places] == ["pd"]


def test_a_cell_says_what_the_linear_loop_says(ran: tuple[Path, list[dict[str, Any]]]) -> None:
    result = ran[1][2]
    assert (result["agent"], result["status"]) == ("pd_feedforward", "done")
    figures = result["linear"]["figures"]
    assert figures["stable"]
    assert figures["gain_margin"] > 1.0
    assert result["squares"]["smooth"][0] > 0.0
    refused = run_cell(Cell("pd_feedforward", False, "emps", "rigid", ("smooth",), 0, 2))
    assert refused["status"] == "refused"
    assert "torque_amplitude" in refused["why"]


def test_seeds_are_pooled_and_ranked_in_pairs(ran: tuple[Path, list[dict[str, Any]]]) -> None:
    results = ran[1]
    rows = merge(results)
    assert [(row["controller"], row["episodes"]) for row in rows] == [
        ("open_loop", 4),
        ("pd_feedforward", 4),
    ]
    squares = np.concatenate([r["squares"]["smooth"] for r in results[:2]])
    assert rows[0]["rmse"] == pytest.approx(np.sqrt(squares.mean()))
    assert rows[0]["ci95"][0] <= rows[0]["rmse"] <= rows[0]["ci95"][1]
    (places,) = rankings(results).values()
    assert [place.agent for place in places] == ["pd_feedforward", "open_loop"]


def test_a_ranking_tells_differences_from_chance() -> None:
    rng = np.random.default_rng(0)
    hard = rng.lognormal(0.0, 1.0, 64)  # what all agents share
    agents = {
        "good": 0.5 * hard,
        "same": 0.5 * hard * rng.lognormal(0.0, 0.3, 64),
        "bad": 1.5 * hard * rng.lognormal(0.0, 0.3, 64),
    }
    squares = {name: {"step": list(values)} for name, values in agents.items()}
    powers = {name: {"step": [1.0] * 64} for name in agents}
    places = {place.agent: place for place in rank(squares, powers)}
    assert places["good"].rank == places["same"].rank == 1
    assert places["bad"].rank == 3
    score = np.sqrt(np.mean(agents["bad"]))
    assert places["bad"].score == pytest.approx(score)
    assert places["bad"].low < score < places["bad"].high
    with pytest.raises(ConfigurationError, match="in common"):
        rank({"a": {"step": [1.0]}, "b": {"chirp": [1.0]}}, powers)


@pytest.mark.slow
def test_chance_alone_is_rarely_called_significant() -> None:
    rng = np.random.default_rng(1)
    wrong = 0
    for _ in range(20):
        squares = {f"{i}": {"step": list(rng.lognormal(0.0, 0.5, 48))} for i in range(6)}
        powers = {name: {"step": [1.0] * 48} for name in squares}
        wrong += any(place.rank > 1 for place in rank(squares, powers))
    assert wrong <= 4


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["loky", "ray", "dask"])
def test_workers_do_the_same_as_one_process(
    backend: str, ran: tuple[Path, list[dict[str, Any]]], tmp_path: Path
) -> None:
    pytest.importorskip({"loky": "joblib", "ray": "ray", "dask": "distributed"}[backend])
    assert run_grid(CELLS[::2], tmp_path, 2, backend) == ran[1][::2]


@pytest.mark.slow
def test_the_command_writes_rows_ranking_and_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["benchmark", "--joint", JOINT, "--structure", FIXED, "--task", "step", "impedance"]
    words += ["--controller", "open_loop", "pd_feedforward", "--episodes", "2"]
    assert main([*words, "--json", "--out", str(tmp_path)]) == 0
    captured = capsys.readouterr()
    rows = json.loads(captured.out)
    assert rows == json.loads((tmp_path / "benchmark.json").read_text())
    assert [(r["controller"], r["task"]) for r in rows] == [
        (c, t) for c in ("open_loop", "pd_feedforward") for t in ("step", "impedance")
    ]
    assert "cell/s" not in captured.err, "a bar is for terminals"
    (ranking,) = json.loads((tmp_path / "ranking.json").read_text())
    assert ranking["ranking"][0]["agent"] == "pd_feedforward"
    page = (tmp_path / "report.html").read_text()
    assert page.count("<svg") == 4
    assert "src=" not in page
    assert "phase margin" in page
    assert main([*words, "--out", str(tmp_path)]) == 0
    assert "Ranking on orange_80_6000" in capsys.readouterr().out


def test_bad_grids_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="'ray'"):
        run_grid([], tmp_path, backend="rai")
    with pytest.raises(UnknownNameError, match="orange_80_6000"):
        make_cells(["open_loop"], [], ["orange"], [FIXED], ["step"], [0], 2)
    with pytest.raises(ConfigurationError, match="episodes"):
        make_cells(["open_loop"], [], [JOINT], [FIXED], ["step"], [0], 0)
    assert main(["benchmark", "--joint", JOINT, "--out", str(tmp_path), "--seeds", "0"]) == 2


def test_effects_that_are_asked_for_are_those_of_a_cell() -> None:
    usual = make_cells(["open_loop"], [], [JOINT], [FIXED], ["step"], [0], 2)[0]
    asked: dict[str, Any] = {"effects": ("coulomb", "cogging=typical"), "randomization": "mild"}
    cell = make_cells(["open_loop"], [], [JOINT], [FIXED], ["step"], [0], 2, **asked)[0]
    assert tuple(joint_of(cell.conditions()).effects) == ("coulomb", "cogging")
    assert cell.conditions().randomization == {"preset": "mild"}
    assert "command_delay" in joint_of(usual.conditions()).effects
    assert cell.key() != usual.key()


def test_a_listed_effect_stands_for_what_it_excludes(tmp_path: Path) -> None:
    path = tmp_path / "found.toml"
    shipped = resources.files("cjt_gym.params") / f"{JOINT}.toml"
    text = shipped.read_text(encoding="utf-8")
    path.write_text(text + "\n[effects.coulomb_asym]\n", encoding="utf-8")
    cell = make_cells(["open_loop"], [], [str(path)], [FIXED], ["step"], [0], 2)[0]
    effects = joint_of(cell.conditions()).effects
    assert "coulomb_asym" in effects
    assert "coulomb" not in effects


def test_a_policy_is_at_home_on_a_copy_of_its_joint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, copy, other = (tmp_path / f"{name}.toml" for name in ("first", "copy", "other"))
    for path, joint in ((first, JOINT), (copy, JOINT), (other, "lemon_50_6000")):
        path.write_text(to_toml(load_joint_file(joint)), encoding="utf-8")
    for joint in (copy, other):
        cell = {"joint": str(joint), "structure": FIXED}
        _tell([{"agent": "a", "status": "done", "cell": cell, "trained_on": [str(first), FIXED]}])
        assert ("was trained on" in capsys.readouterr().err) == (joint is other)
