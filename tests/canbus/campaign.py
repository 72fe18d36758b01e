"""Inject faults into runs on an emulated joint, in virtual time, and look whether torque goes.

    python -m tests.canbus.campaign --faults 10000

Each fault is injected at a random control step of a run under PD control. Its row of the table says
how often it was injected, after how many control periods the torque was zero and stayed so, and
whether the record on disk had every sample up to then.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import can
import numpy as np

from cjt_gym.baselines import Controller, make_controller
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.emulator import TICK, Emulator
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.protocols.contract import Fault as DriveFault
from cjt_gym.canbus.safety import HardwareFault, State, check_action
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.records import read_record
from tests.canbus.bench import DRIVES, config

EARLIEST, LATEST = 8, 30
"""Control steps between which a fault is injected."""
AFTER = 12
"""Control steps after it for which the torque is watched."""
PERIODS = 2.0
AMPLITUDE, FREQUENCY = 30.0, 7.0


@dataclass
class Scene:
    """A run on an emulated joint.

    Attributes:
        plant: The plant.
        emulator: What it drives.
        link: What is between them.
        rng: For what the fault draws.
        began: When the fault began to act [s]; NaN before.
        torques: Every change of the drive's torque: time [s], torque [N m].
    """

    plant: CanPlant
    emulator: Emulator
    link: VirtualLink
    rng: np.random.Generator
    began: float = float("nan")
    torques: list[tuple[float, float]] = field(default_factory=list)

    def begin(self) -> None:
        """Note that the fault acts from now on."""
        if math.isnan(self.began):
            self.began = self.emulator.now

    def tamper(self, change: Callable[[can.Message, float], list[can.Message]]) -> None:
        """Let the bus change every frame of the drive from now on."""

        def act(message: can.Message, node: str, t: float) -> list[can.Message]:
            self.begin()
            return change(message, t)

        self.emulator.tamper = act


def _missing(scene: Scene) -> None:
    scene.tamper(lambda message, t: [])


def _late(scene: Scene) -> None:
    delay = scene.plant.dt * scene.rng.uniform(3.0, 8.0)

    def hold(message: can.Message, t: float) -> list[can.Message]:
        scene.emulator.inject(message, t + delay)
        return []

    scene.tamper(hold)


def _repeated(scene: Scene) -> None:
    copies = int(scene.rng.integers(3, 6))
    scene.tamper(lambda message, t: [message] * copies)


def _changed(scene: Scene, change: Callable[[bytes], bytes]) -> None:
    def act(message: can.Message, t: float) -> list[can.Message]:
        if message.is_remote_frame:
            return [message]
        return [
            can.Message(
                arbitration_id=message.arbitration_id,
                is_extended_id=message.is_extended_id,
                is_fd=message.is_fd,
                data=change(bytes(message.data)),
            )
        ]

    scene.tamper(act)


def _truncated(scene: Scene) -> None:
    length = int(scene.rng.integers(1, 5))
    _changed(scene, lambda data: data[:length])


def _nonsense(scene: Scene) -> None:
    _changed(scene, lambda data: data[:1] + b"\xff" * (len(data) - 1))


def _error_frame(scene: Scene) -> None:
    scene.tamper(lambda message, t: [can.Message(is_error_frame=True)])


def _too_fast(scene: Scene) -> None:
    scene.begin()
    side = scene.rng.choice([-1.0, 1.0])
    scene.emulator.plant.batch.arrays.state[0, 3:5] = 1.2 * side * scene.plant.limits.dq_m


def _twisted(scene: Scene) -> None:
    scene.begin()
    limits = scene.plant.config.limits
    twist = 1.3 * limits.deflection * scene.rng.choice([-1.0, 1.0])
    scene.emulator.plant.batch.arrays.state[0, :2] = twist


def _bus_off(scene: Scene) -> None:
    scene.begin()
    scene.link.is_off = True


def _drive_fault(scene: Scene) -> None:
    scene.begin()
    kinds = [DriveFault.OVER_TEMPERATURE, DriveFault.OVER_CURRENT, DriveFault.ENCODER]
    scene.emulator.drive.fail(kinds[int(scene.rng.integers(len(kinds)))])


def _reboot(scene: Scene) -> None:
    scene.begin()
    scene.emulator.drive.boot(scene.emulator.now)
    scene.emulator.nodes[0].alive = False  # it takes longer to start than the run goes on


def _overrun(scene: Scene) -> None:
    scene.begin()
    scene.link.wait_until(scene.link.now() + scene.plant.dt * scene.rng.uniform(1.5, 8.0))


def _not_a_number(scene: Scene) -> None:
    scene.begin()
    scene.plant.step(np.array([scene.rng.choice([np.nan, np.inf, -np.inf])]))


def _out_of_space(scene: Scene) -> None:
    scene.begin()
    trouble = check_action(float(scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(1.01, 100.0)))
    assert trouble is not None
    scene.plant.fail(trouble.kind, trouble.text)


def _exception(scene: Scene) -> None:
    scene.begin()
    raise RuntimeError("The policy has a mistake")


def _interrupt(scene: Scene) -> None:
    scene.begin()
    raise KeyboardInterrupt


class Killed(BaseException):
    """Stands for the death of the process: nothing of it runs any more."""


def _killed(scene: Scene) -> None:
    scene.begin()
    scene.link.close()
    raise Killed


FAULTS: dict[str, tuple[str, Callable[[Scene], None]]] = {
    "frames missing": ("missing", _missing),
    "frames late": ("missing", _late),
    "frames repeated": ("repeated", _repeated),
    "frames too short": ("corrupt missing", _truncated),
    "frames of nonsense": ("corrupt out_of_range drive", _nonsense),
    "error frames": ("bus_off", _error_frame),
    "too fast": ("out_of_range drive corrupt", _too_fast),
    "spring overloaded": ("out_of_range drive corrupt", _twisted),
    "bus off": ("bus_off", _bus_off),
    "drive reports a fault": ("drive missing", _drive_fault),
    "drive reboots": ("drive missing", _reboot),
    "loop overrun": ("overrun", _overrun),
    "command not finite": ("command", _not_a_number),
    "action out of space": ("command", _out_of_space),
    "exception in the policy": ("exception", _exception),
    "Ctrl-C": ("interrupt", _interrupt),
    "process killed": ("", _killed),
}
"""Every fault: kinds as which it may be found, "" where nobody is left to find it; injection."""


@dataclass
class Outcome:
    """What became of one fault.

    Attributes:
        fault: A name of `FAULTS`.
        protocol: What the drive spoke.
        kind: As which it was found, "" where it was not.
        periods: Control periods until the torque was zero for good.
        is_complete: Whether the record has every sample up to the fault.
        is_expected: Whether it was found as one of the kinds it may be found as.
    """

    fault: str
    protocol: str
    kind: str
    periods: float
    is_complete: bool
    is_expected: bool

    @property
    def is_miss(self) -> bool:
        """Whether anything about it was not as it should be."""
        late = self.periods > PERIODS + 1e-9
        return late or not self.is_complete or not self.is_expected


def inject(name: str, protocol: str, folder: Path, seed: int) -> Outcome:
    """Run, inject a fault, and look what becomes of it."""
    given = _config(protocol)
    emulator = Emulator(given)
    link = VirtualLink(emulator)
    path = folder / f"{seed}.csv"
    plant = CanPlant(given, link, path)
    scene = Scene(plant, emulator, link, np.random.default_rng(seed))
    emulator.torque_changed = lambda t, torque: scene.torques.append((t, torque))
    steps = _run(scene, FAULTS[name][1])
    emulator.advance(emulator.now + AFTER * given.dt)
    found = plant.joint.guard.fault
    kind = "" if found is None else found.kind
    if found is None and name != "process killed":
        return Outcome(name, protocol, "", np.inf, False, False)
    zero = next((t for t, torque in reversed(scene.torques) if torque != 0.0), 0.0)
    later = [t for t, torque in scene.torques if t > zero]
    periods = (later[0] - scene.began) / given.dt if later else np.inf
    if emulator.torque != 0.0:
        periods = np.inf
    record = read_record(path)
    killed = name == "process killed"
    complete = len(record) >= steps and bool(np.all(np.isfinite(record["tau_cmd"])))
    if not killed:
        complete = complete and record.provenance["fault"]["kind"] == kind
        complete = complete and record["tau_cmd"][-1] == 0.0 and plant.state is not State.RUNNING
    path.unlink()
    path.with_suffix(".toml").unlink()
    expected = kind in FAULTS[name][0].split() or (killed and not kind)
    return Outcome(name, protocol, kind, max(float(periods), 0.0), complete, expected)


@cache
def _config(protocol: str) -> HardwareConfig:
    return config(drive=DRIVES[protocol])


@cache
def _law(protocol: str) -> Controller:
    given = _config(protocol)
    return make_controller("pd_feedforward", given.joint, given.dt)


def _run(scene: Scene, act: Callable[[Scene], None]) -> int:
    """Run under PD control until the fault has ended it; return the control steps until then."""
    plant, steps = scene.plant, 0
    law = _law(plant.config.drive.protocol)
    at = int(scene.rng.integers(EARLIEST, LATEST))
    phase = scene.rng.uniform(0.0, 2.0 * np.pi)
    try:
        plant.connect()
        plant.arm()
        measured = plant.reset()
        law.reset()
        for k in range(LATEST + 100):
            wanted = AMPLITUDE * np.sin(2.0 * np.pi * FREQUENCY * k * plant.dt + phase)
            reference = np.array([wanted])
            measured = plant.step(law.act(measured, reference), wanted)
            steps += 1
            if k == at:
                act(scene)
    except Killed:
        return steps
    except (HardwareFault, RuntimeError, KeyboardInterrupt):
        plant.close()  # as leaving a with statement does
        return steps
    plant.close()  # it was not found
    return steps


def campaign(faults: int, seed: int, protocols: tuple[str, ...]) -> list[Outcome]:
    """Inject so many faults, all kinds and protocols in turn."""
    names = list(FAULTS)
    outcomes = []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(faults):
            name, protocol = names[k % len(names)], protocols[k // len(names) % len(protocols)]
            outcomes.append(inject(name, protocol, Path(folder), seed + k))
            if sys.stderr.isatty() and k % 100 == 99:
                sys.stderr.write(f"\r{k + 1} of {faults}")
    return outcomes


def table(outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """Return one row per fault."""
    rows = []
    for name in FAULTS:
        some = [o for o in outcomes if o.fault == name]
        if some:
            rows.append(
                {
                    "fault": name,
                    "injected": len(some),
                    "zero_within_two_periods": sum(o.periods <= PERIODS + 1e-9 for o in some),
                    "slowest_periods": round(max(o.periods for o in some), 3),
                    "record_complete": sum(o.is_complete for o in some),
                    "found_as": ", ".join(sorted({o.kind for o in some if o.kind})) or "-",
                    "misses": sum(o.is_miss for o in some),
                }
            )
    return rows


def main() -> int:
    """Run the campaign and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--faults", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--protocols", nargs="+", default=list(DRIVES))
    options = parser.parse_args()
    outcomes = campaign(options.faults, options.seed, tuple(options.protocols))
    rows = table(outcomes)
    misses = sum(row["misses"] for row in rows)
    lines = [*_lines(rows), f"{len(outcomes)} faults, {misses} misses (time is told to {TICK} s)"]
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if misses else 0


def _lines(rows: list[dict[str, Any]]) -> Iterator[str]:
    form = "{:25}{:>9}{:>11}{:>9}{:>8}{:>8}  {}"
    yield form.format("fault", "injected", "zero in 2", "slowest", "record", "misses", "found as")
    keys = ("fault", "injected", "zero_within_two_periods", "slowest_periods")
    for row in rows:
        yield form.format(*(row[key] for key in (*keys, "record_complete", "misses", "found_as")))


if __name__ == "__main__":
    sys.exit(main())
