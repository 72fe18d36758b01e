"""How regular loops on a bus are: `python -m benchmarks.bus runs|joints`.

`runs` starts `cjt-gym emulate` and `cjt-gym hardware --arm` in processes of their own, again and
again with nothing but defaults, and counts which runs end without a fault. `joints` runs several
emulated joints on one CAN FD bus by one loop: in real time, beside the emulator in another process,
and in the emulator's time, which tells what the loop itself takes. Both are for a quiet machine:
the load that it has is printed.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.baselines import make_controller
from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import load_joints
from cjt_gym.canbus.emulated_arm import emulator_of
from cjt_gym.canbus.safety import HardwareFault
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.records import read_record
from tests.canbus.bench import document, toml
from tests.canbus.soak import MAIN, emulator, free_port
from tests.canbus.test_bus_load import joints, listed
from tests.canbus.test_default_run import ASKED, CONTROLLERS, LIMITS

QUIET = 0.3
"""Load of the machine up to which it is quiet."""
ALLOWED = {"missed": 20, "overrun": 0.02, "watchdog": 0.04}
"""What `joints` allows, as examples/hardware/joint.toml does for a desktop computer."""


def main() -> None:
    """Measure what is asked for and print it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bus", description=__doc__)
    parser.add_argument("what", choices=("runs", "joints"))
    parser.add_argument("--rate", type=int, nargs="+", default=[500, 1000], help="[Hz]")
    parser.add_argument("--times", type=int, default=2, help="runs of each controller and rate")
    parser.add_argument("--joints", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of a run")
    options = parser.parse_args()
    logging.getLogger("can").setLevel(logging.ERROR)  # which warns of frames that come in pieces
    load = os.getloadavg()[0]
    quiet = "quiet" if load <= QUIET else "not quiet, so these figures are of little use"
    print(f"load of the machine {load:.2f}: {quiet}")
    with tempfile.TemporaryDirectory() as folder:
        for rate in options.rate:
            if options.what == "runs":
                _default_runs(Path(folder), rate, options.times, options.seconds)
            else:
                _joints(Path(folder), rate, options.joints, options.seconds)


def _default_runs(folder: Path, rate: int, times: int, seconds: float) -> None:
    """Run every controller with defaults, and print a row for each run."""
    rows = [
        _default_run(folder, rate, name, k, seconds)
        for k, name in product(range(times), CONTROLLERS)
    ]
    print(f"{'Hz':>5} {'controller':18}{'fault':10}{'rmse [N m]':>11}{'late, 99.9 % [us]':>19}")
    for row in rows:
        print(f"{rate:5} {row[0]:18}{row[1]:10}{row[2]:11.3f}{row[3]:19.0f}")
    print(f"{sum(row[1] == '-' for row in rows)} of {len(rows)} runs at {rate} Hz without a fault")


def _default_run(
    folder: Path, rate: int, controller: str, k: int, seconds: float
) -> tuple[str, str, float, float]:
    """Return controller, kind of fault or "-", tracking error [N m] and lateness [us] of a run."""
    name = f"{controller}-{rate}-{k}"
    path, out = folder / f"{name}.toml", folder / f"{name}.csv"
    bus = {"interface": "socketcand", "channel": "can0", "port": free_port()}
    tables = document(bus=bus, drive=ASKED, control={"rate_hz": rate}, limits=LIMITS)
    path.write_text(toml(tables))
    words = ["hardware", str(path), "--arm", "--reference", "step", "--controller", controller]
    words += ["--duration", str(seconds), "--out", str(out), "--json"]
    with emulator(path):
        ended = subprocess.run(
            [sys.executable, "-c", MAIN, *words], capture_output=True, text=True, check=False
        )
    if ended.returncode == 0:
        told = json.loads(ended.stdout)
        return controller, "-", told["rmse"], told["timing_us"]["lateness"]["p99.9"]
    sys.stderr.write(ended.stderr)
    kind = read_record(out).provenance["fault"]["kind"] if out.exists() else "not armed"
    return controller, kind, float("nan"), float("nan")


def _joints(folder: Path, rate: int, count: int, seconds: float) -> None:
    """Print what a loop of several joints reaches."""
    path = folder / f"arm-{rate}.toml"
    seconds_of = {k: {"value": v, "unit": "s"} for k, v in ALLOWED.items() if k != "missed"}
    tables = joints(
        *["moteus"] * count,
        bus={"interface": "socketcand", "channel": "can0", "port": free_port(), "fd": True},
        control={"rate_hz": rate, "missed": ALLOWED["missed"], **seconds_of},
    )
    path.write_text(listed(tables))
    configs = load_joints(path)
    timed = Timed(VirtualLink(emulator_of(configs)))
    steps, fault, _ = _follow(CanArm(configs, timed, folder / f"v{rate}.csv"), rate, seconds)
    print(f"{count} joints, {rate} Hz, in the emulator's time: {steps} steps, fault {fault}")
    for what, times in (("loop", timed.own), ("emulator", timed.others)):
        middle, most = np.percentile(times[-steps:], (50.0, 99.0)) * 1e6
        print(f"  {what}: {middle:.0f} us (99 %: {most:.0f}) of {1e6 / rate:.0f} us a step")
    with emulator(path):
        arm = CanArm(configs, record=folder / f"r{rate}.csv")
        steps, fault, timing = _follow(arm, rate, seconds)
    print(f"{count} joints, {rate} Hz, in real time: {steps} steps, fault {fault}")
    for name, values in timing.items():
        print(f"  {name:9}" + "".join(f"{p:>8} {v:9.0f} us" for p, v in values.items()))


def _follow(arm: CanArm, rate: int, seconds: float) -> tuple[int, str, dict[str, Any]]:
    """Run joints under PD control; return steps, kind of fault or "-", and how regular it was."""
    laws = [make_controller("pd_feedforward", config.joint, arm.dt) for config in arm.configs]
    steps, fault = round(rate * seconds), "-"
    references = 5.0 * np.sin(6.0 * np.arange(steps)[:, None] / rate + np.arange(len(laws)))
    done = 0
    try:
        with arm:
            arm.connect()
            arm.arm()
            measured = arm.reset()
            for wanted in references:
                commands = [
                    float(law.act(seen, wanted[j : j + 1])[0])
                    for j, (law, seen) in enumerate(zip(laws, measured, strict=True))
                ]
                measured = arm.step(np.array(commands), wanted)
                done += 1
    except HardwareFault as error:
        fault = f"{error.fault.kind} ({error.fault.text})"
    return done, fault, arm.joints[0].timing.summary()


class Timed:
    """A link that tells how a control step divides between a loop and the emulator behind it.

    Attributes:
        own: Time outside of the emulator, by control step [s].
        others: Time in the emulator [s].
    """

    def __init__(self, link: VirtualLink) -> None:
        self.stamps = link.stamps
        self.now, self.watch, self.close = link.now, link.watch, link.close
        self.send, self.receive = self._timed(link.send), self._timed(link.receive)
        self._wait = self._timed(link.wait_until)
        self.own, self.others = list[float](), list[float]()
        self._elsewhere, self._since = 0.0, time.perf_counter()

    def _timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def through(*arguments: Any) -> Any:
            begun = time.perf_counter()
            found = call(*arguments)
            self._elsewhere += time.perf_counter() - begun
            return found

        return through

    def wait_until(self, t: float) -> None:
        self._wait(t)
        now = time.perf_counter()
        self.own.append(now - self._since - self._elsewhere)
        self.others.append(self._elsewhere)
        self._elsewhere, self._since = 0.0, now


if __name__ == "__main__":
    main()
