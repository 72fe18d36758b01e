"""What an exporter reads off a joint, and what it hands back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.configure import FIELDS

BODIES = ("motor", "gear", "load")
IDEAL_SENSORS = "sensors are ideal there; add it to what they report"


@dataclass(frozen=True)
class Export:
    """A joint as another simulator takes it.

    Attributes:
        text: The file.
        exact: How each effect that is expressed is expressed, by its name.
        nearly: In what those that are expressed approximately differ, by name.
        missing: Why the others are not, by name.
    """

    text: str
    exact: Mapping[str, str]
    nearly: Mapping[str, str]
    missing: Mapping[str, str]

    def to_dict(self) -> dict[str, object]:
        """Return what was expressed and what was not, as plain data."""
        named = {"exact": self.exact, "nearly": self.nearly, "missing": self.missing}
        return {title: dict(rows) for title, rows in named.items()}


@dataclass(frozen=True)
class Bodies:
    """The moving bodies of a joint after its structure has merged some of them."""

    names: tuple[str, ...]  # name of each coordinate, after the first body that moves with it
    groups: tuple[int, int, int]  # coordinate of motor, gear and load; -1 for a load that is held

    def total(self, values: Mapping[str, float], stem: str, suffix: str = "") -> list[float]:
        """Return a parameter such as "I_" summed over the bodies of each coordinate."""
        out = [0.0] * len(self.names)
        for letter, group in zip("mgl", self.groups, strict=True):
            if group >= 0:
                out[group] += values[f"{stem}{letter}{suffix}"]
        return out

    def springs(self) -> tuple[tuple[str, int, int], ...]:
        """Return springs between coordinates: gear or bar, and the coordinates it joins."""
        motor, gear, load = self.groups
        found = [("gear", motor, gear)] if motor != gear else []
        return tuple(found + ([("bar", gear, load)] if gear != load else []))


def check_exportable(joint: Joint, timestep: float, target: str) -> None:
    """Raise ConfigurationError for a prismatic axis, or a time step that is not > 0 s."""
    check_range("timestep of the export", timestep, "s", above=0.0)
    if joint.parameters.axis == "prismatic":
        raise ConfigurationError(
            f"{joint.file.name} is prismatic; only rotary joints can be exported to {target}."
        )


def bodies_of(joint: Joint) -> Bodies:
    """Return the moving bodies of a joint."""
    groups = joint.structure_row.groups
    names = [BODIES[groups.index(k)] for k in range(max(groups) + 1)]
    motor, gear, load = groups
    return Bodies(tuple(names), (motor, gear, load))


def values_of(joint: Joint) -> tuple[dict[str, float], NDArray[np.float64]]:
    """Return the kernel's parameters with all effects in, and its rows of ripple."""
    record, ripple = joint.packed()
    return {name: float(record[0][name]) for name in FIELDS}, ripple


def gain_of(joint: Joint, values: Mapping[str, float]) -> float:
    """Return the torque that the motor gives over the torque that is commanded."""
    return values["k_t"] / joint.parameters.k_t


def sorted_out(
    joint: Joint, table: Mapping[str, tuple[str, str]]
) -> tuple[dict[str, str], dict[str, str], dict[str, str]]:
    """Return the texts of a joint's effects by how well they are expressed.

    What the table does not have is missing, such as all that sensors do.
    """
    out: dict[str, dict[str, str]] = {"exact": {}, "nearly": {}, "missing": {}}
    for name in joint.effects:
        missing = f"no counterpart: {EFFECTS[name].summary}"
        if EFFECTS[name].stage == "sensing":
            missing = IDEAL_SENSORS
        how, text = table.get(name, ("missing", missing))
        out[how][name] = text
    return out["exact"], out["nearly"], out["missing"]


def listed(title: str, rows: Mapping[str, str]) -> list[str]:
    """Return lines of a comment that lists effects; none where there is nothing to list."""
    return [title, *(f"  {name}: {text}" for name, text in rows.items())] if rows else []


def number(x: float) -> str:
    """Return a number as it is written in files."""
    return f"{x:.9g}"
