"""Tuning: limits that are kept, searches that go on, and gain files that every command takes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from cjt_gym.analysis import probe_plant
from cjt_gym.analysis.probe import linear_joint
from cjt_gym.baselines import CONTROLLERS, PdFeedForward, make_controller
from cjt_gym.baselines.gains import choose, read_gains, write_gains
from cjt_gym.baselines.own import OwnController
from cjt_gym.baselines.shipped import designed_gains
from cjt_gym.cli import main
from cjt_gym.errors import CjtGymWarning, ConfigurationError, MissingFileError, UnknownNameError
from cjt_gym.records import read_record
from cjt_gym.training.evaluation.conditions import EVALUATION_SEEDS, realistic_conditions
from cjt_gym.training.evaluation.rollout import ControllerAgent, joint_of
from cjt_gym.training.learning.config import VALIDATION_SEEDS, environment_arguments
from cjt_gym.training.tuning.limits import Assessment, Limits, _by_simulation, _noise, assess
from cjt_gym.training.tuning.problem import HELD_OUT_SEEDS, TUNING_SEEDS, Search
from cjt_gym.training.tuning.tune import to_gains, to_point, tune

JOINT = "orange_80_6000"
GAINS = {"kp": 0.3, "kd": 0.004, "lead": 1.0}
SEARCH = Search("pd_feedforward", JOINT, budget=6, episodes=8)


@pytest.mark.slow
def test_a_search_keeps_the_limits_beats_the_open_loop_and_goes_on(tmp_path: Path) -> None:
    log = tmp_path / "trials.jsonl"
    outcome = tune(SEARCH, log)
    assert outcome.feasible
    assert outcome.best.cost < 1.0
    assert outcome.held_out["tuned"] < 1.0
    assert outcome.assessment.sensitivity_peak <= SEARCH.limits.sensitivity_peak
    lines = log.read_text().splitlines()
    log.write_text("\n".join(lines[:4]) + '\n{"search": "cut o')
    asked: list[int] = []
    again = tune(SEARCH, log, report=lambda done, cost: asked.append(done))
    assert again == outcome
    assert asked[-1] == outcome.trials == 6
    assert sum(json.loads(line)["cost"] < 10.0 for line in lines) > 0


def test_draws_of_tuning_are_apart_from_all_others() -> None:
    seeds = [VALIDATION_SEEDS, TUNING_SEEDS, HELD_OUT_SEEDS, EVALUATION_SEEDS]
    assert seeds == sorted(set(seeds))


def test_points_and_gains_go_to_and_fro() -> None:
    np.testing.assert_allclose(to_point("pd_feedforward", GAINS)[0], (0.3 / 10.0) ** (1 / 3))
    for name, row in CONTROLLERS.items():
        middle = to_gains(name, [0.5] * len(row.searched))
        row.check_gains(middle)
        np.testing.assert_allclose(to_point(name, middle), 0.5, atol=1e-2)
    asked = {"stiffness", "damping"}  # what impedance is to render is not for a search to change
    assert not asked & set(to_gains("impedance", [0.5] * 3))


@pytest.mark.parametrize(
    ("change", "broken"),
    [
        ({}, False),
        ({"gain_margin": 1.5}, True),
        ({"phase_margin": 20.0}, True),
        ({"delay_margin": 5e-4}, True),
        ({"sensitivity_peak": 2.5}, True),
        ({"noise_amplification": 20.0}, True),
        ({"port_share": 0.3}, True),
        ({"port_share": None}, False),
        ({"robust": False}, True),
        ({"stable": False}, True),
    ],
)
def test_every_limit_counts(change: dict[str, float], broken: bool) -> None:
    good = Assessment(True, True, 0.0, 3.0, 45.0, 2e-3, 1.5, 4.0, 0.2, 30.0)
    assert (Limits().violation(replace(good, **change)) > 0.0) == broken


def test_an_unstable_loop_has_no_margins() -> None:
    joint = linear_joint(joint_of(realistic_conditions(JOINT)))
    found = assess(PdFeedForward(0.5, 0.0, 1e-3), joint, probe_plant(joint, 1e-3), 1.0)
    facts = found.to_dict()
    assert facts.pop("growth") > 0.0
    assert facts == {"linear": True, "stable": False}


@pytest.mark.slow
def test_a_law_that_is_not_linear_is_assessed_by_simulation() -> None:
    conditions = realistic_conditions(JOINT)
    joint = joint_of(conditions)
    plant = probe_plant(joint, 1e-3)
    law = PdFeedForward(0.3, 0.004, 1e-3)
    linear = assess(law, joint, plant, conditions.amplitude)
    simulated = _by_simulation(law, linear_joint(joint), 1e-3, conditions.amplitude)
    limited = PdFeedForward(0.3, 0.004, 1e-3, torque_limit=0.3)
    found = assess(limited, joint, plant, conditions.amplitude)
    assert linear.linear
    assert simulated.noise_amplification == pytest.approx(linear.noise_amplification, rel=0.2)
    assert simulated.sensitivity_peak == pytest.approx(linear.sensitivity_peak, rel=0.1)
    assert not found.linear
    assert found.stable
    assert found.port_share is None
    assert found.noise_amplification > 0.0


def test_a_linear_law_of_ones_own_has_margins_and_a_port() -> None:
    joint = linear_joint(joint_of(realistic_conditions(JOINT)))
    plant, law = probe_plant(joint, 1e-3), PdFeedForward(0.3, 0.004, 1e-3)
    own = assess(OwnController(law, "own.py:Own", 1e-3, law.torque_limit), joint, plant, 1.0)
    shipped = assess(law, joint, plant, 1.0)
    assert own.linear
    assert own.phase_margin == pytest.approx(shipped.phase_margin)
    assert own.port_share == pytest.approx(shipped.port_share)
    assert own.noise_amplification == pytest.approx(shipped.noise_amplification, rel=0.2)


@pytest.mark.parametrize("name", ["friction_feedforward", "adaptive_friction"])
def test_friction_is_not_compensated_along_the_noise(name: str) -> None:
    """Also of the load's velocity, whose sign these laws use."""
    joint = joint_of(realistic_conditions(JOINT))
    law = make_controller(name, joint, 1e-3, designed_gains(CONTROLLERS[name], joint, 1e-3))
    assert 1.0 < _noise(law, joint, 1e-3) < Limits().noise_amplification


def test_a_gain_file_serves_wherever_a_controller_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_gains(tmp_path / "soft.toml", "pd_feedforward", GAINS, {"seed": 3})
    choice = choose(str(path))
    assert (choice.name, choice.gains, choice.facts) == ("soft", GAINS, {"seed": 3})
    agent = ControllerAgent(str(path))
    assert (agent.name, agent.kind) == ("soft", "classical")
    law = environment_arguments({"base_controller": str(path)})["base_controller"](
        joint_of(realistic_conditions(JOINT)), 1e-3
    )
    assert (law.kp, law.kd) == (0.3, 0.004)
    out = tmp_path / "run.npz"
    words = ["simulate", JOINT, "--duration", "0.1", "--controller", str(path)]
    assert main([*words, "--json", "--out", str(out)]) == 0
    known = read_record(out).provenance
    assert known["controller"] == "pd_feedforward"
    assert known["gains"] == GAINS
    capsys.readouterr()


def test_python_takes_a_gain_file_for_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_gains(Path("soft.toml"), "pd_feedforward", GAINS, {})
    code = "from cjt_gym.baselines import PdFeedForward, Gain\n"
    code += "def law(joint, dt, kp): return PdFeedForward(kp, 0.0, dt)\n"
    code += "law.tunable = (Gain('kp', '-', 0.0, 2.0, usual=0.4),)\n"
    Path("mine.py").write_text(code, encoding="utf-8")
    write_gains(Path("mine.toml"), "mine.py:law", {"kp": 0.7}, {})
    joint = joint_of(realistic_conditions(JOINT))
    for word, kp in (("soft.toml", 0.3), ("mine.py:law@mine.toml", 0.7)):
        assert make_controller(word, joint, 1e-3).kp == kp
        assert make_controller(word, joint, 1e-3, {"kp": 0.1}).kp == 0.1
        env = gymnasium.make("CJT/TorqueTracking-v0", base_controller=word)
        assert env.unwrapped.episodes.controller.kp == kp
    with pytest.raises(MissingFileError, match=r"The gain file sofd\.toml does not exist"):
        make_controller("sofd.toml", joint, 1e-3)


def test_an_agent_designs_its_controller_once_for_a_joint() -> None:
    make = ControllerAgent("pd_feedforward").base()["base_controller"]
    joint, other = (joint_of(realistic_conditions(name)) for name in (JOINT, "lemon_50_6000"))
    first = make(joint, 1e-3)
    assert make(joint, 1e-3) is first
    assert make(other, 1e-3) is not first
    assert make(joint, 2e-3) is not first


def test_broken_gain_files_and_searches_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "g.toml"
    with pytest.raises(MissingFileError, match=r"g\.toml does not exist"):
        read_gains(path)
    for text, error, says in (
        ("controller =", ConfigurationError, "TOML"),
        ('controller = "pdd"', UnknownNameError, "g.toml"),
        ("gians = 1", ConfigurationError, "'gains'"),
        ('controller = "pd_feedforward"\n[gains]\nkp = 1', ConfigurationError, "value = NUMBER"),
        (
            'controller = "pd_feedforward"\n[gains.kp]\nvalue = 1\nunit = "s"',
            ConfigurationError,
            "must be in -",
        ),
        (
            'controller = "pd_feedforward"\n[gains.kq]\nvalue = 1\nunit = "-"',
            UnknownNameError,
            "kq",
        ),
        (
            'controller = "pd_feedforward"\n[gains.kp]\nvalue = 99\nunit = "-"',
            ConfigurationError,
            "99",
        ),
    ):
        path.write_text(text)
        with pytest.raises(error, match=says):
            read_gains(path)
    with pytest.raises(ConfigurationError, match="no gains to tune"):
        Search("open_loop", JOINT)
    with pytest.raises(UnknownNameError, match="pd_feedforward"):
        Search("pd_feedforwrd", JOINT)
    with pytest.raises(ConfigurationError, match="--budget"):
        Search("pd_feedforward", JOINT, budget=0)
    with pytest.raises(ConfigurationError, match="sensitivity_peak"):
        Limits(sensitivity_peak=0.5)


def test_the_command_writes_a_gain_file_that_says_how_it_was_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "pd.toml"
    words = ["tune", "pd_feedforward", "--joint", JOINT, "--budget", "3", "--seed", "1"]
    words += ["--episodes", "4", "--dt", "0.002"]
    assert main([*words, "--phase-margin", "20", "--json", "--out", str(out)]) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert "candidate" not in captured.err, "a bar is for terminals"
    choice = read_gains(out)
    assert choice.gains == result["gains"]
    assert choice.facts["command"] == (
        "cjt-gym tune pd_feedforward --joint orange_80_6000 --structure "
        "output_fixed_rigid_gearbox --budget 3 --seed 1 --episodes 4 --dt 0.002 "
        "--phase-margin 20 --out pd.toml"
    )
    assert choice.facts["dt"] == 0.002
    assert choice.facts["limits"]["phase_margin"] == 20.0
    assert choice.facts["held_out"]["tuned"] == result["held_out"]["tuned"]
    with pytest.warns(CjtGymWarning, match=f"tuned for {JOINT}, .* used on lemon_50_6000"):
        choice.make(joint_of(realistic_conditions("lemon_50_6000")), 1e-3)
    other = ["tune", "pd", "--joint", JOINT, "--budget", "1", "--out", str(out)]
    assert main(other) == 2
    assert "holds gains of pd_feedforward" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--backend", "rya"], "Did you mean 'ray'"),
        (["--backend", "ray"], "needs --jobs of at least 2"),
    ],
)
def test_a_backend_that_cannot_be_used_is_refused(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "gains.toml")
    assert main(["tune", "pd", "--joint", "orange_80_6000", "--out", out, *words]) != 0
    assert says in capsys.readouterr().err
