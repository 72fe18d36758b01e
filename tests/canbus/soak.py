"""Run a controller for long against an emulator in another process, and tell how regular it was.

    python -m tests.canbus.soak --seconds 3600 --rate 1000 --priority 40

The emulator serves socketcand on this machine; the loop runs PD control of a smooth reference and
writes its record. A fault ends a run; the next one begins, and its kind is counted. Witnesses
(`tests.canbus.witness`) tell how long each processor stood still for everybody: a fault within such
a stall is the machine's, any other is ours, and only the latter make the soak fail.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines import Controller
from cjt_gym.canbus.config import HardwareConfig, load_hardware
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.safety import HardwareFault
from cjt_gym.canbus.timing import PERCENTILES
from cjt_gym.disk import to_toml
from cjt_gym.errors import ConfigurationError, HardwareError
from cjt_gym.hardware.delayed_law import law_for
from cjt_gym.signals import make_signals
from tests.canbus.bench import DRIVES, document
from tests.canbus.witness import Witnesses

MAIN = "import sys; from cjt_gym.cli import main; sys.exit(main())"
AMPLITUDE = 10.0
PIECE = 10.0
"""Length of the reference, which is repeated [s]."""
AROUND_FAULT = 0.1
"""How far a stall of the machine may be from the step that ended in a fault to be its cause [s]."""
SHARE = 0.75
"""Share of the allowed lateness that such a stall must take."""


def free_port() -> int:
    """Return a TCP port that nobody listens on."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@contextmanager
def emulator(path: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    """Run `cjt-gym emulate` on a configuration, ready to be connected to."""
    words_of_all = ["emulate", str(path), "--json", *words]
    process = subprocess.Popen(
        [sys.executable, "-c", MAIN, *words_of_all], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        if not process.stdout.readline():
            raise ConfigurationError("The emulator did not start.")
        yield process
    finally:
        process.terminate()
        try:
            process.communicate(timeout=30.0)
        except subprocess.TimeoutExpired:  # on a busy machine: what was measured counts
            process.kill()
            process.communicate()


@dataclass
class Tally:
    """What came of all runs of a soak.

    Attributes:
        steps: Control steps.
        rows: Rows of the records on disk; a fault that ends a run adds one.
        zeros: Faults that ended a run.
        squares: Sum of the squared tracking errors [N^2 m^2].
        faults: When and why runs ended before their time [s].
        times: Times of every control step, by name [s].
    """

    steps: int = 0
    rows: int = 0
    zeros: int = 0
    squares: float = 0.0
    faults: list[tuple[float, str]] = field(default_factory=list)
    times: dict[str, list[NDArray[np.float64]]] = field(default_factory=dict)

    def add(self, plant: CanPlant, record: Path) -> None:
        """Add a run that has ended."""
        given = {name: np.array(values) for name, values in vars(plant.joint.timing).items()}
        for name, values in given.items():
            self.times.setdefault(name, []).append(values)
        self.steps += len(given["lateness"])
        if record.exists():
            with record.open("rb") as file:
                self.rows += sum(1 for _ in file) - 1
            record.unlink()
            record.with_suffix(".toml").unlink()

    def of(self, name: str) -> NDArray[np.float64]:
        """Return the times of one kind of all runs [s]."""
        return np.concatenate(self.times.get(name, [np.zeros(0)]))


def soak(
    given: HardwareConfig, seconds: float, controller: str, folder: Path, served_by: int
) -> dict[str, Any]:
    """Run so long and return what was counted and measured.

    Args:
        given: The joint on its bus.
        seconds: How long, counted from the first control step [s].
        controller: What controls it.
        folder: Where the record lies meanwhile.
        served_by: Number of the emulator's process.
    """
    (signal,) = make_signals("smooth", AMPLITUDE)
    reference = signal.torque(np.arange(round(PIECE / given.dt)) * given.dt)
    tally, witnesses = Tally(), Witnesses()
    law = _warm_up(given, controller, reference)
    above = None if given.priority is None else min(given.priority + 1, 99)
    seen_on = sorted(_processors(os.getpid()) | _processors(served_by))
    end = time.monotonic() + seconds
    used = np.array([cpu_time(os.getpid()), cpu_time(served_by)])
    with witnesses.watching(folder, seen_on, above):
        while time.monotonic() < end:
            record, seen = folder / "soak.csv", time.perf_counter()
            plant = CanPlant(given, record=record)
            try:
                with plant:
                    plant.connect()
                    plant.arm()
                    measured = plant.reset()
                    law.reset()
                    k = 0
                    while time.monotonic() < end:
                        seen = time.perf_counter()
                        wanted = reference[k % len(reference) :][:1]
                        error = float(wanted[0] - measured.tau[0])
                        tally.squares += error * error
                        measured = plant.step(law.act(measured, wanted), float(wanted[0]))
                        k += 1
            except HardwareError as error:
                tally.faults.append((seen, str(error)))  # closing takes some time, too
                tally.zeros += isinstance(error, HardwareFault)
            tally.add(plant, record)
        used = (np.array([cpu_time(os.getpid()), cpu_time(served_by)]) - used) / seconds
    faults = [_fault(t, text, given.overrun, witnesses) for t, text in tally.faults]
    return {
        "seconds": seconds,
        "rate_hz": round(1.0 / given.dt),
        "protocol": given.drive.protocol,
        "controller": controller,
        "priority": given.priority,
        "steps": tally.steps,
        "rows_missing": tally.steps + tally.zeros - tally.rows,
        "rmse": float(np.sqrt(tally.squares / max(tally.steps, 1))),
        "faults": faults,
        "faults_of_ours": sum(not fault["of_the_machine"] for fault in faults),
        "stalls_ms": [round(1e3 * (b - a), 1) for a, b in witnesses.stalls],
        "cpu_of_loop": round(float(used[0]), 3),
        "cpu_of_emulator": round(float(used[1]), 3),
        **{f"{name}_us": _percentiles(tally.of(name)) for name in ("lateness", "ages", "answers")},
    }


def _fault(t: float, text: str, allowance: float, witnesses: Witnesses) -> dict[str, Any]:
    """Return when and why a run ended, and how long the machine stood still about then."""
    stall = witnesses.longest(t - AROUND_FAULT, t + AROUND_FAULT)
    of_the_machine = stall > SHARE * allowance
    return {"text": text, "stall_ms": round(1e3 * stall, 1), "of_the_machine": of_the_machine}


def _warm_up(given: HardwareConfig, controller: str, reference: NDArray[np.float64]) -> Controller:
    """Return a controller for the delay as it is; let everything be compiled; nothing moves."""
    with CanPlant(given) as plant:
        plant.connect()
        law = law_for(controller, given.joint, given.dt, plant.whole.measured_delays()[0])
        plant.arm()
        law.act(plant.reset(), reference[:1])
    return law


def _processors(process: int) -> set[int]:
    """Return the processors that a process may use; none where the system cannot say."""
    return os.sched_getaffinity(process) if hasattr(os, "sched_getaffinity") else set()


def cpu_time(process: int) -> float:
    """Return the processor time that a process has used [s], NaN where the system cannot say."""
    stat = Path(f"/proc/{process}/stat")
    if not stat.exists():
        return float("nan")
    words = stat.read_text().rsplit(")", 1)[1].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def _percentiles(values: NDArray[np.float64]) -> dict[str, float]:
    if not len(values):
        return {}
    found = np.percentile(values, PERCENTILES) * 1e6
    return {f"p{p:g}": round(float(v), 1) for p, v in zip(PERCENTILES, found, strict=True)}


def soaked(
    seconds: float,
    rate: float,
    priority: int | None = None,
    protocol: str = "mit",
    allowance: float = 0.02,
    controller: str = "pd_feedforward",
    cpus: Sequence[int] = (),
) -> dict[str, Any]:
    """Serve an emulated joint in another process, run against it, and return the result.

    Args:
        seconds: How long [s].
        rate: Of the loop [Hz].
        priority: Real-time priority of both processes, or None.
        protocol: What the drive speaks.
        allowance: Time by which command and reports may be late before that is a fault [s].
        controller: What controls the joint.
        cpus: Processors to which loop and emulator are bound, or none.
    """
    time_ = {"value": allowance, "unit": "s"}
    missed = min(100, round(allowance * rate))
    control = {"rate_hz": rate, "missed": missed, "overrun": time_, "watchdog": time_}
    if priority is not None:
        control["priority"] = priority
    bus = {"interface": "socketcand", "channel": "can0", "port": free_port()}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "joint.toml"
        path.write_text(to_toml(document(bus=bus, drive=DRIVES[protocol], control=control)))
        with emulator(path) as process:
            for number, cpu in zip((0, process.pid), cpus, strict=False):
                os.sched_setaffinity(number, {cpu})
            return soak(load_hardware(path), seconds, controller, Path(folder), process.pid)


def main() -> None:
    """Run and print the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--rate", type=float, default=1000.0, help="[Hz]")
    parser.add_argument("--priority", type=int, help="real-time priority of both processes")
    parser.add_argument("--protocol", default="mit", choices=list(DRIVES))
    text = "bind loop and emulator to a processor each"
    parser.add_argument("--cpus", type=int, nargs=2, default=[], metavar="CPU", help=text)
    options = parser.parse_args()
    logging.getLogger("can").setLevel(logging.ERROR)  # which warns of frames that come in pieces
    o = options
    result = soaked(o.seconds, o.rate, o.priority, o.protocol, cpus=o.cpus)
    sys.stdout.write(json.dumps(result, indent=1) + "\n")
    sys.exit(1 if result["faults_of_ours"] or result["rows_missing"] else 0)


if __name__ == "__main__":
    main()
