"""The figures of learned against classical, from cells whose figures are known."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym.analysis import Loop, probe_law, probe_plant
from cjt_gym.baselines import make_controller
from cjt_gym.envs.core import Episodes
from cjt_gym.errors import ConfigurationError, MissingFileError
from cjt_gym.plant import SimulatedPlant
from cjt_gym.signals import Signal
from cjt_gym.training.benchmark.grid import Cell
from cjt_gym.training.evaluation.conditions import Conditions, realistic_conditions
from cjt_gym.training.evaluation.metrics import nrmse
from cjt_gym.training.evaluation.rollout import ControllerAgent, joint_of, run_task
from cjt_gym.training.evaluation.tasks import get_task
from cjt_gym.training.learning.config import load_config
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.run_folder import RunFolder
from experiments.results import port, tables
from experiments.results.__main__ import main
from experiments.results.experiment import _compare
from experiments.results.jobs import Job, run_jobs
from experiments.results.page import write_all, write_document
from experiments.results.plan import STRUCTURES, Plan, other_joints
from experiments.results.score import THRESHOLDS, improvement, iqm, profile, summary_of
from experiments.results.shift import errors_under, widened
from experiments.results.worst_case import worst_case

TASKS = ("step", "reversal")
JOINT = "orange_80_6000"
FIXED, FREE = STRUCTURES


def cell(agent: str, kind: str, nrmse: float, noise: float | None, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    powers = {task: list(rng.uniform(0.5, 1.5, 16)) for task in TASKS}
    squares = {task: [nrmse**2 * x for x in powers[task]] for task in TASKS}
    rows = [{"task": task, "noise_amplification": noise} for task in TASKS]
    commands = {task: {"change": 0.1, "fast": 0.2, "effort": 3.0} for task in TASKS}
    found = {"agent": agent, "kind": kind, "squares": squares, "powers": powers, "rows": rows}
    found["commands"] = commands
    return {"status": "done", **found}


def test_interquartile_mean_drops_the_outer_quarters() -> None:
    assert iqm(np.array([100.0, 1.0, 2.0, -50.0])) == pytest.approx(1.5)
    assert iqm(np.array([1.0, 2.0, 3.0, 4.0, 50.0])) == pytest.approx(
        (0.75 * 2.0 + 3.0 + 0.75 * 4.0) / 2.5
    )
    assert iqm(np.array([7.0])) == pytest.approx(7.0)


def test_ratio_is_to_the_best_controller_and_its_interval_holds_it() -> None:
    policies = [cell(f"p{k}", "residual", 0.10 + 0.01 * k, 5.0, 0) for k in range(5)]
    laws = [cell("pid", "classical", 0.2, 8.0, 0), cell("pd", "classical", 0.4, 2.0, 0)]
    found = summary_of("rigid_gearbox", [*policies, *laws])
    assert found["best"] == "pid"
    assert found["score"]["pd"] == pytest.approx(0.4)
    assert found["ratio"]["value"] == pytest.approx(0.6, rel=1e-6)
    assert found["ratio"]["low"] <= 0.6 <= found["ratio"]["high"]
    assert 0.5 <= found["ratio"]["low"] < found["ratio"]["high"] <= 0.7
    text = tables.sentence(found)
    assert "0.60" in text
    assert "chance" not in text
    assert [row[0] for row in tables.scores(found)[1:]] == ["policy", "pid", "pd"]
    assert tables.tasks(found)[2][0] == "reversal (held out)"


def test_trainings_that_differ_widely_are_said_to_show_nothing() -> None:
    policies = [cell(f"p{k}", "residual", 0.05 * 4.0**k, None, 0) for k in range(4)]
    found = summary_of("rigid", [*policies, cell("pid", "classical", 0.2, None, 0)])
    assert found["noise"]["policy"] is None
    assert "which could be chance" in tables.sentence(found)


def test_probability_of_improvement_counts_pairs_of_the_same_episode() -> None:
    law = cell("pid", "classical", 0.2, None, 0)
    better, worse = cell("a", "residual", 0.1, None, 0), cell("b", "residual", 0.3, None, 0)
    assert improvement([better], law) == pytest.approx({"value": 1.0, "low": 1.0, "high": 1.0})
    assert improvement([better, worse], law)["value"] == pytest.approx(0.5)
    assert improvement([{**law, "agent": "same"}], law)["value"] == pytest.approx(0.5)
    found = improvement([better, worse], law)
    assert found["low"] == pytest.approx(0.0, abs=1e-9)
    assert found["high"] == pytest.approx(1.0)


def test_a_profile_rises_from_nothing_to_everything_at_the_error() -> None:
    error = 0.21  # between two thresholds: one of them is 0.2, but for rounding
    found = profile([cell("pid", "classical", error, None, 0)])
    at = np.array(THRESHOLDS)
    assert np.abs(at - error).min() > 1e-3
    np.testing.assert_array_equal(found["value"], (at > error).astype(float))
    np.testing.assert_allclose([found["low"], found["high"]], [found["value"]] * 2, atol=1e-12)


def test_ranges_widen_about_their_middle_and_not_below_zero() -> None:
    usual = realistic_conditions(JOINT, FIXED).randomization
    wide, late = widened(usual, box=2.0), widened(usual, delay=3e-3)
    assert (wide["I_m"]["low"], wide["I_m"]["high"]) == pytest.approx((0.8, 1.2))
    assert (wide["coulomb.d_cm"]["low"], wide["coulomb.d_cm"]["high"]) == pytest.approx((0.0, 2.0))
    delay = wide["command_delay.delay"]
    assert (delay["low"], delay["high"]) == pytest.approx((0.0, 2.75e-3))
    assert delay["operation"] == "set"
    delay = late["command_delay.delay"]
    assert (delay["low"], delay["high"]) == pytest.approx((3.5e-3, 5e-3))
    assert late["I_m"] == widened(usual)["I_m"]


@pytest.mark.slow
def test_tasks_side_by_side_give_the_errors_of_the_benchmark(tmp_path: Path) -> None:
    here = Cell("pd_feedforward", False, JOINT, FIXED, ("step", "smooth", "load_motion"), 0, 24)
    job = Job(errors_under, here)
    (found,) = run_jobs([job], tmp_path, 1)
    assert found["status"] == "done"
    conditions = realistic_conditions(JOINT, FIXED)
    for task, squares in found["squares"].items():
        assert len(squares) == len(found["powers"][task]) == 24
        setting = get_task(task).setting(conditions, joint_of(conditions))
        alone = run_task(ControllerAgent("pd_feedforward"), setting, 24, 0)
        error = np.sqrt(np.mean(squares) / np.mean(found["powers"][task]))
        assert error == pytest.approx(nrmse(alone), rel=0.3), task
    job.path(tmp_path).write_text(json.dumps({"kept": True}))
    assert run_jobs([job], tmp_path, 1) == [{"kept": True}]
    late = Job(errors_under, here, {"delay": 4e-3})
    assert late.path(tmp_path) != job.path(tmp_path)
    assert np.mean(late.run()["squares"]["step"]) > np.mean(found["squares"]["step"])


def test_a_law_that_does_not_fit_a_joint_is_refused_not_dropped(tmp_path: Path) -> None:
    (found,) = run_jobs([Job(_refuse, Cell("pd", False, JOINT, FIXED, ("step",)))], tmp_path, 1)
    assert (found["status"], found["why"]) == ("refused", "no")
    assert _compare("there", [found])["without"] == {"pd": "no"}


def _refuse(cell: Cell) -> dict[str, Any]:
    raise ConfigurationError("no")


def test_joints_lie_where_they_are_placed() -> None:
    joint = joint_of(realistic_conditions(JOINT, FIXED))
    once = {"k_b": {"low": 0.9, "high": 1.1, "when": "once"}}
    plant = SimulatedPlant(joint, 3, randomization=once)
    plant.seed(5)
    plant.place(np.array([[0.0], [0.25], [1.0]]))
    for _ in range(2):
        plant.reset()
        shares = plant.drawn()["k_b"] / joint.parameters.k_b
        np.testing.assert_allclose(shares, [0.9, 0.95, 1.1])
    plant.reset(seed=5)
    assert abs(plant.drawn()["k_b"][0] / joint.parameters.k_b - 0.9) > 1e-6
    with pytest.raises(ConfigurationError, match="shape"):
        plant.place(np.zeros((3, 2)))
    with pytest.raises(ConfigurationError, match="once"):
        SimulatedPlant(joint, 3, randomization={"k_b": (0.9, 1.1)}).place(np.zeros((3, 1)))


@pytest.mark.slow
def test_the_worst_place_is_worse_than_the_middle_and_found_again() -> None:
    here = Cell("pd_feedforward", False, JOINT, FIXED, ("step",), 0, 2)
    found = worst_case(here, 2, 6)
    assert found["worst"] > 1.1 * found["middle"] > 0.0
    nominal = joint_of(realistic_conditions(JOINT, FIXED)).parameters.I_m
    assert 0.9 * nominal <= found["where"]["I_m"] <= 1.1 * nominal
    assert worst_case(here, 2, 6) == found


@pytest.mark.parametrize("structure", STRUCTURES)
def test_damping_of_a_linear_port_is_the_real_part_of_its_impedance(structure: str) -> None:
    conditions = Conditions(JOINT, structure)
    joint = joint_of(conditions)
    law = make_controller("pd_feedforward", joint, conditions.dt_control)
    linear = probe_law(law, joint, conditions.dt_control)
    wanted = Loop(linear, probe_plant(joint, conditions.dt_control)).responses(
        np.array(port.FREQUENCIES)
    )
    found = port.measure(ControllerAgent("pd_feedforward"), conditions, 0)
    scale = np.abs(wanted.port)
    for f, impedance, size in zip(port.FREQUENCIES, wanted.port, scale, strict=True):
        assert found[f] == pytest.approx(impedance.real, abs=0.03 * size), f


def test_other_joints_have_the_same_effects_and_are_others() -> None:
    names = other_joints(JOINT, FIXED)
    assert JOINT not in names
    assert "lime_50_21000" in names
    assert "emps" not in names


def test_scales_that_were_given_keep_their_ratio_on_another_joint(finished: RunFolder) -> None:
    policy = load_policy(finished.path)
    config = policy.config.with_changes(env={**policy.config.env, "action_scale": 3.0})
    other = Conditions("lime_50_21000", FIXED)
    layout = replace(policy.layout, action=3.0)
    found = replace(policy, config=config, layout=layout).arguments(other)
    share = other.amplitude / Conditions(config.env.get("joint", JOINT), FIXED).amplitude
    assert found["action_scale"] == pytest.approx(3.0 * share)
    usual = policy.arguments(other)
    assert usual["torque_amplitude"] == pytest.approx(other.amplitude)
    assert usual["action_scale"] == pytest.approx(0.5 * other.amplitude)
    made = Episodes(1, **{**usual, "disturbance": Signal("multisine", 9.0), "randomization": None})
    assert made.settings.layout.velocity == pytest.approx(usual["velocity_scale"])
    own = Conditions(JOINT, FIXED)
    assert policy.arguments(own)["velocity_scale"] == policy.layout.velocity


def test_a_recipe_for_each_structure(tmp_path: Path) -> None:
    one = Plan(tmp_path, recipe={FIXED: "quiet_residual", FREE: "demo"}, steps=10)
    assert one.config(FREE).env["structure"] == FREE
    assert one.base(FREE) == load_config("demo").env["base_controller"]
    assert one.base(FIXED) == load_config("quiet_residual").env["base_controller"]
    assert one.base(FIXED) != one.base(FREE)
    assert one.config(FIXED).total_steps == 10
    assert Plan(tmp_path, recipe="demo").base(FIXED) == one.base(FREE)


@cache
def known(structure: str) -> dict[str, Any]:
    """Return a comparison whose figures are known."""
    policies = [cell(f"p{k}", "residual", 0.10 + 0.01 * k, 5.0, 0) for k in range(3)]
    laws = [cell("pid", "classical", 0.2, 3.0, 0), cell("pd", "classical", 0.4, 2.0, 0)]
    found = summary_of(structure, [*policies, *laws])
    bad = [cell(f"p{k}", "residual", 0.3, 5.0, 0) for k in range(3)]
    worst = {n: {"middle": 0.1, "worst": w, "where": {"I_m": 0.2}, "most": w} for n, w in WORST}
    row = {"1": 0.1, "50": 0.2}
    agents = {name: {"resistance": row} for name in ("policy", "pid")}
    agents["policy"] = {**agents["policy"], "least": {"1": -0.1, "50": 0.2}}
    return {
        **found,
        "base": "pd",
        "shifts": [_compare("as in the benchmark", [*policies, *laws]) | {"delay": 0.0}],
        "joints": [_compare("lime", [*bad, *laws], "pd")],
        "worst": {"agents": worst, "without": {}},
        "port": {"agents": agents, "without": {}},
    }


WORST = (("policy", 0.3), ("pid", 0.25), ("pd", 0.5))


@pytest.mark.slow
def test_where_a_controller_wins_the_table_says_so() -> None:
    rows = {row[0]: row[1:] for row in tables.wins(known(FIXED))[1:]}
    assert rows["noise amplification"] == ["pid", "3.000", "5.000"]
    assert rows["score, lime"] == ["pid", "0.200", "0.300"]
    assert rows["worst point of the box"] == ["pid", "0.250", "0.300"]
    assert rows["damping of the output at 1 Hz"][0] == "pid"
    assert "score" not in rows
    assert not any(name.startswith("task") for name in rows)
    words = " ".join(tables.verdicts(known(FIXED)))
    assert "beat the best controller on 0 (0 clearly)" in words
    assert "their base on 1 (1 clearly)" in words
    assert "feeds energy into its load at 1 Hz." in words


def test_tables_go_between_the_marks_of_a_document(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = tmp_path / "page.md"
    names = ("facts", "summary", *tables.PARTS)
    marks = [f"<!-- results: {n} -->old<!-- end of results: {n} -->" for n in names]
    document.write_text("before\n" + "\n".join(marks) + "\nafter\n")
    plan = Plan(tmp_path / "results", recipe={FIXED: "one", FREE: "two"}, steps=20_000)
    page = write_all(plan, [known(FIXED)])
    assert page.read_text().count("<svg") == 4
    again = ["--out", str(plan.out), "--document", str(document), "--write-only"]
    assert main(again) == 0
    text = document.read_text()
    assert text.startswith("before\n")
    assert text.endswith("\nafter\n")
    assert "old" not in text
    assert "5 trainings of 20 000 steps of each structure by one, two, 32 episodes" in text
    assert text.count("| policy | 0.110 | 5.00 |") == 1
    assert (tmp_path / "figures" / f"results_{FIXED}.svg").read_text().startswith("<svg")
    assert main(again) == 0
    assert document.read_text() == text
    capsys.readouterr()
    assert main(["--out", str(tmp_path / "none"), "--write-only"]) == 2
    assert "holds no results.json" in capsys.readouterr().err
    data = json.loads((plan.out / "results.json").read_text())
    document.write_text("nothing")
    with pytest.raises(ConfigurationError, match="has no place for results"):
        write_document(document, data)
    document.write_text("<!-- results: scores -->")
    with pytest.raises(ConfigurationError, match="lacks its"):
        write_document(document, data)
    with pytest.raises(MissingFileError):
        write_document(tmp_path / "none.md", data)
