"""What an effect adds to a control step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.report import Table
from benchmarks.timing import best_in_turns
from cjt_gym.joint import EFFECTS, STRUCTURES, load_joint
from cjt_gym.plant import SimulatedPlant
from tests.physics.cases import typical

NAME, NUM, STEPS = "orange_80_6000", 256, 60


def stepping(structure: str, effects: Any) -> Callable[[], int]:
    """Return work that drives a batch to and fro; its unit is one joint's control step."""
    joint = load_joint(NAME, structure, effects=effects)
    plant = SimulatedPlant(joint, num=NUM)
    plant.batch.use_blocks(joint)
    torque = 20.0 * np.sin(0.1 * np.arange(STEPS))

    def work() -> int:
        plant.reset(seed=0)
        for value in torque:
            plant.step(np.full(NUM, value))
        return STEPS * NUM

    return work


def table() -> Table:
    """Measure every row of the effect table, and sharp friction, in two structures."""
    columns = []
    for structure in ("output_fixed_rigid_gearbox", "full_dynamics"):
        variants: dict[str, Any] = {"none": {}}
        for effect in EFFECTS.values():
            if effect.acts_in(STRUCTURES[structure], "current"):
                variants[effect.name] = {effect.name: typical(effect)}
        variants["coulomb, sharp"] = {"coulomb": {"dq_0": 0.0}}
        variants["all"] = "all"
        columns.append(
            best_in_turns({n: stepping(structure, e) for n, e in variants.items()}, rounds=7)
        )
    names = dict.fromkeys(name for column in columns for name in column)
    rows = [
        [name, *(f"{c[name] / c['none']:.2f}" if name in c else "-" for c in columns)]
        for name in names
    ]
    return Table(
        "Cost of an effect",
        f"Time of a control step of ten substeps relative to the linear joint, batch of {NUM}.",
        ["effect", "output_fixed_rigid_gearbox", "full_dynamics"],
        rows,
    )
