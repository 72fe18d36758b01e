"""Episodes on a CUDA device against the processors: `python -m benchmarks.device [JOINTS...]`.

Needs a device. Both step the same episodes in the same run, by the clock.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import torch

from benchmarks.timing import ROUNDS
from cjt_gym.training.gpu import make_episodes

JOINTS = (1024, 16_384, 131_072)
STEPS = 50
ARGUMENTS: dict[str, Any] = {
    "effects": {"coulomb": {}, "noise": {}},
    "randomization": "mild",
}


def steps_per_second(joints: int, device: str) -> float:
    """Return how many steps of one joint a second takes, the best of some rounds."""
    episodes = make_episodes(joints, device, **ARGUMENTS)
    actions = 0.3 * torch.ones((joints, 1), device=episodes.device)
    episodes.reset(0)
    best = 0.0
    for _ in range(ROUNDS + 1):  # the first compiles
        begin = time.perf_counter()
        for _ in range(STEPS):
            episodes.step(actions)
        if device == "cuda":
            torch.cuda.synchronize()
        best = max(best, joints * STEPS / (time.perf_counter() - begin))
    return best


def main() -> None:
    """Print a row for each number of joints."""
    sizes = [int(word) for word in sys.argv[1:]] or JOINTS
    print(f"{torch.cuda.get_device_name()} against {torch.get_num_threads()} threads")
    print(f"{'joints':>8}  {'device':>12}  {'processors':>12}  ratio   (steps per second)")
    for joints in sizes:
        device, host = (steps_per_second(joints, where) for where in ("cuda", "cpu"))
        print(f"{joints:>8}  {device:>12.3g}  {host:>12.3g}  {device / host:.2f}", flush=True)


if __name__ == "__main__":
    main()
