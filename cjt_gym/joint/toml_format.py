"""The syntax of a joint file: TOML text to quantities and back.

What a value means is checked elsewhere: in `cjt_gym.joint.parameters` and by the effect table.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from cjt_gym.disk import parse_toml, toml_text
from cjt_gym.errors import ParameterError, did_you_mean
from cjt_gym.joint.parameter_table import AXES, SAMPLING_UNITS, SENSOR_KEYS, sensor_units
from cjt_gym.joint.quantity import FrozenMapping, Quantity, Setting, parse_quantity

__all__ = ["Document", "parse_document", "write_document"]

TOP_LEVEL_KEYS = ("name", "source", "axis", "parameters", "effects", "sensors", "sampling")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


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
    """

    name: str
    source: str
    axis: str
    parameters: FrozenMapping[Quantity]
    effects: FrozenMapping[FrozenMapping[Setting]]
    sensors: FrozenMapping[FrozenMapping[Quantity]]
    sampling: FrozenMapping[Quantity]


def parse_document(text: str, origin: str) -> Document:
    """Return the document that `text` holds.

    Args:
        text: Content of a joint file.
        origin: Where the text comes from, for messages.

    Raises:
        ParameterError: The text is no TOML, or a key is unknown, missing or malformed.
    """
    raw = _parse_toml(text, origin)
    _check_known(raw, TOP_LEVEL_KEYS, "key", origin)
    axis = _parse_axis(raw.get("axis", AXES[0]), origin)
    parameters = _table(raw, "parameters", origin)
    return Document(
        name=_required_text(raw, "name", origin),
        source=_required_text(raw, "source", origin),
        axis=axis,
        parameters=FrozenMapping(
            {s: parse_quantity(entry, f"{s} of {origin}") for s, entry in parameters.items()}
        ),
        effects=_parse_effects(_table(raw, "effects", origin), origin),
        sensors=_parse_sensors(_table(raw, "sensors", origin), axis, origin),
        sampling=_parse_sampling(_table(raw, "sampling", origin), origin),
    )


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


def _check_known(
    table: Mapping[str, object], known: tuple[str, ...], what: str, owner: str
) -> None:
    for key in table:
        if key not in known:
            raise ParameterError(
                f"{owner} has the unknown {what} '{key}'.{did_you_mean(key, known)} "
                f"Known: {', '.join(known)}."
            )


def _required_text(raw: Mapping[str, object], key: str, origin: str) -> str:
    value = raw.get(key)
    if key not in raw:
        raise ParameterError(f"{origin} lacks the key '{key}'. Add  {key} = \"...\"  at its top.")
    if not isinstance(value, str) or not value.strip():
        raise ParameterError(f"{key} of {origin} must be a text that is not empty, got {value!r}.")
    return value


def _parse_axis(value: object, origin: str) -> str:
    if value not in AXES:
        raise ParameterError(f'axis of {origin} must be "rotary" or "prismatic", got {value!r}.')
    return str(value)


def _table(raw: Mapping[str, object], key: str, owner: str) -> Mapping[str, object]:
    value = raw.get(key, {})
    if not isinstance(value, Mapping):
        raise ParameterError(
            f"{key} of {owner} must be a table, written as [{key}], got {value!r}."
        )
    return value


def _parse_effects(raw: Mapping[str, object], origin: str) -> FrozenMapping[FrozenMapping[Setting]]:
    effects = {}
    for effect in raw:
        settings = _table(raw, effect, f"[effects] of {origin}")
        owner = f"[effects.{effect}] of {origin}"
        effects[effect] = FrozenMapping(
            {key: _parse_setting(value, key, owner) for key, value in settings.items()}
        )
    return FrozenMapping(effects)


def _parse_setting(value: object, key: str, owner: str) -> Setting:
    if isinstance(value, str | bool):
        return value
    if isinstance(value, list) and value and all(isinstance(item, str) for item in value):
        for item in value:
            if value.count(item) > 1:
                raise ParameterError(f"{key} of {owner} names {item!r} twice. Keep one of them.")
        return tuple(value)
    return parse_quantity(value, f"{key} of {owner}")


def _parse_sensors(
    raw: Mapping[str, object], axis: str, origin: str
) -> FrozenMapping[FrozenMapping[Quantity]]:
    units = sensor_units(axis)
    _check_known(raw, tuple(units), "sensor channel", f"[sensors] of {origin}")
    sensors = {}
    for channel in raw:
        entries = _table(raw, channel, f"[sensors] of {origin}")
        owner = f"[sensors.{channel}] of {origin}"
        _check_known(entries, SENSOR_KEYS, "key", owner)
        sensors[channel] = FrozenMapping(
            {
                key: _non_negative(entry, f"{key} of {owner}", units[channel])
                for key, entry in entries.items()
            }
        )
    return FrozenMapping(sensors)


def _parse_sampling(raw: Mapping[str, object], origin: str) -> FrozenMapping[Quantity]:
    owner = f"[sampling] of {origin}"
    _check_known(raw, tuple(SAMPLING_UNITS), "key", owner)
    return FrozenMapping(
        {
            key: _non_negative(entry, f"{key} of {owner}", (SAMPLING_UNITS[key],))
            for key, entry in raw.items()
        }
    )


def _non_negative(entry: object, owner: str, units: tuple[str, ...]) -> Quantity:
    quantity = parse_quantity(entry, owner)
    if quantity.unit not in units:
        raise ParameterError(
            f"{owner} must be in {' or '.join(units)}, got the unit '{quantity.unit}'. "
            f'Convert the value and write  unit = "{units[0]}".'
        )
    if isinstance(quantity.value, tuple) or quantity.value < 0.0:
        raise ParameterError(
            f"{owner} must be one number >= 0 {quantity.unit}, got {quantity.value}."
        )
    return quantity


def write_document(document: Document) -> str:
    """Return the text of a joint file; `parse_document` reads it back to an equal document."""
    lines = [f"name = {toml_text(document.name)}", f"source = {toml_text(document.source)}"]
    if document.axis != AXES[0]:
        lines.append(f"axis = {toml_text(document.axis)}")
    lines += _section("parameters", document.parameters)
    for effect, settings in document.effects.items():
        lines += _section(f"effects.{_key(effect)}", settings)
    for channel, entries in document.sensors.items():
        lines += _section(f"sensors.{_key(channel)}", entries)
    if document.sampling:
        lines += _section("sampling", document.sampling)
    return "\n".join(lines) + "\n"


def _section(title: str, settings: Mapping[str, Setting]) -> list[str]:
    return [
        "",
        f"[{title}]",
        *(f"{_key(key)} = {_setting(value)}" for key, value in settings.items()),
    ]


def _setting(value: Setting) -> str:
    if isinstance(value, Quantity):
        return _quantity(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return f"[{', '.join(toml_text(item) for item in value)}]"
    return toml_text(value)


def _quantity(quantity: Quantity) -> str:
    parts = [f"value = {_number(quantity.value)}", f"unit = {toml_text(quantity.unit)}"]
    if quantity.source:
        parts.append(f"source = {toml_text(quantity.source)}")
    if quantity.tolerance is not None:
        parts.append(f"tolerance = {quantity.tolerance!r}")
    if quantity.low is not None and quantity.high is not None:
        parts += [f"low = {_number(quantity.low)}", f"high = {_number(quantity.high)}"]
    if quantity.asymmetric:
        parts.append("asymmetric = true")
    return f"{{ {', '.join(parts)} }}"


def _number(value: float | tuple[float, ...]) -> str:
    return f"[{', '.join(map(repr, value))}]" if isinstance(value, tuple) else repr(value)


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else toml_text(key)
