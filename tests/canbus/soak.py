"""Run a controller for long against an emulator in another process, and tell how regular it was.

    python -m tests.canbus.soak --seconds 3600 --rate 1000 --priority 40

The emulator serves socketcand on this machine; the loop runs PD control of a smooth reference. A
fault ends a run; the next one begins, and its kind is counted.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.baselines import make_controller
from cjt_gym.canbus.config import HardwareConfig, load_hardware
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.safety import HardwareFault
from cjt_gym.canbus.timing import PERCENTILES
from cjt_gym.errors import ConfigurationError
from cjt_gym.signals import make_signals
from tests.canbus.bench import DRIVES, document, toml

MAIN = "import sys; from cjt_gym.cli import main; sys.exit(main())"
AMPLITUDE = 10.0
PIECE = 10.0
"""Length of the reference, which is repeated [s]."""


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
        process.communicate(timeout=10.0)


def soak(given: HardwareConfig, seconds: float) -> dict[str, Any]:
    """Run so long and return what was counted and measured."""
    law = make_controller("pd_feedforward", given.joint, given.dt)
    (signal,) = make_signals("smooth", AMPLITUDE)
    reference = signal.torque(np.arange(round(PIECE / given.dt)) * given.dt)
    faults: Counter[str] = Counter()
    times: dict[str, list[float]] = {"lateness": [], "ages": [], "answers": []}
    end, squares = time.monotonic() + seconds, []
    while time.monotonic() < end:
        plant = CanPlant(given)
        try:
            with plant:
                plant.connect()
                plant.arm()
                measured = plant.reset()
                law.act(measured, reference[:1])
                law.reset()
                k = 0
                while time.monotonic() < end:
                    wanted = reference[k % len(reference) :][:1]
                    squares.append(float(wanted[0] - measured.tau[0]) ** 2)
                    measured = plant.step(law.act(measured, wanted), float(wanted[0]))
                    k += 1
        except HardwareFault as fault:
            faults[fault.fault.kind] += 1
        for name, values in vars(plant.timing).items():
            times[name] += list(values)
    return {
        "seconds": seconds,
        "rate_hz": round(1.0 / given.dt),
        "steps": len(squares),
        "rmse": float(np.sqrt(np.mean(squares))),
        "faults": dict(faults),
        **{
            f"{name}_us": {
                f"p{p:g}": round(float(np.percentile(values, p)) * 1e6, 1) for p in PERCENTILES
            }
            for name, values in times.items()
            if values
        },
    }


def main() -> None:
    """Run and print the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--priority", type=int)
    parser.add_argument("--protocol", default="mit", choices=list(DRIVES))
    options = parser.parse_args()
    second = {"value": 0.02, "unit": "s"}
    control = {"rate_hz": options.rate, "missed": 20, "overrun": second, "watchdog": second}
    if options.priority is not None:
        control["priority"] = options.priority
    bus = {"interface": "socketcand", "channel": "can0", "port": free_port()}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "joint.toml"
        path.write_text(toml(document(bus=bus, drive=DRIVES[options.protocol], control=control)))
        with emulator(path):
            result = soak(load_hardware(path), options.seconds)
    sys.stdout.write(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
