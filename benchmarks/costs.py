"""What an effect adds to a control step, and what a redraw of parameters takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.report import Table
from benchmarks.timing import best_in_turns
from cjt_gym.joint import EFFECTS, STRUCTURES, load_joint
from cjt_gym.plant import SimulatedPlant
from tests.physics.cases import typical

NAME, NUM, STEPS = "orange_80_6000", 256, 60
RANDOMIZATION = {"k_b": (0.9, 1.1), "I_m": (0.9, 1.1), "d_m": (0.5, 2.0)}


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


def redrawing(structure: str, randomization: Mapping[str, Any] | None) -> Callable[[], int]:
    """Return work that resets a batch; its unit is one joint's reset."""
    joint = load_joint(NAME, structure, effects={"coulomb": {}})
    plant = SimulatedPlant(joint, num=NUM, randomization=randomization)

    def work() -> int:
        for _ in range(20):
            plant.reset()
        return 20 * NUM

    return work


def effect_table() -> Table:
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


def redraw_table() -> Table:
    """Measure resets in units of a control step, in every structure."""
    rows = []
    for structure in STRUCTURES:
        times = best_in_turns(
            {
                "step": stepping(structure, {"coulomb": {}}),
                "reset": redrawing(structure, None),
                "redraw": redrawing(structure, RANDOMIZATION),
            }
        )
        rows.append([structure, *(f"{times[k] / times['step']:.2f}" for k in ("reset", "redraw"))])
    return Table(
        "Cost of a reset",
        "Time of a reset without and with newly drawn parameters (which are discretised anew), in "
        "control steps of a joint with Coulomb friction.",
        ["structure", "reset", "reset with redraw"],
        rows,
    )
