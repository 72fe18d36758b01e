"""A program: episodes on the simulated CUDA device, without compiled code; writes what they did.

Numba's simulator runs a kernel as plain Python, so that everything it calls must be plain, too:
NUMBA_ENABLE_CUDASIM=1 NUMBA_DISABLE_JIT=1 python simulated.py CASE OUT.npz
"""

from __future__ import annotations

import sys
import warnings
from typing import Any

import numpy as np
import torch

from cjt_gym.baselines.gains import choose
from cjt_gym.joint import Joint

NUM, STEPS, EPISODE, SEED = 3, 9, 6, 3
PD: Any = {"base_controller": choose("pd_feedforward").make}
CASES: dict[str, dict[str, Any]] = {
    "usual": {
        "effects": {"coulomb": {}, "noise": {}, "command_delay": {"delay": 1.3e-3}},
        "randomization": {"k_b": (0.9, 1.1), "I_m": {"low": 0.9, "high": 1.1, "when": "drift",
                                                     "time_constant": 0.01}},
        **PD,
    },
    "everything": {"effects": "all", "structure": "full_dynamics", "randomization": "mild"},
}  # fmt: skip


def actions() -> list[torch.Tensor]:
    rng = np.random.default_rng(0)
    return [
        torch.from_numpy(rng.uniform(-1.0, 1.0, (NUM, 1)).astype(np.float32)) for _ in range(STEPS)
    ]


def run(episodes: Any, state: Any) -> dict[str, np.ndarray]:
    """Return what episodes observe, earn and are, step by step."""
    rows: dict[str, list[Any]] = {"first": [episodes.reset(SEED).cpu().numpy().copy()]}
    for action in actions():
        values = [x.cpu().numpy().copy() for x in episodes.step(action.to(episodes.device))]
        names = ("observation", "reward", "terminated", "truncated")
        for name, value in zip(names, values, strict=True):
            rows.setdefault(name, []).append(value)
        rows.setdefault("state", []).append(np.array(state()))
        rows.setdefault("last", []).append(episodes.last.cpu().numpy().copy())
    return {name: np.array(values) for name, values in rows.items()}


def with_attributes() -> None:
    """Let records be read by attribute, which Python does not do by itself."""
    packed = Joint.packed

    def readable(self: Joint) -> Any:
        record, ripple = packed(self)
        return record.view(np.recarray), ripple

    Joint.packed = readable  # type: ignore[method-assign]


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # whole numbers of 64 bits overflow on purpose
    with_attributes()
    from cjt_gym.training.gpu.device import DeviceEpisodes

    device = DeviceEpisodes(NUM, episode_steps=EPISODE, **CASES[sys.argv[1]])
    np.savez(sys.argv[2], **run(device, lambda: device.state))
