"""Gain files: a controller with its gains, as `cjt-gym tune` writes them.

Wherever a controller is named, such a file may stand instead: in `simulate`, `benchmark`,
`diagnose`, `hardware`, and as `base_controller` of a training.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cjt_gym.baselines import CONTROLLERS, Controller, make_controller
from cjt_gym.disk import read_toml, write_text
from cjt_gym.errors import CjtGymWarning, ConfigurationError, MissingFileError, unknown_name
from cjt_gym.joint import Joint
from cjt_gym.training.toml_text import to_toml

KEYS = ("controller", "gains", "tuned")


@dataclass(frozen=True)
class Choice:
    """A controller, with gains of its own or those that it takes by default.

    Attributes:
        name: Name in tables.
        controller: A row of `CONTROLLERS`.
        gains: Gains that replace its defaults.
        facts: What is known about them.
    """

    name: str
    controller: str
    gains: Mapping[str, float] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)

    def with_gains(self, gains: Mapping[str, float]) -> Choice:
        """Return a copy in which some gains are replaced.

        Raises:
            UnknownNameError: The controller has no gain of that name.
            ConfigurationError: A gain is out of its range.
        """
        for name, value in gains.items():
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ConfigurationError(
                    f"Gain {name} of controller {self.controller} must be a number, got {value!r}."
                )
        CONTROLLERS[self.controller].check_gains(gains)
        return replace(self, gains={**self.gains, **gains})

    def make(self, joint: Joint, dt: float) -> Controller:
        """Return the controller for a joint and a sample time [s].

        Warns:
            CjtGymWarning: The gains were tuned for another joint or another structure.

        Raises:
            ConfigurationError: The law does not fit the joint or the sample time.
        """
        told = [str(self.facts.get(key, "")) for key in ("joint", "structure")]
        here = [joint.file.name, joint.structure]
        if "" not in told and [Path(told[0]).stem, told[1]] != here:
            warnings.warn(
                f"The gains of {self.name} were tuned for {told[0]}, {told[1]}, and are used on "
                f"{here[0]}, {here[1]}, where they may be far off. Tune them for it: cjt-gym tune.",
                CjtGymWarning,
                stacklevel=2,
            )
        return make_controller(self.controller, joint, dt, self.gains or None)


def choose(word: str | Path) -> Choice:
    """Return the controller of that name, or the one in a gain file (*.toml).

    Raises:
        UnknownNameError: There is no such controller or gain.
        MissingFileError: There is no such file.
        ConfigurationError: The file is not valid.
    """
    if str(word).endswith(".toml"):
        return read_gains(word)
    if word not in CONTROLLERS:
        raise unknown_name("controller", str(word), CONTROLLERS)
    return Choice(str(word), str(word))


def write_gains(
    path: Path, controller: str, gains: Mapping[str, float], facts: Mapping[str, Any]
) -> Path:
    """Write a gain file and return its path.

    Args:
        path: A TOML file.
        controller: A row of `CONTROLLERS`.
        gains: Its gains, by name, in the units of the row.
        facts: How they were found.
    """
    units = {gain.name: gain.unit for gain in CONTROLLERS[controller].tunable}
    values = {name: {"value": value, "unit": units[name]} for name, value in gains.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    data = {"controller": controller, "gains": values, "tuned": facts}
    write_text(path, to_toml(data))
    return path


def read_gains(path: str | Path) -> Choice:
    """Read a gain file.

    Raises:
        MissingFileError: There is no such file.
        ConfigurationError: It is not valid.
        UnknownNameError: There is no such controller or gain.
    """
    file = Path(path)
    try:
        data = read_toml(file, ConfigurationError)
    except FileNotFoundError:
        raise MissingFileError(f"The gain file {path} does not exist. Make it with tune.") from None
    for key in data:
        if key not in KEYS:
            raise ConfigurationError(f"{unknown_name('key', key, KEYS)} (in {path})")
    controller = data.get("controller")
    if controller not in CONTROLLERS:
        raise unknown_name(f"controller of {path}", str(controller), CONTROLLERS)
    row, table = CONTROLLERS[controller], data.get("gains", {})
    units = {gain.name: gain.unit for gain in row.tunable}
    gains = {}
    for name, entry in table.items() if isinstance(table, dict) else ():
        number = entry.get("value") if isinstance(entry, dict) else None
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            raise ConfigurationError(
                f'Gain {name} of {path} must be {{ value = NUMBER, unit = "..." }}, got {entry!r}.'
            )
        if name in units and entry.get("unit") != units[name]:
            raise ConfigurationError(
                f"Gain {name} of {path} must be in {units[name]}, got {entry.get('unit')!r}."
            )
        gains[name] = float(number)
    row.check_gains(gains)
    return Choice(file.stem, controller, gains, data.get("tuned", {}))
