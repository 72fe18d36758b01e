"""Commands say what they do, refuse wrong names at once, and compile ahead where asked to."""

from __future__ import annotations

import io
import sys
import threading
import time
from pathlib import Path

import gymnasium as gym
import pytest
from numba.core import event

from cjt_gym import cli
from cjt_gym.cli import COMMANDS, main
from cjt_gym.console import alive
from cjt_gym.gap import diagnose
from cjt_gym.joint.kernel import compiling
from cjt_gym.joint.kernel.compiling import Notice, while_compiling
from cjt_gym.records import read_record
from tests.python import run_python


def impatient(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """Let a sign of life come at once, and return where it goes."""
    stream = io.StringIO()
    monkeypatch.setattr(alive, "SILENCE", 0.0)
    monkeypatch.setattr(sys, "stderr", stream)
    return stream


def wait_for(text: str, stream: io.StringIO) -> None:
    end = time.monotonic() + 30.0
    while text not in stream.getvalue():
        assert time.monotonic() < end, stream.getvalue()
        time.sleep(0.01)


def test_a_silent_command_says_what_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = impatient(monkeypatch)
    with alive.Alive() as signs:
        signs.doing = "thinking"
        wait_for("cjt-gym: thinking ....", stream)
        sys.stderr.write("found it\n")
    assert "\nfound it\n" in stream.getvalue()  # on a line of its own
    assert sys.stderr is stream


def test_a_bar_is_updated_while_it_is_refreshed(monkeypatch: pytest.MonkeyPatch) -> None:
    impatient(monkeypatch)
    refreshing, updated = threading.Event(), threading.Event()

    class Bar:
        disable = False

        def refresh(self) -> None:
            refreshing.set()
            updated.wait(30.0)

    monkeypatch.setattr(alive, "_bars", lambda: [Bar()])
    with alive.Alive():
        assert refreshing.wait(30.0)
        update = threading.Thread(target=sys.stderr.write, args=("50 %",), daemon=True)
        update.start()
        update.join(10.0)
        waits = update.is_alive()
        updated.set()
    assert not waits


def test_a_command_that_goes_on_is_left_alone_after_its_first_word(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stream = impatient(monkeypatch)
    with alive.Alive(until_a_word=True) as signs:
        wait_for("loading", stream)
        sys.stdout.write("serving\n")
        signs._thread.join(30.0)
        assert not signs._thread.is_alive()


@pytest.mark.parametrize("command", COMMANDS)
def test_only_what_waits_for_others_may_be_silent(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def told(until_a_word: bool) -> alive.Alive:
        asked.append(until_a_word)
        return alive.Alive(until_a_word)

    monkeypatch.setattr(cli, "Alive", told)
    monkeypatch.setattr(sys, "argv", ["cjt-gym", command, "--help"])
    with pytest.raises(SystemExit):
        main()
    assert asked == [command == "emulate"]


def test_compiling_is_said_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    with alive.Alive() as signs:
        signs.watch_compiler()
        with event.trigger_event("numba:compile", data={}):
            assert stream.getvalue().startswith("cjt-gym: compiling, up to two minutes")
            with event.trigger_event("numba:compile", data={}):
                pass
            assert "compiling" in signs.doing
        assert signs.doing == alive.WORKING


def test_python_programs_are_told_of_a_long_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    notice = Notice()
    monkeypatch.setattr(compiling, "SILENCE", 60.0)
    notice(True)
    notice(False)
    assert stream.getvalue() == ""
    monkeypatch.setattr(compiling, "SILENCE", 0.0)
    notice(True)
    wait_for("cjt_gym: compiling, up to two minutes", stream)
    wait_for(" ....", stream)
    notice(False)
    wait_for("\n", stream)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["benchmark", "--joint", "generic", "--polcy", "x", "--out", "y"], "--policy"),
        (["tune", "pid", "--joint", "generic", "--gain-margn=3"], "--gain-margin"),
        (["benchmark", "--joint", "generic", "--controller", "pd", "lqgg", "--out", "x"], "lqg"),
        (["simulate", "generic", "--out", "x.csv", "--controller=pd_fedforward"], "pd_feedforward"),
        (["tune", "pidd", "--joint", "generic", "--out", "x.toml"], "pid"),
        (["analyse", "--joint", "orange_80_600", "--out", "x.html"], "orange_80_6000"),
        (["simulate", "orange_80_600", "--out", "x.csv"], "orange_80_6000"),
    ],
)
def test_a_misspelt_name_is_refused_with_a_suggestion(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(words)
    except SystemExit as error:
        status = error.code
    assert status == 2
    assert f"'{told}'" in capsys.readouterr().err


@pytest.mark.slow
def test_train_checks_its_words_before_it_loads_torch() -> None:
    program = (
        "import sys; from cjt_gym.cli import main; status = main(sys.argv[1:]);"
        "sys.exit(9 if 'torch' in sys.modules else status)"
    )
    words = ["train", "ppo_residul", "--out", "x"]
    run = run_python(program, *words)
    assert run.returncode == 2
    assert "ppo_residul" in run.stderr


@pytest.mark.slow
def test_after_a_warm_up_nothing_is_left_to_compile(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["warm-up"]) == 0
    assert "Everything is compiled" in capsys.readouterr().out
    compiled: list[bool] = []
    while_compiling(compiled.append)
    record = str(tmp_path / "r.csv")
    words = ["simulate", "orange_80_6000", "--structure", "full_dynamics", "--duration", "0.3"]
    words += ["--effect", "coulomb", "backlash=typical", "cogging=typical", "--randomize", "mild"]
    assert main([*words, "--out", record]) == 0
    envs = gym.make_vec("CJT/RigidGearbox-v0", num_envs=5, effects=["coulomb", "quantization"])
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    assert diagnose(read_record("emps").slice(0, 4000)).verdict
    assert compiled == []
