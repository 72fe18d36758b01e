"""The pages on hardware and emulator: commands and code that needs a bus run, tables are complete.

Their other code runs in `test_pages.py`.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import can
import numpy as np
import pytest

from cjt_gym.canbus.config import CONTROL, TABLES, load_hardware
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.experiments import EXPERIMENTS
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.safety import FAULTS
from cjt_gym.canbus.settings import BUS, EMULATOR, LIMITS
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.cli import main
from cjt_gym.records import Record, read_record, write_record
from tests.canbus.soak import emulator, free_port
from tests.docs.pages import ROOT, blocks, page
from tests.python import run_python

HARDWARE, TUTORIAL, EMULATOR_PAGE = map(page, ("hardware", "tutorials/hardware", "emulator"))
CODE = blocks(HARDWARE + EMULATOR_PAGE)


def test_every_key_experiment_and_fault_is_on_the_page() -> None:
    for name in (*TABLES, *BUS, *CONTROL, *LIMITS, *EMULATOR, *FAULTS, *EXPERIMENTS):
        assert name in HARDWARE, name
    for row in EXPERIMENTS.values():
        assert f"| `{row.name}` | {row.seconds:g} | {row.summary} |" in HARDWARE


@dataclass
class Terminals:
    """A folder in which the commands of the pages run, in order, and the joint on a free port.

    Attributes:
        port: Of the emulated joint.
        emulating: The emulator in the other terminal, which runs until the end.
    """

    port: int
    emulating: ExitStack

    def run(self, line: str) -> int:
        """Run a command of a page: in its own time, so that no machine is too slow for it."""
        words = shlex.split(line)[1:]
        if words[0] == "emulate":
            self.emulating.close()
            self.emulating.enter_context(emulator(Path(words[1]), *words[2:]))
            return 0
        if words[0] == "hardware" and "--arm" in words:
            words[words.index("--arm")] = "--emulated"
            seconds = "3" if "--benchmark" in words else "0.3"
            words = ["steps" if word == "all" else word for word in words]
            words += [] if "--experiment" in words else ["--duration", seconds]
        if words[0] == "train":
            words += ["--steps", "2048", "--quiet"]
        return main(words)


@pytest.fixture
def terminals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminals]:
    port = free_port()
    (tmp_path / "examples" / "hardware").mkdir(parents=True)
    for name in ("joint.toml", "arm.toml"):
        text = (ROOT / "examples" / "hardware" / name).read_text().replace("29536", str(port))
        for place in (tmp_path / "examples" / "hardware", tmp_path):
            (place / name).write_text(text)
    found = tmp_path / "runs" / "found"
    found.mkdir(parents=True)
    t = np.arange(500) * 1e-3
    asked = Record({"t": t, "i_cmd": 0.5 * np.sin(20.0 * t)}, {"t": "s", "i_cmd": "A"})
    write_record(asked, found / "next.npz")
    trace(tmp_path / "joint.toml", tmp_path / "candump.log")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cjt_gym.canbus.dialogue.PATIENCE", 30.0)
    with ExitStack() as emulating:
        yield Terminals(port, emulating)


def trace(config: Path, log: Path) -> None:
    """Write what goes over the bus in a short run."""
    given = load_hardware(config)
    link = VirtualLink(Emulator(given))
    with can.Logger(log) as logger, CanPlant(given, link) as plant:

        def keep(t: float, message: can.Message) -> None:
            message.timestamp, message.channel = 1.7e9 + t, "can0"
            logger.on_message_received(message)

        def pass_on(message: can.Message, node: str, t: float) -> list[can.Message]:
            keep(t, message)
            return [message]

        link.sent, link.emulator.tamper = keep, pass_on
        plant.connect()
        plant.arm()
        plant.reset()
        for _ in range(100):
            plant.step(np.ones(1))


def commands() -> list[str]:
    """Return every command of the pages, in order."""
    shown = blocks(TUTORIAL + HARDWARE + EMULATOR_PAGE, "sh")
    return [line.split("  #")[0] for block in shown for line in block.splitlines()]


LONG = re.compile(r"cjt-gym (train|diagnose|plot)|--policy|--benchmark|--experiment")


def test_commands_run_one_after_the_other(
    terminals: Terminals, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [line for line in commands() if not LONG.search(line)]
    assert len(lines) > 8
    for line in lines:
        assert line.startswith("cjt-gym ")
        assert terminals.run(line) == 0, (line, capsys.readouterr().err)
    shown = capsys.readouterr().out
    assert "Not armed, nothing was moved" in shown
    assert re.search(r"v_bus 48 V\b", shown)
    assert "frames would be sent" in shown
    assert "tau" in read_record("runs/real.csv")


@pytest.mark.slow
def test_all_commands_run_one_after_the_other(
    terminals: Terminals, capsys: pytest.CaptureFixture[str]
) -> None:
    for line in commands():
        if "ppo_residual" in line:
            assert main(["train", "demo", "--steps", "2048", "--quiet", "--out", "early"]) == 0
            Path("early").rename("runs/ppo_residual")
        assert terminals.run(line) == 0, (line, capsys.readouterr().err)
    assert Path("bench/benchmark.txt").exists()


def test_code_for_other_clients_hears_the_emulator(terminals: Terminals) -> None:
    (text,) = [code for code in CODE if "bus.recv" in code]
    terminals.run("cjt-gym emulate joint.toml")
    patient = text.replace("29536", str(terminals.port)).replace("recv(1.0)", "recv(30.0)")
    run = run_python(patient)
    assert run.returncode == 0, run.stderr
    assert "ID:" in run.stdout


def test_code_with_a_record_runs(terminals: Terminals) -> None:
    (text,) = [code for code in CODE if "real.csv" in code]
    words = "cjt-gym hardware joint.toml --arm --controller open_loop --out real.csv"
    assert terminals.run(words) == 0
    run = run_python(text)
    assert run.returncode == 0, run.stderr
