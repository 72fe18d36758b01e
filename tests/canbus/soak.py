"""Run a controller for long against an emulator in another process, and tell how regular it was.

    python -m tests.canbus.soak --seconds 3600 --rate 1000 --priority 40

The emulator serves socketcand on this machine; the loop runs PD control of a smooth reference and
writes its record. A fault ends a run; the next one begins, and its kind is counted. Beside the
percentiles stand the worst seconds, with the time that the host of a virtual machine took from it
in each (steal) and how busy its processors were. Witnesses (`tests.canbus.witness`) tell how long
each processor stood still for everybody: a fault within such a stall is the machine's, any other is
ours, and only the latter make the soak fail.
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
import threading
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
WORST = 5
"""Seconds that are shown one by one."""
STAT = Path("/proc/stat")
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
class Machine:
    """What the processors did, looked at once per second; nothing where the system cannot say.

    Attributes:
        looks: Time [s], busy, idle and stolen time of all processors since they started [s].
    """

    looks: list[tuple[float, float, float, float]] = field(default_factory=list)

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Look while the code within runs."""
        stopped = threading.Event()

        def look() -> None:
            while True:
                self._look()
                if stopped.wait(1.0):
                    return

        thread = threading.Thread(target=look, name="machine", daemon=True)
        if STAT.exists():
            thread.start()
        try:
            yield
        finally:
            stopped.set()
            if thread.is_alive():
                thread.join()
            self._look()

    def _look(self) -> None:
        if STAT.exists():
            now, words = time.perf_counter(), STAT.read_text().split("\n", 1)[0].split()[1:9]
            user, nice, system, idle, waiting, *interrupts, steal = (
                int(word) / os.sysconf("SC_CLK_TCK") for word in words
            )
            busy = user + nice + system + sum(interrupts)
            self.looks.append((now, busy, idle + waiting, steal))

    def shares(self) -> dict[str, float]:
        """Return the shares of the processors' time that were busy and stolen."""
        if len(self.looks) < 2:
            return {}
        _, busy, idle, steal = np.subtract(self.looks[-1], self.looks[0])
        total = max(busy + idle + steal, 1e-9)
        return {"busy": round(busy / total, 4), "steal": round(steal / total, 4)}

    def at(self, t: float) -> dict[str, float]:
        """Return what the processors did in the second of a time [s]."""
        looks = np.array(self.looks)
        if len(looks) < 2:
            return {}
        k = int(np.clip(np.searchsorted(looks[:, 0], t) - 1, 0, len(looks) - 2))
        _, busy, idle, steal = looks[k + 1] - looks[k]
        return {
            "second": round(float(looks[k, 0] - looks[0, 0]), 1),
            "steal_ms": round(float(steal) * 1e3),
            "busy": round(float(busy / max(busy + idle + steal, 1e-9)), 3),
        }

    def worst(
        self, times: NDArray[np.float64], lateness: NDArray[np.float64]
    ) -> list[dict[str, float]]:
        """Return the seconds with the latest commands, the latest first."""
        looks = np.array(self.looks)
        if len(looks) < 2:
            return []
        at = np.clip(np.searchsorted(looks[:, 0], times) - 1, 0, len(looks) - 2)
        most = np.zeros(len(looks) - 1)
        np.maximum.at(most, at, lateness)
        return [
            {"latest_us": round(float(most[k]) * 1e6, 1), **self.at(looks[k + 1, 0])}
            for k in np.argsort(most)[::-1][:WORST]
        ]


@dataclass
class Tally:
    """What came of all runs of a soak.

    Attributes:
        steps: Control steps.
        rows: Rows of the records on disk; a fault that ends a run adds one.
        zeros: Faults that ended a run.
        squares: Sum of the squared tracking errors [N^2 m^2].
        faults: When and why runs ended before their time [s].
        times: Times of every control step, by name [s]; "at" is its deadline.
    """

    steps: int = 0
    rows: int = 0
    zeros: int = 0
    squares: float = 0.0
    faults: list[tuple[float, str]] = field(default_factory=list)
    times: dict[str, list[NDArray[np.float64]]] = field(default_factory=dict)

    def add(self, began: float, plant: CanPlant, record: Path) -> None:
        """Add a run that has ended."""
        given = {name: np.array(values) for name, values in vars(plant.joint.timing).items()}
        given["at"] = began + plant.dt * np.arange(len(given["lateness"]))
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
    tally, machine, witnesses = Tally(), Machine(), Witnesses()
    law = _warm_up(given, controller, reference)
    above = None if given.priority is None else min(given.priority + 1, 99)
    seen_on = sorted(_processors(os.getpid()) | _processors(served_by))
    end = time.monotonic() + seconds
    used = np.array([cpu_time(os.getpid()), cpu_time(served_by)])
    with machine.watched(), witnesses.watching(folder, seen_on, above):
        while time.monotonic() < end:
            record, began = folder / "soak.csv", time.perf_counter()
            seen = began
            plant = CanPlant(given, record=record)
            try:
                with plant:
                    plant.connect()
                    plant.arm()
                    measured = plant.reset()
                    law.reset()
                    k, began = 0, time.perf_counter()
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
            tally.add(began, plant, record)
        used = (np.array([cpu_time(os.getpid()), cpu_time(served_by)]) - used) / seconds
    faults = [_fault(t, text, given.overrun, machine, witnesses) for t, text in tally.faults]
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
        "machine": machine.shares(),
        **{f"{name}_us": _percentiles(tally.of(name)) for name in ("lateness", "ages", "answers")},
        "worst_seconds": machine.worst(tally.of("at"), tally.of("lateness")),
    }


def _fault(
    t: float, text: str, allowance: float, machine: Machine, witnesses: Witnesses
) -> dict[str, Any]:
    """Return when and why a run ended, and how long the machine stood still about then."""
    stall = witnesses.longest(t - AROUND_FAULT, t + AROUND_FAULT)
    seen = {"stall_ms": round(1e3 * stall, 1), "of_the_machine": stall > SHARE * allowance}
    return {"text": text, **machine.at(t), **seen}


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
