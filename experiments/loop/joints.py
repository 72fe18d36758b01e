"""The joints of the experiment: what is stated of each, what it is, and what it hides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from cjt_gym.blind import KNOWN, Case, draw_case
from cjt_gym.blind.files import datasheet_text
from cjt_gym.blind.plan import can_go_together
from cjt_gym.blind.plant import CHANNELS, STRUCTURES
from cjt_gym.disk import write_text
from cjt_gym.joint import EFFECTS, JointFile, load_joint_file
from cjt_gym.joint.files.quantity import Quantity

GROUPS: Final = (
    "output_fixed_rigid_gearbox",
    "output_fixed",
    "output_fixed_rigid_gearbox",
    "rigid_gearbox",
)
"""Structure of each datasheet; the joints of a group share it."""
DURATION: Final = 10.0
"""Of a record [s]."""
LEFT_OUT: Final = ("thermal_derating", "spring_hysteresis")
"""Effects that are not drawn, because no policy could be trained on the true joint: windings take
longer to warm than an episode lasts, and the loops of the two simulators have different shapes."""
CUTOFF: Final = 200.0
"""Below which velocities are differentiated [Hz]."""


@dataclass(frozen=True)
class HiddenJoint:
    """One joint of the experiment.

    Attributes:
        name: Its name in tables.
        group: Number of its datasheet.
        structure: Its structure.
        case: The joint in the other simulator, with records and the key to what it hides.
    """

    name: str
    group: int
    structure: str
    case: Case

    @property
    def hidden(self) -> tuple[str, ...]:
        """Names of the effects that it hides."""
        return tuple(self.case.label["effects"])

    def stated(self, folder: Path) -> JointFile:
        """Write the joint file of its datasheet into a folder, and return what it says."""
        path = folder / f"sheet_{self.group}.toml"
        write_text(path, datasheet_text(self.case.sheet, path.stem))
        return load_joint_file(path)

    def true(self, stated: JointFile) -> JointFile:
        """Return the joint as it is: its true values and effects, in the package's own terms.

        Args:
            stated: What its datasheet states.
        """
        world, label, p = self.case.world, self.case.label, stated.parameters
        known = {
            symbol: Quantity(
                float(label["true"].get(symbol, quantity.number)), quantity.unit, "true"
            )
            for symbol, quantity in p.quantities.items()
        }
        scatter = {"resolution": world.resolution, "noise": world.noise}
        sensors = {
            channel: {
                key: Quantity(float(scatter[key][CHANNELS.index(channel)]), quantity.unit, "true")
                for key, quantity in entries.items()
            }
            for channel, entries in stated.sensors.items()
        }
        effects = {
            "current_lag": {"bandwidth": Quantity(float(world.drive.bandwidth), "Hz", "true")}
        }
        for name, given in label["parameters"].items():
            values = _in_our_terms(name, given)
            if values:
                effects[name] = {key: _entry(name, key, value) for key, value in values.items()}
        parameters = replace(p, name=f"{self.name}_true", source="the key", quantities=known)
        return replace(stated, parameters=parameters, effects=effects, sensors=sensors)


def _entry(effect: str, symbol: str, value: float) -> Quantity:
    parameter = EFFECTS[effect].parameter(symbol)
    assert parameter is not None
    number = (float(value),) if parameter.series else float(value)
    return Quantity(number, parameter.unit, "true")


def _in_our_terms(name: str, given: Mapping[str, float]) -> dict[str, float]:
    """Return the numbers of an effect that are not already values of the joint or its sensors."""
    if name == "viscous_asym":
        return {symbol: value for symbol, value in given.items() if symbol.endswith("_n")}
    is_there = name in ("noise", "quantization", "current_lag")
    if is_there or all(p.replaces for p in EFFECTS[name].parameters):
        return {}
    return dict(given)


def hidden_joints(groups: int, per_group: int, seed: int) -> list[HiddenJoint]:
    """Return the joints; the first of a group stay the same however many there are.

    In each group they hide one and two effects of the table in turn.

    Args:
        groups: How many datasheets, at most `len(GROUPS)`.
        per_group: How many joints of each.
        seed: Seed of everything.
    """
    found = []
    for group, structure in enumerate(GROUPS[:groups]):
        for k in range(per_group):
            rng = np.random.default_rng((seed, group, k))
            names = _draw(structure, 1 + k % 2, rng)
            case = draw_case(
                int(rng.integers(2**53)),
                effects=names,
                structure=structure,
                excitation="composite",
                closed_loop=False,
                duration=DURATION,
                joint=seed * len(GROUPS) + group,
            )
            found.append(HiddenJoint(f"joint_{group}{chr(97 + k)}", group, structure, case))
    return found


def _draw(structure: str, count: int, rng: np.random.Generator) -> list[str]:
    able = [
        name
        for name, effect in KNOWN.items()
        if effect.places(STRUCTURES[structure]) and name not in LEFT_OUT
    ]
    while True:
        names = [str(name) for name in rng.choice(able, count, replace=False)]
        if can_go_together(names):
            return names


def as_sensed(file: JointFile) -> JointFile:
    """Return a joint with its sensors' noise and resolution, and differentiated velocities."""
    effects: dict[str, Any] = {**file.effects}
    effects["velocity_differentiation"] = {"cutoff": Quantity(CUTOFF, "Hz", "the experiment")}
    effects |= {name: file.effects.get(name, {}) for name in ("noise", "quantization")}
    return replace(file, effects=effects)
