"""A joint on a test bench, which can be recorded any number of times."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cjt_gym.blind.control import Gains
from cjt_gym.blind.files import datasheet_text
from cjt_gym.blind.joints import Datasheet, draw_joint
from cjt_gym.blind.plant import CHANNELS, STRUCTURES, Floats, World
from cjt_gym.blind.run import draw_chances, instants, run
from cjt_gym.errors import check_name
from cjt_gym.records import Record, default_units


@dataclass(frozen=True)
class Bench:
    """A joint that can be recorded, and its datasheet."""

    world: World
    sheet: Datasheet

    def datasheet(self, name: str = "bench") -> str:
        """Return the text of the joint file that a diagnosis is given."""
        return datasheet_text(self.sheet, name)

    def record(self, current: Floats, seed: int = 0) -> Record:
        """Return the record of a run from rest under given currents [A], shape (n,)."""
        return self._run(current, Gains(limit=self.sheet.i_p), seed, {"mode": "open loop"})

    def track(self, reference: Floats, kp: float, seed: int = 0) -> Record:
        """Return the record of a run from rest in a closed loop.

        The motor torque is reference + kp (reference - measured torque) [N m].
        """
        p = self.sheet.values
        per_ampere = 1.0 / (p["k_t"] * p["n"])
        gains = Gains(closed=1.0, per_ampere=per_ampere, limit=self.sheet.i_p, kp=kp)
        known = {"mode": "closed loop", "controller": "pd_feedforward", "kp": kp, "kd": 0.0}
        record = self._run(reference, gains, seed, known)
        more = {"tau_ref": reference, "tau_cmd": record["i_cmd"] / per_ampere}
        return record.with_columns(more, default_units(tuple(more)))

    def _run(self, signal: Floats, gains: Gains, seed: int, known: dict[str, Any]) -> Record:
        chances = draw_chances(self.world, len(signal), np.random.default_rng(seed))
        result = run(self.world, signal, gains, chances)
        columns = {"t": instants(self.sheet.dt, len(signal)), "i_cmd": result.command}
        columns |= {name: result.measured[:, CHANNELS.index(name)] for name in self.sheet.channels}
        return Record(
            columns,
            default_units(tuple(columns)),
            dt=self.sheet.dt,
            structure=self.world.structure.name,
            provenance=known,
        )


def make_bench(seed: int, structure: str, **changed: float) -> Bench:
    """Return a random joint, with some of its mechanics changed from its datasheet.

    Args:
        seed: Seed of the joint.
        structure: Name of its structure.
        **changed: Fields of `Plant` with their true values, such as `up_m` and `down_m`, the levels
            of dry friction of the motor [N m].

    Raises:
        UnknownNameError: There is no such structure or field.

    Example:
        >>> bench = make_bench(3, "output_fixed_rigid_gearbox", up_m=1.5, down_m=1.5)
        >>> len(bench.record(np.zeros(300)))
        300
    """
    check_name("structure", structure, STRUCTURES)
    world, sheet = draw_joint(STRUCTURES[structure], np.random.default_rng(seed))
    for name in changed:
        check_name("field of Plant", name, world.plant._fields)
    return Bench(replace(world, plant=world.plant._replace(**changed)), sheet)
