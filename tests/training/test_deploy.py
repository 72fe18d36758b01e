"""Exported policies do what torch does, with their history inside, and drive a joint on a bus."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.errors import CjtGymError, UnknownNameError
from cjt_gym.training.deploy.c_header import c_header
from cjt_gym.training.deploy.export import TOLERANCE, CStepper, export_policy, recorded
from cjt_gym.training.deploy.exported import load_exported, save_exported
from cjt_gym.training.deploy.fast_policy import exported
from cjt_gym.training.deploy.onnx_file import OnnxStepper, write_onnx
from cjt_gym.training.deploy.stepper import Stepper
from cjt_gym.training.learning.algorithms import make_environment, make_model
from cjt_gym.training.learning.config import PolicyConfig, TrainConfig
from cjt_gym.training.learning.policy import PolicyAgent, agent_of, load_policy
from cjt_gym.training.learning.run_folder import RunFolder

FORMS = [
    "numpy",
    "onnx",
    pytest.param(
        "c",
        marks=pytest.mark.skipif(
            not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="there is no C compiler"
        ),
    ),
]


def agent_for(tiny: TrainConfig, algorithm: str, activation: str, **env: object) -> PolicyAgent:
    """Return a policy that was not trained, with statistics of some observations."""
    options = {"buffer_size": 100} if algorithm in ("SAC", "TQC") else tiny.algorithm_options
    policy = PolicyConfig(net_arch=(16, 8), activation=activation, lstm_hidden_size=8)
    given = {**tiny.env, **env}
    config = replace(tiny, algorithm=algorithm, policy=policy, algorithm_options=options, env=given)
    environment = make_environment(config)
    environment.reset()
    for _ in range(20):
        environment.step(np.zeros((config.num_envs, 1), np.float32))
    return agent_of("one", config, make_model(config, environment), environment)


def stepper_of(form: str, agent: PolicyAgent, folder: Path) -> Stepper | OnnxStepper | CStepper:
    policy = exported(agent)
    if form == "numpy":
        stepper = Stepper(load_exported(save_exported(policy, folder / "p.npz")))
        assert repr(stepper) == "<Stepper of the policy p: dt = 0.001 s>"
        return stepper
    if form == "onnx":
        return OnnxStepper(write_onnx(policy, folder / "p.onnx"))
    return CStepper(c_header(policy), policy.layout)


def gives_what_torch_gives(form: str, agent: PolicyAgent, folder: Path) -> None:
    stepper = stepper_of(form, agent, folder)
    inputs, wanted = recorded(agent)
    assert np.ptp(wanted) > 1e-3 * agent.layout.action
    for _ in range(2):  # a second episode begins without the past of the first
        stepper.reset()
        found = np.array([stepper.step(*row) for row in inputs])
        np.testing.assert_allclose(found, wanted, atol=TOLERANCE * agent.layout.action)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("algorithm", "activation"), [("PPO", "tanh"), ("SAC", "relu"), ("TQC", "elu")]
)
def test_every_form_gives_what_torch_gives(
    form: str, algorithm: str, activation: str, tiny: TrainConfig, tmp_path: Path
) -> None:
    agent = agent_for(tiny, algorithm, activation, preview=2, history=5)
    gives_what_torch_gives(form, agent, tmp_path)


@pytest.mark.parametrize("form", FORMS)
def test_the_numbers_of_the_datasheet_are_inside(
    form: str, tiny: TrainConfig, tmp_path: Path
) -> None:
    agent = agent_for(tiny, "PPO", "tanh", history=5, observe_joint=True)
    gives_what_torch_gives(form, agent, tmp_path)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("base", [None, "pid+reference", "lqg"])
def test_an_export_is_the_whole_controller(
    form: str, base: str | None, tiny: TrainConfig, tmp_path: Path
) -> None:
    """Base law, its limit and its memory are inside, so that nothing has to be added."""
    agent = agent_for(tiny, "PPO", "tanh", base_controller=base, preview=1)
    gives_what_torch_gives(form, agent, tmp_path)


@pytest.mark.parametrize("form", FORMS)
def test_an_export_takes_its_path_as_text(form: str, tmp_path: Path) -> None:
    written = export_policy("orange_residual", form, str(tmp_path / "policy.npz"))
    assert written.path == tmp_path / "policy.npz"
    assert written.path.is_file()


def test_an_unknown_form_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'onnx'"):
        export_policy("orange_residual", "onx", tmp_path / "policy.onnx")


def test_base_with_friction_goes_to_c_and_is_refused_elsewhere(
    tiny: TrainConfig, tmp_path: Path
) -> None:
    agent = agent_for(tiny, "PPO", "tanh", base_controller="friction_feedforward")
    policy = exported(agent)
    with pytest.raises(CjtGymError, match="not a linear law that ONNX can hold: export it with"):
        write_onnx(policy, tmp_path / "p.onnx")
    path = save_exported(policy, tmp_path / "p.npz")
    with pytest.raises(CjtGymError, match="not a linear law that Stepper can hold"):
        Stepper(load_exported(path))
    assert "policy_base_step(" in c_header(policy)


def test_an_input_that_never_varied_in_training_has_no_effect(
    tiny: TrainConfig, tmp_path: Path
) -> None:
    agent = agent_for(tiny, "PPO", "tanh")  # its load stands still
    policy = load_exported(save_exported(exported(agent), tmp_path / "p.npz"))
    alone = replace(policy, base=None, config=replace(policy.config, env={}))
    still, moved = (
        Stepper(alone).step([1.0], 0.5, 0.1, 0.1, 0.0, 0.0, 0.0, v) for v in (0.0, 2e-3)
    )
    assert still == moved
    seen = agent_observation(agent)
    disturbed = seen.copy()
    disturbed[:, policy.layout.head + 2] += 2e-3
    np.testing.assert_array_equal(agent.act(seen), agent.act(disturbed))


def agent_observation(agent: PolicyAgent) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.normal(size=(4, agent.layout.size)).astype(np.float32)


@pytest.mark.parametrize("form", FORMS)
def test_signals_beyond_the_box_are_limited(form: str, tiny: TrainConfig, tmp_path: Path) -> None:
    agent = agent_for(tiny, "PPO", "tanh")
    stepper, torch_one = stepper_of(form, agent, tmp_path), Stepper(exported(agent))
    for k in range(12):
        far = 100.0 * agent.layout.torque * (-1.0) ** k
        fast = 1e3 * agent.layout.velocity
        row = ([far], -far, 3.0 * k, 3.0 * k, 0.0, fast, fast, -far)
        assert abs(stepper.step(*row) - torch_one.step(*row)) < TOLERANCE * agent.layout.action


def test_layout_of_another_network_is_refused(tiny: TrainConfig) -> None:
    policy = exported(agent_for(tiny, "PPO", "tanh"))
    with pytest.raises(CjtGymError, match="its layout makes"):
        replace(policy, layout=replace(policy.layout, history=policy.layout.history + 1))


def test_recurrent_policy_is_not_exported(tiny: TrainConfig) -> None:
    agent = agent_for(tiny, "RecurrentPPO", "tanh")
    with pytest.raises(CjtGymError, match="not a chain of linear layers"):
        exported(agent)


@pytest.mark.parametrize("form", ["numpy", "onnx", "c"])
@pytest.mark.parametrize("policy", [None, "orange_residual"])
def test_command_writes_tries_and_tells(
    policy: str | None,
    form: str,
    finished: RunFolder,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / {"numpy": "mine.npz", "onnx": "mine.onnx", "c": "mine.h"}[form]
    words = ["export", policy or str(finished.path), "--to", form, "--out", str(out), "--json"]
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert out.is_file()
    assert told["error"] is None or told["error"] < TOLERANCE
    if form == "c":
        assert "mine_step(mine_state *state" in out.read_text(encoding="utf-8")


def test_a_name_that_nothing_has_is_told_from_its_neighbour(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--to", "c", "--out", str(tmp_path / "x.h")]
    for wrong, right in (("kalmn", "kalman"), ("orange_residul", "orange_residual")):
        assert main(["export", wrong, *words]) == 2
        assert f"Did you mean '{right}'" in capsys.readouterr().err


def test_names_units_and_gains_are_in_the_file(finished: RunFolder, tmp_path: Path) -> None:
    policy = exported(load_policy(finished.path))
    facts = OnnxStepper(write_onnx(policy, tmp_path / "p.onnx")).facts
    inputs = {row["name"]: row for row in facts["inputs"]}
    assert inputs["dq_m"]["unit"] == "rad/s"
    assert inputs["q_m"]["used"]
    assert not inputs["dq_l"]["used"]  # the load of that training stands still
    assert facts["base"]["controller"] == "pd_feedforward"
    assert facts["base"]["gains"]["kp"] > 0.0
    assert facts["output"]["limit"] == policy.limit
    text = c_header(policy)
    for told in ("pd_feedforward", "dq_l:      load velocity [rad/s]; not used", "kp = "):
        assert told in text


def test_export_is_compared_on_recorded_signals(
    finished: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record, out = str(tmp_path / "r.csv"), tmp_path / "mine.npz"
    simulate = ["simulate", "orange_80_6000", "--structure", "output_fixed_rigid_gearbox"]
    simulate += ["--reference", "chirp", "--controller", "pd", "--duration", "0.2", "--out", record]
    assert main(simulate) == 0
    capsys.readouterr()
    words = ["export", str(finished.path), "--to", "numpy", "--out", str(out), "--json"]
    assert main([*words, "--check", record]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["steps"] == 60 + 200
    assert told["error"] < TOLERANCE
    assert main([*words, "--check", "emps"]) == 2
    assert "lacks" in capsys.readouterr().err


@pytest.mark.slow
def test_exported_policy_is_an_agent_like_its_run(
    finished: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = save_exported(exported(load_policy(finished.path)), tmp_path / "exported.npz")
    words = ["benchmark", "--joint", "orange_80_6000", "--policy", str(finished.path), str(path)]
    words += ["--task", "step", "--episodes", "2", "--out", str(tmp_path / "out"), "--json"]
    assert main(words) == 0
    rows = json.loads(capsys.readouterr().out)
    assert rows[0]["rmse"] == pytest.approx(rows[1]["rmse"], rel=1e-4)


def test_file_of_somebody_else_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.npz"
    np.savez(other, weights=np.zeros(3))
    for path, text in ((other, "not a policy that cjt-gym exported"), ("gone.npz", "not exist")):
        words = ["benchmark", "--joint", "orange_80_6000", "--policy", str(path)]
        assert main([*words, "--out", str(tmp_path / "out")]) == 2
        assert text in capsys.readouterr().err
