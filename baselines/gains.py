"""Gain files: a controller with its gains, as `cjt-gym tune` writes them.

Wherever a controller is named, such a file may stand instead: in `simulate`, `benchmark`,
`diagnose`, `hardware`, and as `base_controller` of a training. Code of one's own (PATH.py:NAME, see
`cjt_gym.baselines.own`) is imported only where its path is given: no gain file and no configuration
brings it in, and the gains of such a controller are named after it, PATH.py:NAME@FILE.toml.
"""

from __future__ import annotations

import tomllib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cjt_gym.baselines import (
    Controller,
    ControllerEntry,
    default_gains,
    get_entry,
    make_controller,
)
from cjt_gym.baselines.own import is_own, path_of
from cjt_gym.disk import read_toml, to_toml, write_text
from cjt_gym.errors import (
    CjtGymError,
    CjtGymWarning,
    ConfigurationError,
    MissingFileError,
    unknown_name,
)
from cjt_gym.joint import Joint, get_structure
from cjt_gym.joint import to_toml as joint_text
from cjt_gym.joint.build import file_of
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.files.joint_file import joint_file_of
from cjt_gym.records import Record

KEYS = ("controller", "gains", "tuned")
ENDING, WITH = ".toml", "@"
KNOWN_BY = ("kp", "kd", "derivative", "command_gain")
"""What a controller is known by in the provenance of a record, where it has it."""
DESIGNED_ON = "designed_on"
"""In the provenance of a record: the joint, as a joint file, that its controller was made for."""


@dataclass(frozen=True)
class Choice:
    """A controller, with gains of its own or those that it takes by default."""

    name: str
    controller: str  # what `get_entry` takes
    gains: Mapping[str, float] = field(default_factory=dict)  # gains that replace its defaults
    facts: Mapping[str, Any] = field(default_factory=dict)  # what is known about them

    @property
    def entry(self) -> ControllerEntry:
        """Its row."""
        return get_entry(self.controller)

    def with_gains(self, gains: Mapping[str, float]) -> Choice:
        """Return a copy in which some gains are replaced."""
        for name, value in gains.items():
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ConfigurationError(
                    f"Gain {name} of controller {self.controller} must be a number, got {value!r}."
                )
        self.entry.check_gains(gains)
        return replace(self, gains={**self.gains, **gains})

    def spelt_out(self, joint: Joint, dt: float) -> Choice:
        """Return a copy with a value for every gain: its own, or the default for a joint."""
        known = self.entry.complete(self.gains)
        if len(known) < len(self.entry.tunable):
            known = default_gains(self.controller, joint, dt) | dict(self.gains)
        return replace(self, gains=known)

    def make(self, joint: Joint, dt: float) -> Controller:
        """Return the controller for a joint and a sample time [s].

        Warns:
            CjtGymWarning: The gains were tuned for another joint or another structure.
        """
        name, structure = (str(self.facts.get(key, "")) for key in ("joint", "structure"))
        same_joint = Path(name).stem in (joint.file.name, Path(joint.parameters.origin).stem)
        if name and structure and not (same_joint and structure == joint.structure):
            warnings.warn(
                f"The gains of {self.name} were tuned for {name}, {structure}, and are used on "
                f"{joint.file.name}, {joint.structure}, where they may be far off. Tune them for "
                "it: cjt-gym tune.",
                CjtGymWarning,
                stacklevel=2,
            )
        return make_controller(self.controller, joint, dt, self.gains or None)


def choose(word: str | Path) -> Choice:
    """Return the controller of that name, or the one in a gain file (*.toml).

    PATH.py:NAME@FILE.toml is a controller of one's own with the gains of a file.
    """
    name, _, file = str(word).partition(WITH)
    if is_own(name):
        get_entry(name)
        plain = Choice(name.rpartition(":")[2], name)
        if not file:
            return plain
        known = read_gains(file, name)
        return replace(known, name=f"{plain.name}{WITH}{known.name}", controller=name)
    if str(word).endswith(ENDING):
        return read_gains(word)
    get_entry(str(word))
    return Choice(str(word), str(word))


def choose_listed(word: str | Path) -> Choice:
    """Return the same for a word from a file, which must not name code to import."""
    if is_own(str(word)):
        raise ConfigurationError(
            f"A file cannot name code to be imported, got {word}. Give a controller of the table, "
            "or name the code on the command line or in Python."
        )
    return choose(word)


def files_of(word: str | Path) -> list[Path]:
    """Return the files that a word for `choose` names: code, gains, or none."""
    name, _, file = str(word).partition(WITH)
    if is_own(name):
        return [path_of(name), *([Path(file)] if file else [])]
    return [Path(word)] if str(word).endswith(ENDING) else []


def write_gains(
    path: Path, controller: str, gains: Mapping[str, float], facts: Mapping[str, Any]
) -> Path:
    """Write a gain file and return its path."""
    units = {gain.name: gain.unit for gain in get_entry(controller).tunable}
    values = {name: {"value": value, "unit": units[name]} for name, value in gains.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    data = {"controller": controller, "gains": values, "tuned": facts}
    write_text(path, to_toml(data))
    return path


def _row(path: str | Path, controller: str, own: str | None) -> ControllerEntry:
    """Return the row whose gains a file holds."""
    if own is not None:
        if controller.rpartition(":")[2] != own.rpartition(":")[2]:
            raise ConfigurationError(f"{path} holds gains of {controller}, not of {own}.")
        return get_entry(own)
    if is_own(controller):
        raise ConfigurationError(
            f"{path} holds gains of {controller}, code that is imported only where its path is "
            f"given: name it as  {controller}{WITH}{path}"
        )
    try:
        return get_entry(controller)
    except CjtGymError as error:
        raise type(error)(f"{error} (controller of {path})") from None


def read_gains(path: str | Path, own: str | None = None) -> Choice:
    """Read a gain file; one of your own controller, if `own` is its PATH.py:NAME."""
    file = Path(path)
    try:
        data = read_toml(file, ConfigurationError)
    except FileNotFoundError:
        raise MissingFileError(f"The gain file {path} does not exist. Make it with tune.") from None
    for key in data:
        if key not in KEYS:
            raise ConfigurationError(f"{unknown_name('key', key, KEYS)} (in {path})")
    controller = str(data.get("controller"))
    row, table = _row(path, controller, own), data.get("gains", {})
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


def law_in_record(choice: Choice, joint: Joint, law: object) -> dict[str, Any]:
    """Return what the provenance of a record states of a controller: enough to make it again.

    Args:
        choice: The controller, with a value for every gain.
        joint: The joint that it was made for.
        law: What was made of them.
    """
    known = {name: getattr(law, name) for name in KNOWN_BY if hasattr(law, name)}
    gains = {"gains": dict(choice.gains)} if choice.gains else {}
    on = tomllib.loads(joint_text(replace(file_of(joint), found={})))
    return {"controller": choice.controller, **known, **gains, DESIGNED_ON: on}


def law_of_record(record: Record) -> Controller:
    """Return the controller that made a record, from what `law_in_record` wrote there."""
    made = record.provenance
    file = joint_file_of(to_toml(made[DESIGNED_ON]), f"{DESIGNED_ON} of {record.owner}")
    structure, drive = get_structure(str(file.structure)), str(file.drive)
    joint = Joint(file, structure.name, drive, resolve_effects(None, file, structure, drive))
    law = make_controller(made["controller"], joint, record.dt, made.get("gains"))
    law.command_gain = float(made.get("command_gain", 1.0))
    return law
