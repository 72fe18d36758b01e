"""The joints of the loop, who is tried on them, and what its report says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.blind.control import Gains
from cjt_gym.blind.run import draw_chances, run
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint, get_structure, load_joint, to_toml
from cjt_gym.plant.randomization import resolve_randomization
from cjt_gym.training.evaluation.conditions import zero_reference
from cjt_gym.training.evaluation.rollout import ControllerAgent
from experiments.loop import experiment
from experiments.loop.__main__ import main
from experiments.loop.drive import BlindPlant, drive
from experiments.loop.experiment import ARMS, Outcome, Plan, run_experiment
from experiments.loop.joints import HiddenJoint, as_sensed, hidden_joints
from experiments.loop.report import (
    read_outcomes,
    summary_of,
    verdict,
    write_page,
    write_results,
)
from experiments.loop.wide import NEUTRAL, SHARE, wide_randomization, with_room


@pytest.fixture(scope="module")
def joints() -> list[HiddenJoint]:
    return hidden_joints(groups=4, per_group=2, seed=1)


def test_joints_of_a_group_share_a_datasheet_and_hide_one_or_two_effects(
    joints: list[HiddenJoint],
) -> None:
    assert [len(joint.hidden) for joint in joints] == [1, 2] * 4
    for one, other in zip(joints[::2], joints[1::2], strict=True):
        assert one.case.sheet == other.case.sheet
        assert one.structure == other.structure
    assert len({str(joint.case.sheet) for joint in joints}) == 4


def test_true_joint_moves_as_the_one_of_the_other_simulator(
    joints: list[HiddenJoint], tmp_path: Path
) -> None:
    errors = []
    for joint in joints:
        path = tmp_path / f"{joint.name}.toml"
        path.write_text(to_toml(joint.true(joint.stated(tmp_path))), encoding="utf-8")
        ours = load_joint(path, joint.structure)
        p = ours.parameters
        samples = 400
        command = 0.3 * p.i_p * np.sin(2.0 * np.pi * 4.0 * np.arange(samples) * 1e-3)
        chances = draw_chances(joint.case.world, samples, np.random.default_rng(0))
        theirs = run(joint.case.world, command, Gains(), chances)
        seen = ours.simulate(command * p.k_t * p.n, dt=1e-3, x0=np.zeros(6), dt_physics=1e-4)
        tau = theirs.clean[:, 4]
        errors.append(float(np.std(seen["tau"] - tau) / np.std(tau)))
    assert np.median(errors) < 0.05, errors


def test_plant_obeys_the_contract_and_repeats_itself(
    joints: list[HiddenJoint], tmp_path: Path
) -> None:
    joint = joints[0]
    stated = Joint(joint.stated(tmp_path), joint.structure, "current", {})
    plant = BlindPlant(joint.case.world, stated, steps=50)
    runs = []
    for _ in range(2):
        first = plant.reset(3)
        assert first.t[0] == 0.0
        runs.append([plant.step(np.array([1e9])).tau[0] for _ in range(50)])
    assert runs[0] == runs[1]
    torque = stated.parameters.k_b * 1.0
    assert 0.0 < plant.tau < torque


def test_controller_tracks_on_the_blind_joint(joints: list[HiddenJoint], tmp_path: Path) -> None:
    joint = joints[1]  # whose friction lets it move
    path = tmp_path / "sheet.toml"
    path.write_text(to_toml(as_sensed(joint.stated(tmp_path))), encoding="utf-8")
    agent = ControllerAgent("pd_feedforward")
    given = {"joint": str(path), "structure": joint.structure, "torque_amplitude": 10.0}
    given |= {"reference": "smooth", "episode_steps": 400, **agent.base()}
    tracked = drive(agent, given, joint.case.world, 1, 0)
    still = drive(agent, given | {"reference": zero_reference()}, joint.case.world, 1, 0)
    assert np.ptp(tracked.reference) > 5.0
    assert np.sqrt(np.mean(tracked.error**2)) < np.sqrt(np.mean(tracked.reference**2))
    assert not still.reference.any()


def test_wide_randomisation_draws_what_the_joint_has_room_for(
    joints: list[HiddenJoint], tmp_path: Path
) -> None:
    for joint in joints[::2]:
        file = as_sensed(joint.stated(tmp_path))
        drawn = wide_randomization(file, joint.structure)
        effects = {name.split(".")[0] for name in drawn if "." in name}
        assert effects == {*NEUTRAL, "current_lag"}
        path = tmp_path / "wide.toml"
        path.write_text(to_toml(with_room(file)), encoding="utf-8")
        varied = resolve_randomization(load_joint(path, joint.structure), drawn, 1e-3)
        tolerant = {n for n in varied if varied[n].distribution == "normal"}
        assert {"d_m", "I_g"} <= tolerant
        delay = varied["command_delay.delay"]
        assert delay.values[0] == 0.0
        assert delay.weights[0] / sum(delay.weights) == pytest.approx(1.0 - SHARE)
        assert ("k_b" in drawn) == ("k_b" in get_structure(joint.structure).needed_parameters)
        assert set(NEUTRAL) <= set(with_room(file).effects)


def outcome(name: str, *errors: float) -> Outcome:
    tasks = {arm: {"step": e, "chirp": e} for arm, e in zip(ARMS, errors, strict=True)}
    noise = dict.fromkeys(ARMS, 5.0)
    return Outcome(name, "rigid", ("coulomb",), ("coulomb",), "explained", 10.0, tasks, noise)


def test_report_says_what_was_recovered_and_where_it_did_not_help(tmp_path: Path) -> None:
    outcomes = [
        outcome("half", 3.0, 2.0, 1.8, 1.5, 1.0),
        outcome("all", 3.0, 2.0, 1.5, 1.0, 1.0),
        outcome("worse", 3.0, 2.0, 1.0, 3.0, 1.0),
        outcome("none", 3.0, 1.02, 1.0, 1.0, 1.0),
    ]
    found = summary_of(outcomes)
    assert found["with_a_gap"] == 3
    assert found["recovered"]["identified"]["median"] == pytest.approx(0.5)
    assert found["recovered"]["wide"]["median"] == pytest.approx(0.5)
    assert found["worse_than_nominal"] == ["worse"]
    assert found["names_right"] == 4
    assert "identified joint made worse worse" in verdict(found)
    assert found["wide_worse"] == 0
    write_results(outcomes, Plan(tmp_path), 1.0)
    data = read_outcomes(tmp_path)
    assert data["joints"] == outcomes
    assert data["summary"] == found
    page = write_page(tmp_path, data["joints"]).read_text(encoding="utf-8")
    assert "no gap" in page
    assert page.count("<svg") == 1


def test_results_go_into_a_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    outcomes = [outcome("joint_0a", 3.0, 2.0, 1.8, 1.5, 1.0), outcome("joint_1a", *[1.0] * 5)]
    write_results(outcomes, Plan(tmp_path, steps=12_000, more=3000), 1.0)
    document = tmp_path / "page.md"
    names = ("facts", "summary", "joints", "noise")
    marks = [f"<!-- loop: {n} -->old<!-- end of loop: {n} -->" for n in names]
    document.write_text("before\n" + "\n".join(marks) + "\nafter\n", encoding="utf-8")
    given = ["--out", str(tmp_path), "--write-only", "--document", str(document)]
    assert main(given) == 0
    text = document.read_text(encoding="utf-8")
    assert "old" not in text
    assert "12 000 steps on the datasheet, 3 000 more" in text
    assert "| joint_0a | coulomb | coulomb | 3 | 2 | 1.8 | 1.5 | 1 | 50 % |" in text
    assert "| joint_0* | rigid | 5.0 |" in text
    assert (tmp_path / "figures" / "loop.svg").read_text(encoding="utf-8").startswith("<svg")
    document.write_text("no mark", encoding="utf-8")
    assert main(given) == 2
    assert "has no place for loop" in capsys.readouterr().err
    assert main(["--out", str(tmp_path / "none"), "--write-only"]) == 2
    assert "holds no loop.json" in capsys.readouterr().err


def test_folder_of_another_experiment_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(experiment, "hidden_joints", lambda *given: [])
    plan = Plan(tmp_path / "loop", groups=0, steps=1000)
    assert run_experiment(plan) == []
    assert run_experiment(replace(plan, per_group=2, jobs=1)) == []  # which changes no joint
    again = ["--out", str(plan.out), "--steps", "1000"]
    for changed in (["--more", "1"], ["--seed", "2"]):
        assert main([*again, *changed]) == 2
        assert f"differs in {changed[0][2:]}. Choose" in capsys.readouterr().err
    monkeypatch.setattr(experiment, "code_hash", lambda parts: "other")
    with pytest.raises(ConfigurationError, match=r"differs in code\. Choose another folder"):
        run_experiment(plan)
