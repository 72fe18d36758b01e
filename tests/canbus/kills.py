"""End `cjt-gym hardware` in every way, over every protocol, and look whether torque outlives it.

    python -m tests.canbus.kills

The command runs in a process of its own against an emulator here, in real time, over socketcand.
The emulated drives' watchdogs are as they leave the factory; only those that no frame can set
(`mit`, `dbc`) were set before, as by the maker's tool.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import can

from cjt_gym.canbus.config import load_hardware
from cjt_gym.canbus.ports import Port, SocketcandPort
from cjt_gym.disk import to_toml
from cjt_gym.records import read_record
from tests.canbus.bench import DRIVES, document
from tests.canbus.soak import MAIN, free_port
from tests.canbus.test_buses import served

WATCHDOG = 0.25
"""Of the drive [s]: wide enough for a busy machine."""
CONTROL = {
    "rate_hz": 200,
    "missed": 40,
    "overrun": {"value": 0.2, "unit": "s"},
    "watchdog": {"value": WATCHDOG, "unit": "s"},
}
ROWS = 8_000
"""Bytes of the record after which a run is ended."""
ROOM = 120_000
"""Bytes that a file may have where the disk is full."""
START, LINGER = 120.0, 0.5
"""How long a run may take to begin, and how much longer than its watchdog torque is watched [s]."""


@dataclass
class Plug:
    """A port that can be unplugged: nothing goes through any more."""

    port: Port
    is_out: bool = False

    @property
    def address(self) -> str:
        return self.port.address

    def send(self, message: can.Message) -> None:
        if not self.is_out:
            self.port.send(message)

    def receive(self, timeout: float) -> Sequence[can.Message]:
        found = self.port.receive(min(timeout, 0.005))
        return [] if self.is_out else found

    def close(self) -> None:
        self.port.close()


@dataclass(frozen=True)
class Ended:
    """What became of a run.

    Attributes:
        before: Torque when it was ended [N m].
        after: Largest torque from the watchdog's time on [N m].
        kind: Fault that its record names, "" for none.
        rows: Rows of its record.
        status: Exit status of the command.
    """

    before: float
    after: float
    kind: str
    rows: int
    status: int


def _full_disk(run: subprocess.Popen[bytes], plug: Plug) -> None:
    """Do nothing: the file may not grow any more."""


def _unplug(run: subprocess.Popen[bytes], plug: Plug) -> None:
    plug.is_out = True


def _signal(number: int) -> Callable[[subprocess.Popen[bytes], Plug], None]:
    return lambda run, plug: os.kill(run.pid, number)


ENDINGS: dict[str, tuple[Callable[[subprocess.Popen[bytes], Plug], None], str]] = {
    "SIGKILL": (_signal(signal.SIGKILL), ""),
    "SIGHUP": (_signal(signal.SIGHUP), "interrupt"),
    "SIGTERM": (_signal(signal.SIGTERM), "interrupt"),
    "SIGINT": (_signal(signal.SIGINT), "interrupt"),
    "SIGQUIT": (_signal(signal.SIGQUIT), "interrupt"),
    "full disk": (_full_disk, "record"),
    "unplugged bus": (_unplug, "missing"),
}
"""Every ending: what is done, and the fault that the record then names."""


def end(protocol: str, ending: str, folder: Path) -> Ended:
    """Run a protocol, end the run in one way, and return what became of it."""
    path, out = folder / f"{protocol}.toml", folder / f"{protocol}-{ending.replace(' ', '-')}.csv"
    bus = {"interface": "socketcand", "channel": "can0", "port": free_port()}
    path.write_text(to_toml(document(bus=bus, drive=DRIVES[protocol], control=CONTROL)))
    given = load_hardware(path)
    plug = Plug(SocketcandPort(port=given.bus.port))
    words = ["hardware", str(path), "--arm", "--controller", "none", "--reference", "smooth"]
    act, _ = ENDINGS[ending]
    with served(given, plug) as joint:
        run = subprocess.Popen(
            [sys.executable, "-c", MAIN, *words, "--duration", "60", "--out", str(out)],
            preexec_fn=_limited if ending == "full disk" else _heeding,
            stderr=subprocess.DEVNULL,
        )
        begin = time.monotonic()
        while not (out.exists() and out.stat().st_size > ROWS and joint.torque):
            if run.poll() is not None or time.monotonic() - begin > START:
                run.kill()
                raise RuntimeError(f"The run over {protocol} did not begin: {run.wait()}.")
            time.sleep(0.01)
        torque = joint.torque
        act(run, plug)
        if ending == "full disk":
            run.wait(START)
        time.sleep(WATCHDOG + 0.05)
        after = 0.0
        watched = time.monotonic() + LINGER
        while time.monotonic() < watched:
            after = max(after, abs(joint.torque))
            time.sleep(0.005)
        status = run.wait(START)
    record = read_record(out)
    fault = record.provenance.get("fault", {"kind": ""})
    return Ended(torque, after, fault["kind"], len(record), status)


def _heeding() -> None:
    """Heed the signals that what runs in the background of a shell or under nohup ignores."""
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, ROOM))


def main() -> int:
    """End runs in every way and print what came of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--protocols", nargs="+", default=list(DRIVES))
    parser.add_argument("--endings", nargs="+", default=list(ENDINGS))
    options = parser.parse_args()
    form, misses = "{:10}{:15}{:>13}{:>12}{:>8}  {}\n", 0
    sys.stdout.write(form.format("protocol", "ending", "before [N m]", "after", "rows", "fault"))
    with tempfile.TemporaryDirectory() as folder:
        for protocol in options.protocols:
            for ending in options.endings:
                found = end(protocol, ending, Path(folder))
                cells = (f"{found.before:.3g}", f"{found.after:.3g}", found.rows, found.kind or "-")
                sys.stdout.write(form.format(protocol, ending, *cells))
                sys.stdout.flush()
                misses += found.after != 0.0
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())
