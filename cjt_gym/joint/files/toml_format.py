"""The syntax of a joint file: TOML text to quantities; `joint_file.to_toml` is the way back.

What a value means is checked elsewhere: in `parameters` and by the effect table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeVar

from cjt_gym.disk import parse_toml
from cjt_gym.errors import ParameterError, unknown_key
from cjt_gym.joint.files.mistakes import Mistakes
from cjt_gym.joint.files.parameter_table import AXES, SAMPLING_KEYS, SENSOR_KEYS, sensor_units
from cjt_gym.joint.files.quantity import Quantity, Setting, parse_quantity
from cjt_gym.joint.files.units import in_usual_unit

TOP_LEVEL_KEYS = (
    *("name", "source", "axis", "structure", "drive"),
    *("parameters", "effects", "sensors", "sampling", "found"),
)

Entry = TypeVar("Entry")


def parse_document(text: str, origin: str, mistakes: Mistakes) -> dict[str, Any]:
    """Return the content of a joint file, with checked syntax.

    Returns:
        `name`, `source` and `axis` as texts; `structure` and `drive` likewise, or None; quantities
        by symbol in `parameters` and `sampling`; settings by effect, then by parameter in `effects`
        ("body" and "channel" are texts); quantities by channel, then "resolution" and "noise" in
        `sensors`; plain data in `found`.
    """
    raw = _parse_toml(text, origin)
    known = _known(raw, TOP_LEVEL_KEYS, "key", origin, mistakes)
    axis: Any = known.get("axis", AXES[0])
    if axis not in AXES:
        mistakes.found.append(f'axis of {origin} must be "rotary" or "prismatic", got {axis!r}.')
        axis = AXES[0]
    tables = {
        name: _table(known, name, origin, mistakes)
        for name in ("parameters", "effects", "sensors", "sampling", "found")
    }
    return {
        "name": _text(known, "name", origin, mistakes, required=True) or "",
        "source": _text(known, "source", origin, mistakes, required=True) or "",
        "axis": axis,
        "parameters": _entries(tables["parameters"], parse_quantity, origin, mistakes),
        "effects": _parse_effects(tables["effects"], origin, mistakes),
        "sensors": _parse_sensors(tables["sensors"], axis, origin, mistakes),
        "sampling": _parse_sampling(tables["sampling"], origin, mistakes),
        "structure": _text(known, "structure", origin, mistakes),
        "drive": _text(known, "drive", origin, mistakes),
        "found": tables["found"],
    }


def _parse_toml(text: str, origin: str) -> dict[str, object]:
    try:
        return parse_toml(text, origin, ParameterError)
    except ParameterError as error:
        raise ParameterError(
            f"{error} It is not valid TOML: a key or table stands only once, a text needs quotes."
        ) from error


def _known(
    table: Mapping[str, object], known: tuple[str, ...], what: str, owner: str, mistakes: Mistakes
) -> dict[str, object]:
    """Return the entries of a table whose keys are known."""
    for key in table:
        if key not in known:
            mistakes.found.append(unknown_key(owner, key, known, what))
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
) -> dict[str, dict[str, Setting]]:
    effects = {}
    for effect in raw:
        settings = _table(raw, effect, f"[effects] of {origin}", mistakes)
        owner = f"[effects.{effect}] of {origin}"
        effects[effect] = _entries(settings, _parse_setting, owner, mistakes)
    return effects


def _parse_setting(value: object, owner: str) -> Setting:
    return value if isinstance(value, str) else parse_quantity(value, owner)


def _parse_sensors(
    raw: Mapping[str, object], axis: str, origin: str, mistakes: Mistakes
) -> dict[str, dict[str, Quantity]]:
    units = sensor_units(axis)
    known = _known(raw, tuple(units), "sensor channel", f"[sensors] of {origin}", mistakes)
    sensors = {}
    for channel in known:
        owner = f"[sensors.{channel}] of {origin}"
        table = _table(known, channel, f"[sensors] of {origin}", mistakes)
        parse = partial(_non_negative, units=units[channel])
        entries = _known(table, SENSOR_KEYS, "key", owner, mistakes)
        sensors[channel] = _entries(entries, parse, owner, mistakes)
    return sensors


def _parse_sampling(
    raw: Mapping[str, object], origin: str, mistakes: Mistakes
) -> dict[str, Quantity]:
    owner = f"[sampling] of {origin}"
    known = _known(raw, SAMPLING_KEYS, "key", owner, mistakes)
    return _entries(known, partial(_non_negative, units=("s",)), owner, mistakes)


def _non_negative(entry: object, owner: str, units: tuple[str, ...]) -> Quantity:
    quantity = in_usual_unit(parse_quantity(entry, owner), units, owner)
    if isinstance(quantity.value, tuple) or quantity.value < 0.0:
        raise ParameterError(
            f"{owner} must be one number >= 0 {quantity.unit}, got {quantity.value}."
        )
    return quantity
