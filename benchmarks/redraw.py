"""The cost of redrawing the parameters of a large batch, in its own control steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.report import Table
from benchmarks.timing import best_in_turns
from cjt_gym.joint import STRUCTURES, load_joint
from cjt_gym.plant import SimulatedPlant

NAME, NUM, LIMIT = "orange_80_6000", 4096, 20.0
EFFECTS: dict[str, Any] = {"coulomb": {}}
TORQUES = 20.0 * np.sin(0.3 * np.arange(5))


def works(structure: str) -> dict[str, Callable[[], int]]:
    """Return what is timed; units are a control step, a redraw and a reset of the whole batch."""
    joint = load_joint(NAME, structure, effects=EFFECTS)
    drifting = {"preset": "mild", "k_b": _slow(0.9, 1.1), "coulomb.d_cm": _slow(0.7, 1.3)}
    kinds = (None, "mild", drifting)
    same, plant, slow = (SimulatedPlant(joint, NUM, randomization=kind) for kind in kinds)
    for each in (same, plant, slow):
        each.batch.use_blocks(joint)
        each.reset(seed=0)

    def step(which: SimulatedPlant) -> Callable[[], int]:
        def work() -> int:
            for torque in TORQUES:
                which.advance(np.full(NUM, torque), np.zeros(NUM))
            return len(TORQUES)

        return work

    def redraw() -> int:
        plant.redraw()
        return 1

    def reset(which: SimulatedPlant) -> Callable[[], int]:
        def work() -> int:
            which.reset()
            return 1

        return work

    return {
        "step": step(plant),
        "redraw": redraw,
        "reset": reset(same),
        "reset with redraw": reset(plant),
        "step with drift": step(slow),
    }


def _slow(low: float, high: float) -> dict[str, Any]:
    return {"low": low, "high": high, "when": "drift", "time_constant": 1.0}


def table() -> Table:
    """Measure every structure."""
    rows = []
    for structure in STRUCTURES:
        times = best_in_turns(works(structure))
        ratios = {name: time / times["step"] for name, time in times.items() if name != "step"}
        rows.append([structure, f"{LIMIT:.0f}", *(f"{ratio:.2f}" for ratio in ratios.values())])
    return Table(
        "Randomised parameters",
        f"Time in control steps of the same batch of {NUM} joints with Coulomb friction (1 ms of "
        "ten substeps): drawing all that `mild` varies and discretising every joint anew, a reset "
        "without and with that, and a control step while k_b and d_cm drift with 1 s (at every "
        "step).",
        ["structure", "redraw, at most", *ratios],
        rows,
    )
