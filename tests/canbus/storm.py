"""Random frames on the bus of a plant that runs: a clear fault comes of them, or nothing.

    python -m tests.canbus.storm --frames 1000000

Every control step brings a burst of frames with random identifiers, of the nodes' own ones too, and
random data. A run goes on until a fault ends it, whose torque must be gone within two periods.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field

import can
import numpy as np

from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.safety import HardwareFault
from cjt_gym.canbus.virtual import VirtualLink
from tests.canbus.bench import DRIVES, config, virtual_plant

BURST = 250
LONGEST = 40
"""Control steps after which a run that no frame ends is ended."""
TORQUE = 5.0
OWN = 0.5
"""Frames of a burst, in the mean, that bear an identifier that was on the bus before."""


@dataclass
class Storm:
    """What came of random frames on the bus of one protocol.

    Attributes:
        protocol: What the drive speaks.
        frames: How many.
        runs: Runs that they met.
        faults: How often a kind of fault ended one.
        misses: Runs that ended with torque.
    """

    protocol: str
    frames: int = 0
    runs: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    misses: int = 0


def storm(protocol: str, frames: int, seed: int) -> Storm:
    """Send so many random frames to plants that run.

    Raises:
        Exception: Whatever is raised besides a fault; nothing should be.
    """
    found, rng = Storm(protocol), np.random.default_rng(seed)
    given = config(drive=DRIVES[protocol])
    while found.frames < frames:
        plant, emulator = virtual_plant(given)
        assert isinstance(plant.link, VirtualLink)
        seen: list[tuple[int, bool]] = []
        emulator.tamper = lambda message, node, t, seen=seen: (  # type: ignore[misc]
            seen.append((message.arbitration_id, message.is_extended_id)) or [message]
        )
        plant.reset()
        try:
            _run(plant, found, seen, rng)
            plant.close()
        except HardwareFault as error:
            found.faults[error.fault.kind] += 1
        found.misses += emulator.torque != 0.0
        found.runs += 1
    return found


def _run(
    plant: CanPlant, found: Storm, seen: list[tuple[int, bool]], rng: np.random.Generator
) -> None:
    assert isinstance(plant.link, VirtualLink)
    emulator = plant.link.emulator
    for _ in range(3):
        plant.step(np.array([TORQUE]))
    for _ in range(LONGEST):
        for frame in _burst(seen, rng):
            emulator.inject(frame, emulator.now)
        found.frames += BURST
        plant.step(np.array([TORQUE]))


def _burst(seen: list[tuple[int, bool]], rng: np.random.Generator) -> list[can.Message]:
    identifiers = rng.integers(0, 1 << 29, BURST)
    own = rng.random(BURST) < OWN / BURST
    kinds = rng.random((BURST, 3)) < (0.5, 0.05, 0.1)
    lengths, data = rng.integers(0, 9, BURST), rng.bytes(8 * BURST)
    burst = []
    for k in range(BURST):
        wide, remote, fd = (bool(kind) for kind in kinds[k])
        identifier = int(identifiers[k]) if wide else int(identifiers[k]) & 0x7FF
        if own[k] and seen:
            identifier, wide = seen[int(identifiers[k]) % len(seen)]
        remote = remote and not fd
        burst.append(
            can.Message(
                arbitration_id=identifier,
                is_extended_id=wide,
                is_remote_frame=remote,
                is_fd=fd,
                data=None if remote else data[8 * k : 8 * k + int(lengths[k])],
            )
        )
    return burst


def main() -> int:
    """Send them and print what came of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    form, misses = "{:10}{:>10}{:>8}{:>8}{:>8}  {}\n", 0
    sys.stdout.write(form.format("protocol", "frames", "runs", "faults", "misses", "as"))
    for k, protocol in enumerate(DRIVES):
        found = storm(protocol, options.frames // len(DRIVES), options.seed + k)
        kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(found.faults.items()))
        ended = found.faults.total()
        sys.stdout.write(
            form.format(protocol, found.frames, found.runs, ended, found.misses, kinds)
        )
        sys.stdout.flush()
        misses += found.misses
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())
