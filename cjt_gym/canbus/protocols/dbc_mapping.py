"""Mapping of a DBC file's signals to the values of a joint, in the format of log mappings.

A mapping is a TOML file with a table per column, as in :mod:`cjt_gym.records.mapping`, in which
signals are named ``/Message:Signal``. The same file also reads traces of the bus. The table `[can]`
is for the master; everything but `dbc` is optional:

================  ==============================================================================
`dbc`             the DBC file, beside the mapping
`enabled`         signals to set in a command while the drive should make torque
`disabled`        signals to set in a command while it should not
`clear`           signals to set in a command to leave a fault
`state`           `source`, and lists of its values when `booting`, `disabled`, `enabled`,
                  `fault`
`error`           a signal that is zero unless there is a fault
`temperature`     a signal [degC]
`v_bus`           a signal [V]
`cycle_ms`        cycle times of messages, by name, if the DBC file does not state them [ms]
================  ==============================================================================

The column `tau_cmd` names the signal of the commanded torque, or `i_cmd` that of the current.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from math import inf
from pathlib import Path
from typing import Any, Final

import cantools
from cantools.database import Database

from cjt_gym.canbus.protocols.contract import CHANNELS, Mode
from cjt_gym.canbus.tables import Section
from cjt_gym.disk import read_toml
from cjt_gym.errors import CjtGymError, ConfigurationError, check_name, unknown_name
from cjt_gym.records.mapping import ColumnSource, load_mapping

SUFFIX: Final = ".map.toml"
PHASES: Final = ("enabled", "disabled", "clear")
KEYS: Final = ("dbc", *PHASES, "state", "error", "temperature", "v_bus", "cycle_ms")
MODES: Final = {mode.value: mode for mode in Mode}
Signal = tuple[str, str]
"""Name of a message and of a signal in it."""


@dataclass(frozen=True)
class DbcMapping:
    """A mapping and its DBC file."""

    database: Database  # messages of the DBC file
    # signal of each reported channel, with its conversion
    channels: Mapping[str, tuple[Signal, ColumnSource]]
    # signal of the commanded torque or current, with its conversion
    command: tuple[Signal, ColumnSource] | None
    is_current: bool  # whether the command is a current
    # signals that are set for "enabled", "disabled" and "clear"
    phases: Mapping[str, Mapping[Signal, float]]
    state: Signal | None = None  # signal of the mode
    # values of the mode's signal
    modes: Mapping[Mode, tuple[int, ...]] = field(default_factory=dict)
    error: Signal | None = None  # signal of the error
    # cycle times of messages by name [s], where known
    cycles: Mapping[str, float] = field(default_factory=dict)


def load_dbc_mapping(name: str, n: float) -> DbcMapping:
    """Return a mapping from its file, or one that ships, with the gear ratio where it gives none.

    Raises:
        ConfigurationError: The mapping or its DBC file is not valid.
    """
    path = _path_of(name)
    try:
        document = read_toml(path, ConfigurationError)
    except OSError as error:
        raise ConfigurationError(f"{path} must be a TOML file: {error}.") from error
    given = document.pop("can", None)
    if not isinstance(given, dict) or "dbc" not in given:
        raise ConfigurationError(f'{path} must have a table [can] with  dbc = "FILE.dbc".')
    if wrong := [key for key in given if key not in KEYS]:
        raise unknown_name(f"key in [can] of {path}", wrong[0], KEYS)
    try:
        columns = load_mapping(document, n).columns
    except CjtGymError as error:
        raise ConfigurationError(f"{error} (in {path})") from error
    return _checked(_Reader(path, _database(path.parent / str(given["dbc"]))), given, columns)


def _path_of(name: str) -> Path:
    path = Path(name)
    if os.path.isfile(path):
        return path
    folder = Path(str(resources.files("cjt_gym.canbus.protocols") / "data"))
    shipped = folder / (path.name + SUFFIX)
    if not os.path.isfile(shipped):
        known = sorted(each.name.removesuffix(SUFFIX) for each in folder.glob("*" + SUFFIX))
        raise ConfigurationError(
            f"file must be a mapping or one of {', '.join(known)}; there is no {name}."
        )
    return shipped


def _database(path: Path) -> Database:
    try:
        return cantools.database.load_file(str(path), strict=True, database_format="dbc")  # type: ignore[return-value]
    except OSError as error:
        raise ConfigurationError(f"There is no DBC file {path}: {error.strerror}.") from error
    except (cantools.Error, ValueError, KeyError) as error:
        raise ConfigurationError(f"{path} must be a DBC file: {error}.") from error


@dataclass(frozen=True)
class _Reader:
    """Looks up names in the DBC file."""

    path: Path
    database: Database

    def signal(self, source: object, what: str) -> Signal:
        """Return the message and signal that a source names."""
        place = f"{what} of {self.path}"
        if not isinstance(source, str) or source[:1] != "/" or ":" not in source:
            raise ConfigurationError(f'{place} must be "/Message:Signal", got {source!r}.')
        message, _, signal = source[1:].partition(":")
        messages = {each.name: each for each in self.database.messages}
        check_name(f"message in {place}", message, messages)
        signals = [each.name for each in messages[message].signals]
        check_name(f"signal in {place}", signal, signals)
        return message, signal

    def table(self, given: Mapping[str, Any], name: str) -> Section:
        """Return a table of [can]."""
        return Section(given.get(name, {}), f"{name} of {self.path}")

    def phase(self, given: Mapping[str, Any], name: str) -> Mapping[Signal, float]:
        """Return the signals set in a phase."""
        phase = self.table(given, name)
        return {self.signal(key, name): phase.number(key, "", above=-inf) for key in phase.table}


def _checked(
    reader: _Reader, given: Mapping[str, Any], columns: Mapping[str, ColumnSource]
) -> DbcMapping:
    channels = {
        name: (reader.signal(column.source, f"columns.{name}"), column)
        for name, column in columns.items()
        if name in CHANNELS
    }
    for name in ("temperature", "v_bus"):
        if name in given:
            unit = CHANNELS[name][0]
            plain = ColumnSource(given[name], unit, unit, 1.0, 0.0, 0.0, None, None)
            channels[name] = (reader.signal(given[name], name), plain)
    wanted = [name for name in ("tau_cmd", "i_cmd") if name in columns]
    if len(wanted) > 1:
        raise ConfigurationError(f"{reader.path} must have tau_cmd or i_cmd, not both.")
    command = None
    if wanted:
        column = columns[wanted[0]]
        command = (reader.signal(column.source, f"columns.{wanted[0]}"), column)
    if not channels:
        raise ConfigurationError(
            f"{reader.path} must map at least one of {', '.join(CHANNELS)} to a signal."
        )
    state = reader.table(given, "state").table
    return DbcMapping(
        database=reader.database,
        channels=channels,
        command=command,
        is_current=wanted == ["i_cmd"],
        phases={name: reader.phase(given, name) for name in PHASES},
        state=reader.signal(state.get("source"), "state.source") if state else None,
        modes=_modes(reader.path, state),
        error=reader.signal(given["error"], "error") if "error" in given else None,
        cycles=_cycles(reader, given.get("cycle_ms", {})),
    )


def _modes(path: Path, state: Mapping[str, Any]) -> Mapping[Mode, tuple[int, ...]]:
    made = {}
    for name, values in state.items():
        if name == "source":
            continue
        check_name(f"mode in state of {path}", name, MODES)
        if not isinstance(values, list) or not all(isinstance(value, int) for value in values):
            raise ConfigurationError(
                f"{name} in state of {path} must be a list of whole numbers, got {values!r}."
            )
        made[MODES[name]] = tuple(values)
    return made


def _cycles(reader: _Reader, given: object) -> Mapping[str, float]:
    known = {each.name: each.cycle_time for each in reader.database.messages}
    table = Section(given, f"cycle_ms of {reader.path}", known)
    known |= {name: table.number(name, "ms") for name in table.table}
    return {name: ms * 1e-3 for name, ms in known.items() if ms}
