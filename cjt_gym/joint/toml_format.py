"""The syntax of a joint file: TOML text to quantities; `toml_writer` has the way back.

What a value means is checked elsewhere: in `cjt_gym.joint.parameters` and by the effect table.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

from cjt_gym.disk import parse_toml
from cjt_gym.errors import ParameterError, did_you_mean
from cjt_gym.joint.mistakes import Mistakes
from cjt_gym.joint.parameter_table import AXES, SAMPLING_UNITS, SENSOR_KEYS, sensor_units
from cjt_gym.joint.quantity import (
    FrozenMapping,
    Plain,
    Quantity,
    Setting,
    freeze,
    parse_quantity,
)
from cjt_gym.joint.units import in_usual_unit

__all__ = ["Document", "parse_document"]

TOP_LEVEL_KEYS = (
    *("name", "source", "axis", "structure", "drive"),
    *("parameters", "effects", "sensors", "sampling", "found"),
)

Entry = TypeVar("Entry")


@dataclass(frozen=True)
class Document:
    """The content of a joint file, with checked syntax.

    Attributes:
        name: Name of the joint.
        source: Where the joint comes from.
        axis: "rotary" or "prismatic".
        parameters: Quantities by symbol.
        effects: Settings by effect, then by parameter; "body" and "channel" are texts.
        sensors: Quantities by channel, then "resolution" and "noise".
        sampling: Quantities by "dt", "dt_electrical", "jitter".
        structure: Name of the structure that the joint has unless told otherwise, or None.
        drive: Name of its drive, or None.
        found: What a diagnosis says of how it found the values, as plain data.
    """

    name: str
    source: str
    axis: str
    parameters: FrozenMapping[Quantity]
    effects: FrozenMapping[FrozenMapping[Setting]]
    sensors: FrozenMapping[FrozenMapping[Quantity]]
    sampling: FrozenMapping[Quantity]
    structure: str | None = None
    drive: str | None = None
    found: FrozenMapping[Plain] = field(default_factory=FrozenMapping)


def parse_document(text: str, origin: str, mistakes: Mistakes | None = None) -> Document:
    """Return the document that `text` holds.

    Args:
        text: Content of a joint file.
        origin: Where the text comes from, for messages.
        mistakes: Takes what is wrong with single entries, which the document then lacks; without
            it that is raised.

    Raises:
        ParameterError: The text is no TOML, or a key is unknown, missing or malformed.
    """
    raw = _parse_toml(text, origin)
    noted = Mistakes(origin) if mistakes is None else mistakes
    known = _known(raw, TOP_LEVEL_KEYS, "key", origin, noted)
    axis = AXES[0]
    with noted.collected():
        axis = _parse_axis(known.get("axis", axis), origin)
    parameters = _table(known, "parameters", origin, noted)
    document = Document(
        name=_text(known, "name", origin, noted, required=True) or "",
        source=_text(known, "source", origin, noted, required=True) or "",
        axis=axis,
        parameters=FrozenMapping(_entries(parameters, parse_quantity, origin, noted)),
        effects=_parse_effects(_table(known, "effects", origin, noted), origin, noted),
        sensors=_parse_sensors(_table(known, "sensors", origin, noted), axis, origin, noted),
        sampling=_parse_sampling(_table(known, "sampling", origin, noted), origin, noted),
        structure=_text(known, "structure", origin, noted),
        drive=_text(known, "drive", origin, noted),
        found=freeze(_table(known, "found", origin, noted)),
    )
    if mistakes is None:
        noted.check()
    return document


def _parse_toml(text: str, origin: str) -> dict[str, object]:
    try:
        return parse_toml(text, origin, ParameterError)
    except ParameterError as error:
        raise ParameterError(_toml_message(str(error), origin)) from error


def _toml_message(message: str, origin: str) -> str:
    channel = re.search(r"Cannot declare \('sensors', '(\w+)'\) twice", message)
    if channel:
        return (
            f"The sensor channel {channel[1]} stands twice in {origin}. Keep one of the two "
            f"tables. {message}"
        )
    return (
        f"{message} It is not valid TOML: a key or table may stand only once, a text needs quotes."
    )


def _known(
    table: Mapping[str, object], known: tuple[str, ...], what: str, owner: str, mistakes: Mistakes
) -> dict[str, object]:
    """Return the entries of a table whose keys are known."""
    for key in table:
        if key not in known:
            mistakes.found.append(
                f"{owner} has the unknown {what} '{key}'.{did_you_mean(key, known)} "
                f"Known: {', '.join(known)}."
            )
    return {key: value for key, value in table.items() if key in known}


def _entries(
    table: Mapping[str, object],
    parse: Callable[[object, str], Entry],
    owner: str,
    mistakes: Mistakes,
) -> dict[str, Entry]:
    """Return the entries of a table that can be parsed."""
    found = {}
    for key, entry in table.items():
        with mistakes.collected():
            found[key] = parse(entry, f"{key} of {owner}")
    return found


def _text(
    raw: Mapping[str, object], key: str, origin: str, mistakes: Mistakes, required: bool = False
) -> str | None:
    value = raw.get(key)
    if isinstance(value, str) and value.strip():
        return value
    if key in raw:
        mistakes.found.append(f"{key} of {origin} must be a text that is not empty, got {value!r}.")
    elif required:
        mistakes.found.append(f"{origin} lacks the key '{key}'. Add  {key} = \"...\"  at its top.")
    return None


def _parse_axis(value: object, origin: str) -> str:
    if value not in AXES:
        raise ParameterError(f'axis of {origin} must be "rotary" or "prismatic", got {value!r}.')
    return str(value)


def _table(
    raw: Mapping[str, object], key: str, owner: str, mistakes: Mistakes
) -> Mapping[str, object]:
    value = raw.get(key, {})
    if isinstance(value, Mapping):
        return value
    mistakes.found.append(f"{key} of {owner} must be a table, written as [{key}], got {value!r}.")
    return {}


def _parse_effects(
    raw: Mapping[str, object], origin: str, mistakes: Mistakes
) -> FrozenMapping[FrozenMapping[Setting]]:
    effects = {}
    for effect in raw:
        settings = _table(raw, effect, f"[effects] of {origin}", mistakes)
        owner = f"[effects.{effect}] of {origin}"
        effects[effect] = FrozenMapping(_entries(settings, _parse_setting, owner, mistakes))
    return FrozenMapping(effects)


def _parse_setting(value: object, owner: str) -> Setting:
    if isinstance(value, str | bool):
        return value
    if isinstance(value, list) and value and all(isinstance(item, str) for item in value):
        for item in value:
            if value.count(item) > 1:
                raise ParameterError(f"{owner} names {item!r} twice. Keep one of them.")
        return tuple(value)
    return parse_quantity(value, owner)


def _parse_sensors(
    raw: Mapping[str, object], axis: str, origin: str, mistakes: Mistakes
) -> FrozenMapping[FrozenMapping[Quantity]]:
    units = sensor_units(axis)
    known = _known(raw, tuple(units), "sensor channel", f"[sensors] of {origin}", mistakes)
    sensors = {}
    for channel in known:
        owner = f"[sensors.{channel}] of {origin}"
        table = _table(known, channel, f"[sensors] of {origin}", mistakes)
        parse = partial(_non_negative, units=units[channel])
        entries = _known(table, SENSOR_KEYS, "key", owner, mistakes)
        sensors[channel] = FrozenMapping(_entries(entries, parse, owner, mistakes))
    return FrozenMapping(sensors)


def _parse_sampling(
    raw: Mapping[str, object], origin: str, mistakes: Mistakes
) -> FrozenMapping[Quantity]:
    owner = f"[sampling] of {origin}"
    known = _known(raw, tuple(SAMPLING_UNITS), "key", owner, mistakes)
    return FrozenMapping(_entries(known, partial(_non_negative, units=("s",)), owner, mistakes))


def _non_negative(entry: object, owner: str, units: tuple[str, ...]) -> Quantity:
    quantity = in_usual_unit(parse_quantity(entry, owner), units, owner)
    if isinstance(quantity.value, tuple) or quantity.value < 0.0:
        raise ParameterError(
            f"{owner} must be one number >= 0 {quantity.unit}, got {quantity.value}."
        )
    return quantity
