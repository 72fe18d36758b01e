"""How regular the loop of several joints on a bus is: `python -m benchmarks.bus`.

It runs emulated joints on one CAN FD bus by one loop, beside the emulator in another process, and
tells what each takes of a processor: a rate at which that is a whole control step cannot be kept.
It is for a quiet machine: the load that it has is printed.
"""

from __future__ import annotations

import argparse
import logging
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import load_joints
from cjt_gym.canbus.safety import HardwareFault
from cjt_gym.hardware.delayed_law import law_for
from tests.canbus.soak import cpu_time, emulator, free_port
from tests.canbus.test_bus_load import joints, listed

QUIET = 0.3
"""Load of the machine up to which it is quiet."""
WARM = 20
"""Control steps after which it is measured what a loop takes."""


def main() -> None:
    """Measure what is asked for and print it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bus", description=__doc__)
    parser.add_argument("--rate", type=int, nargs="+", default=[500, 1000], help="[Hz]")
    parser.add_argument("--joints", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of a run")
    text = "time by which joints may be late before that is a fault [s]"
    parser.add_argument("--allowed", type=float, default=0.02, help=text)
    text = "real-time priority of loop and emulator: other programs then wait for these joints"
    parser.add_argument("--priority", type=int, help=text)
    options = parser.parse_args()
    logging.getLogger("can").setLevel(logging.ERROR)  # which warns of frames that come in pieces
    load = os.getloadavg()[0]
    quiet = "quiet" if load <= QUIET else "not quiet, so these figures are of little use"
    print(f"load of the machine {load:.2f}: {quiet}")
    with tempfile.TemporaryDirectory() as folder:
        for rate in options.rate:
            _joints(Path(folder), rate, options)


def _joints(folder: Path, rate: int, options: argparse.Namespace) -> None:
    """Print what a loop of several joints reaches, and what it takes of a processor."""
    path, count, allowed = folder / f"arm-{rate}.toml", options.joints, options.allowed
    late = {"value": allowed, "unit": "s"}
    control: dict[str, Any] = {"overrun": late, "watchdog": {"value": 2.0 * allowed, "unit": "s"}}
    if options.priority is not None:
        control["priority"] = options.priority
    tables = joints(
        *["moteus"] * count,
        bus={"interface": "socketcand", "channel": "can0", "port": free_port(), "fd": True},
        control={"rate_hz": rate, "missed": min(round(allowed * rate), 100), **control},
    )
    path.write_text(listed(tables))
    with emulator(path) as process:
        arm = CanArm(load_joints(path), record=folder / f"r{rate}.csv")
        used, fault = _follow(arm, rate, options.seconds, process.pid)
    steps = len(arm.joints[0].timing.lateness)
    print(f"{count} joints, {rate} Hz: {steps} steps, fault {fault}")
    for name, values in arm.joints[0].timing.summary().items():
        print(f"  {name:9}" + "".join(f"{p:>8} {v:9.0f} us" for p, v in values.items()))
    for name, cpu in zip(("loop", "emulator"), used, strict=True):
        print(f"  {name:9}{cpu * 1e6:6.0f} us of a processor per control step of {1e6 / rate:.0f}")


def _follow(
    arm: CanArm, rate: int, seconds: float, process: int
) -> tuple[NDArray[np.float64], str]:
    """Run joints under PD control, emulated by a process.

    Returns:
        Processor time of loop and emulator per step [s], and the fault.
    """
    steps = round(rate * seconds)
    references = 5.0 * np.sin(6.0 * np.arange(steps)[:, None] / rate + np.arange(len(arm.joints)))
    done, begun = 0, np.full(2, np.nan)
    try:
        with arm:
            arm.connect()
            laws = [
                law_for("pd_feedforward", config.joint, arm.dt, delays)
                for config, delays in zip(arm.configs, arm.measured_delays(), strict=True)
            ]
            arm.arm()
            measured = arm.reset()
            for done, wanted in enumerate(references):
                if done == WARM:
                    begun = _used(process)
                commands = [
                    float(law.act(seen, wanted[j : j + 1])[0])
                    for j, (law, seen) in enumerate(zip(laws, measured, strict=True))
                ]
                measured = arm.step(np.array(commands), wanted)
            fault = "-"
    except HardwareFault as error:
        fault = f"{error.fault.kind} ({error.fault.text})"
    return (_used(process) - begun) / max(done - WARM, 1), fault


def _used(process: int) -> NDArray[np.float64]:
    """Return the processor time that this process and another have used [s]."""
    return np.array([time.process_time(), cpu_time(process)])


if __name__ == "__main__":
    main()
