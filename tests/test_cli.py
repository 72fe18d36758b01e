"""The command line: results on standard output, one clear line on bad input, exit status."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from argparse import Namespace
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym import EFFECTS, joint_names, read_record
from cjt_gym.cli import COMMANDS, Parser, main
from cjt_gym.commands.train import environment, tell
from cjt_gym.joint import load_joint, load_joint_file, to_toml
from cjt_gym.plant.randomization import resolve_randomization
from cjt_gym.records import Record, record_names, write_record
from cjt_gym.training.learning.config import load_config

SHORT = ["simulate", "orange_80_6000", "--duration", "0.2"]
TUNE = ["tune", "pd_feedforward", "--joint"]
SIMULATE = ("simulate", "orange_80_6000", "--out", "x.csv")
HARDWARE = str(Path(__file__).parents[1] / "examples" / "hardware" / "joint.toml")
NUMBERS = [
    # what no command can take
    (*SIMULATE, "--seed", "-1"),
    (*SIMULATE, "--duration", "nan"),
    (*SIMULATE, "--duration", "-1"),
    (*SIMULATE, "--duration", "inf"),
    (*SIMULATE, "--duration", "1e7"),
    (*SIMULATE, "--dt", "0"),
    (*SIMULATE, "--dt", "nan"),
    (*SIMULATE, "--dt", "1e-300"),
    (*SIMULATE, "--dt-physics", "0"),
    (*SIMULATE, "--amplitude", "nan"),
    (*SIMULATE, "--amplitude", "-5"),
    ("analyse", "orange_80_6000", "--seed", "-1", "--identify", "1", "--json"),
    ("export", "orange_80_6000", "--to", "mujoco", "--timestep", "0", "--out", "x.xml"),
    ("emulate", HARDWARE, "--seconds", "-1"),
    ("emulate", HARDWARE, "--seconds", "nan"),
    ("diagnose", "emps", "--seconds", "nan"),
    ("hardware", HARDWARE, "--seed", "-1", "--dry-run"),
    ("hardware", HARDWARE, "--duration", "nan", "--dry-run"),
]


def test_an_amplitude_beyond_the_peak_torque_is_remarked_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for amplitude in ("20", "900"):
        words = [*SHORT, "--amplitude", amplitude, "--out", str(tmp_path / "x.csv")]
        assert main(words) == 0
        told = "beyond the peak torque of orange_80_6000, 187.2 N m" in capsys.readouterr().err
        assert told == (amplitude == "900")


def test_the_package_runs_as_the_command() -> None:
    words = [sys.executable, "-m", "cjt_gym", "--version"]
    run = subprocess.run(words, capture_output=True, text=True, check=True)
    assert run.stdout.startswith("cjt-gym ")


def test_help_of_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    listed = capsys.readouterr().out
    for name in COMMANDS:
        assert name in listed
        with pytest.raises(SystemExit) as stop:
            main([name, "--help"])
        assert stop.value.code == 0
        assert "--json" in capsys.readouterr().out


def test_joints_lists_every_effect_with_units_and_ranges(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["joints", "--json"]) == 0
    tables = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in tables["joints"]] == list(joint_names())
    assert [row["name"] for row in tables["effects"]] == list(EFFECTS)
    assert [row["name"] for row in tables["records"]] == list(record_names())
    for row in tables["effects"]:
        for parameter in row["parameters"]:
            assert parameter["unit"]
            assert parameter["low"] <= parameter["high"]
    assert main(["joints"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in (*joint_names(), *EFFECTS))
    assert len(text.splitlines()) < 60


def test_joints_shows_a_joint_and_a_file_of_ones_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "sea.toml"
    path.write_text(SEA + "[effects.coulomb]\n", encoding="utf-8")
    assert main(["joints", str(path), "orange_80_6000"]) == 0
    text = capsys.readouterr().out
    assert "k_b       3000 N m/rad" in text
    assert re.search(r" 27\.6 Hz +at which motor and gear swing", text)
    assert "effect coulomb  on" in text
    assert "sensor q_m  resolution 1.19842e-05 rad" in text


def test_joints_shows_the_rows_that_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["joints", "structures", "coulomb", "--json"]) == 0
    tables = json.loads(capsys.readouterr().out)
    assert [len(tables[name]) for name in ("joints", "structures", "effects")] == [0, 5, 1]
    assert main(["joints", "coulomb"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("Effects\n")
    assert "d_cm" in shown


@pytest.mark.parametrize("ending", ["csv", "npz", "parquet"])
def test_simulate_writes_a_record(
    ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"run.{ending}"
    effects = ["--effect", "coulomb", "command_delay.delay=0.001", "cogging.f=480,960"]
    effects += ["cogging.a=0.5,0.1", "cogging.b=0,0"]
    words = [*SHORT, *effects, "--reference", "step", "--seed", "3", "--json", "--out", str(out)]
    assert main(words) == 0
    result = json.loads(capsys.readouterr().out)
    record = read_record(out)
    assert result["samples"] == len(record) == 200
    error = record["tau_ref"] - record["true_tau"]
    assert result["rmse"] == pytest.approx(float(np.sqrt(np.mean(error**2))))
    assert record.seed == 3
    assert record.provenance["effects"]["cogging"]["f"] == [480.0, 960.0]
    again = tmp_path / f"again.{ending}"
    assert main([*words[:-1], str(again)]) == 0
    assert read_record(again) == record


def test_a_record_of_commands_is_replayed_in_open_loop(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    current = np.where(np.arange(300) < 100, 0.0, 3.0)
    known = {"dt": 0.999984e-3, "structure": "output_fixed"}
    write_record(Record({"i_cmd": current}, {"i_cmd": "A"}, **known), tmp_path / "next.npz")
    words = ["simulate", "orange_80_6000", "--reference", str(tmp_path / "next.npz")]
    assert main([*words, "--json", "--out", str(tmp_path / "run.npz")]) == 0
    result = json.loads(capsys.readouterr().out)
    record = read_record(tmp_path / "run.npz")
    assert (result["controller"], result["rmse"], result["samples"]) == ("none", None, 300)
    assert record.structure == "output_fixed"
    assert "tau_ref" not in record
    assert record["i_cmd"] == pytest.approx(current)
    assert main([*words, "--controller", "pd_feedforward", "--out", str(tmp_path / "b.npz")]) == 2
    assert "tau_ref" in capsys.readouterr().err


def test_a_measured_current_is_replayed_past_the_drive(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    current = 3.0 * np.sin(0.03 * np.arange(300))
    known = {"dt": 1e-3, "structure": "output_fixed"}
    found = {}
    for name in ("i", "i_cmd"):
        write_record(Record({name: current}, {name: "A"}, **known), tmp_path / f"{name}.npz")
        words = ["simulate", "orange_80_6000", "--effect", "current_lag=typical", "coulomb"]
        words += ["--reference", str(tmp_path / f"{name}.npz"), "--json"]
        assert main([*words, "--out", str(tmp_path / "run.npz")]) == 0
        effects = json.loads(capsys.readouterr().out)["effects"]
        found[name] = (set(effects), read_record(tmp_path / "run.npz")["true_i"])
    assert found["i"][0] == {"coulomb"}
    assert found["i_cmd"][0] == {"coulomb", "current_lag"}
    with_reference = {"i": current, "tau_ref": current}
    units = {"i": "A", "tau_ref": "N m"}
    write_record(Record(with_reference, units, **known), tmp_path / "tracked.npz")
    words[words.index("--reference") + 1] = str(tmp_path / "tracked.npz")
    assert main([*words, "--out", str(tmp_path / "run.npz")]) == 0
    assert "current_lag" in json.loads(capsys.readouterr().out)["effects"], "it is tracked"
    assert found["i"][1][1:] == pytest.approx(current[:-1])  # in force until the next row
    assert np.abs(found["i_cmd"][1][1:] - current[:-1]).max() > 0.01


def test_the_recorded_reference_is_tracked_and_its_command_can_be_replayed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, again, tracked = (str(tmp_path / f"{name}.npz") for name in ("first", "again", "track"))
    assert main([*SHORT, "--effect", "coulomb", "--out", first]) == 0
    words = ["simulate", "orange_80_6000", "--effect", "coulomb", "--reference", first]
    assert main([*words, "--controller", "none", "--out", again]) == 0
    assert main([*words, "--out", tracked]) == 0
    capsys.readouterr()
    assert read_record(again)["true_tau"] == pytest.approx(read_record(first)["true_tau"], abs=1e-9)
    assert read_record(tracked)["tau_ref"] == pytest.approx(read_record(first)["tau_ref"])


SEA = """
name = "sea"
source = "datasheet"
structure = "output_fixed_rigid_gearbox"
[parameters]
I_m = { value = 0.1, unit = "kg m^2" }
k_b = { value = 3000.0, unit = "N m/rad" }
n = { value = 50.0, unit = "-" }
k_t = { value = 0.05, unit = "N m/A" }
i_p = { value = 20.0, unit = "A" }
d_cm = { value = 1.5, unit = "N m" }
[sensors.tau]
noise = { value = 0.05, unit = "N m" }
"""
NO_OPTIONS = {"joint": None, "structure": None, "drive": None, "effect": None, "randomize": None}


def test_a_joint_from_a_datasheet_keeps_its_friction_in_a_training(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "sea.toml"
    path.write_text(SEA, encoding="utf-8")
    recipe = load_config("ppo_residual").env
    env = environment(recipe, Namespace(**NO_OPTIONS | {"joint": str(path)}))
    tell(env, recipe)
    joint = load_joint(path, env["structure"], effects=env["effects"])
    assert joint.effects["coulomb"]["d_cm"] == 1.5
    assert joint.effects["noise"]["tau"] == 0.05
    assert joint.effects["gear_ripple"]["f"] == (100.0,)
    assert set(env["randomization"]) >= {"I_m", "k_b", "coulomb.d_cm", "gear_ripple.scale"}
    told = capsys.readouterr().err
    assert "effects in force: command_delay" in told
    assert "unlike in the configuration: cogging, quantization" in told
    resolve_randomization(joint, env["randomization"])


def test_a_diagnosed_joint_brings_its_own_effects_to_a_training(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "joint.toml"
    path.write_text(SEA + "[effects.coulomb]\n", encoding="utf-8")
    recipe = {"joint": "orange_80_6000", "effects": {"cogging": {}}, "randomization": "mild"}
    env = environment(recipe, Namespace(**NO_OPTIONS | {"joint": str(path)}))
    assert env == {"joint": str(path), "structure": "output_fixed_rigid_gearbox"}
    tell(env, recipe)
    told = capsys.readouterr().err
    assert "effects in force: coulomb; its file knows, but they are off: noise" in told
    assert "unlike in the configuration: cogging" in told
    assert "Nothing varies" in told
    asked = {"joint": str(path), "randomize": "identified", "effect": ["noise"]}
    env = environment(recipe, Namespace(**NO_OPTIONS | asked))
    assert (env["effects"], env["randomization"]) == ({"noise": {}}, "identified")
    assert environment(recipe, Namespace(**NO_OPTIONS)) == recipe


def test_training_tells_the_structure_of_the_joint_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = to_toml(load_joint_file("orange_80_6000"))
    (tmp_path / "free.toml").write_text(f'structure = "rigid_gearbox"\n{text}')
    tell({"joint": str(tmp_path / "free.toml")}, {})
    assert "(rigid_gearbox, current)" in capsys.readouterr().err


def test_wrong_options_are_one_sentence_each(capsys: pytest.CaptureFixture[str]) -> None:
    for words, end in (
        (["plot", "emps"], "required: --out. See cjt-gym plot --help.\n"),
        (
            [*SHORT, "--duration", "nan", "--out", "x.csv"],
            "got nan. See cjt-gym simulate --help.\n",
        ),
    ):
        with pytest.raises(SystemExit) as stop:
            main(words)
        assert stop.value.code == 2
        assert capsys.readouterr().err.endswith(end)


@pytest.mark.parametrize("command", COMMANDS)
def test_an_option_of_several_values_keeps_all_of_them_when_it_is_repeated(command: str) -> None:
    parser = Parser(prog=command)
    import_module(f"cjt_gym.commands.{command.replace('-', '_')}").add_arguments(parser)
    several = [a for a in parser._actions if a.option_strings and a.nargs in ("+", "*")]
    for action in several:
        given = Namespace(**{action.dest: action.default})
        for values in (["a"], ["b", "c"]):
            action(parser, given, values, action.option_strings[0])
        assert getattr(given, action.dest) == ["a", "b", "c"], action.option_strings
    if command == "diagnose":
        assert {a.dest for a in several} >= {"validate", "controller", "policy"}


def test_effects_in_force_are_stated_and_typical_values_are_offered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "a.npz")]
    assert main([*SHORT, "--effect", "cogging", *out]) == 2
    assert "--effect cogging=typical" in capsys.readouterr().err
    assert main([*SHORT, "--effect", "cogging=typical", "--json", *out]) == 0
    told = capsys.readouterr()
    assert list(json.loads(told.out)["effects"]) == ["cogging"]
    assert "effects in force: cogging; its file knows, but they are off: coulomb" in told.err
    assert main([*SHORT, "--effect", "none", "--randomize", "mild", "--json", *out]) == 0
    assert json.loads(capsys.readouterr().out)["effects"] == {}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["simulat"], "Did you mean 'simulate'"),
        (["--jsn"], "--jsn"),
        (["simulate", "orange", "--out", "x.csv"], "Did you mean 'orange_80_6000'"),
        ([*SHORT, "--structure", "rigit", "--out", "x.csv"], "'rigid'"),
        ([*SHORT, "--effect", "coulom", "--out", "x.csv"], "'coulomb'"),
        ([*SHORT, "--effect", "command_delay.delay=soon", "--out", "x.csv"], "number"),
        ([*SHORT, "--effect", "cogging", "--out", "x.csv"], "cogging.f"),
        ([*SHORT, "--reference", "chrip", "--out", "x.csv"], "'chirp'"),
        ([*SHORT, "--controller", "pd_feedforwrd", "--out", "x.csv"], "'pd_feedforward'"),
        ([*SHORT, "--dt-physics", "3e-4", "--out", "x.csv"], "whole multiple"),
        ([*SHORT, "--out", "x.xyz"], "xyz"),
        ([*SHORT, "--effect", "command_delay.delay=5", "--out", "x.csv"], "100 control steps"),
        (SHORT, "--out"),
        (["simulate", "nowhere.toml", "--out", "x.csv"], "nowhere.toml"),
        (["train", "nowhere.toml", "--out", "run"], "nowhere.toml"),
        (["train", "demo", "--joint", "nowhere.toml", "--out", "run"], "nowhere.toml"),
        ([*SHORT, "--controller", "none", "--out", "x.csv"], "replays the command"),
        (["benchmark", "--joint", "orange_80_6000", "--out", "b"], "--controller or --policy"),
        (["benchmark", "--joint", "orange_80_6000", "--policy", "no", "--out", "b"], "no"),
        (["joints", "coulom"], "Did you mean 'coulomb'"),
        ([*TUNE, "orange", "--out", "x.toml"], "Did you mean 'orange_80_6000'"),
        ([*TUNE, "orange_80_6000", "--out", "x.json"], "--out must end in .toml"),
        ([*TUNE, "orange_80_6000", "--out", "x.toml", "--phase-margin", "500"], "<= 90 deg"),
        (["analyse", "orange_80_6000", "--identify", "1e6", "--json"], "187.2 N m, the peak"),
        (["datasheet", "orange_80_6000", "--out", "/proc/x.pdf"], "/proc/x.pdf cannot be used"),
        (["datasheet", "orange_80_6000"], "--out FILE is needed"),
        (["datasheet", "orange_80_6000", "--out", "sheet.doc"], ".pdf, .html, .png"),
        (["datasheet", "orange_80_6000", "emps", "--out", "sheet.pdf"], "same kind of axis"),
        (["datasheet", "orange_80", "--json"], "Did you mean"),
        (["datasheet", "emps", "emps", "--json"], "got emps twice"),
        (["plot", "emps", "--out", "x.gif"], "--out must end in .html"),
        (["plot", "emps", "--out", "x.png", "--columns", "q_n"], "Did you mean 'q_m'"),
        (["plot", "emps", "--out", "x.png", "--between", "5", "4"], "must hold samples"),
        (["plot", "nothing.csv", "--out", "x.png"], "no file nothing.csv"),
        *((words, "cjt-gym") for words in NUMBERS),
    ],
)
def test_bad_input_is_one_clear_line_and_status_2(
    words: Sequence[str],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["cjt-gym", *words])
    try:
        status: Any = main(words)
    except SystemExit as stop:
        status = stop.code
    output = capsys.readouterr()
    assert status == 2
    assert says in output.err
    assert output.err.startswith("cjt-gym")
    assert output.err.count("\n") == 1
    assert not output.out
    assert list(tmp_path.iterdir()) == []


def test_memory_that_there_is_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def much(options: object) -> None:
        raise MemoryError

    monkeypatch.setattr("cjt_gym.commands.joints.run", much)
    assert main(["joints"]) == 1
    assert "not enough memory" in capsys.readouterr().err


def test_the_installed_command_answers_and_survives_a_closed_pipe() -> None:
    command = str(Path(sys.executable).with_name("cjt-gym"))
    version = subprocess.run([command, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.startswith("cjt-gym ")
    piped = subprocess.run(
        f"{command} joints | head -1", shell=True, capture_output=True, text=True, check=True
    )
    assert piped.stdout == "Joints\n"
    assert "rror" not in piped.stderr  # a slow machine may say there that it is loading
