"""The text of a joint file, as `cjt_gym.joint.toml_format` reads it back."""

from __future__ import annotations

import re
from collections.abc import Mapping

from cjt_gym.disk import toml_text
from cjt_gym.joint.parameter_table import AXES
from cjt_gym.joint.quantity import Plain, Quantity, Setting
from cjt_gym.joint.toml_format import Document

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def write_document(document: Document) -> str:
    """Return the text of a joint file; `parse_document` reads it back to an equal document."""
    lines = [f"name = {toml_text(document.name)}", f"source = {toml_text(document.source)}"]
    if document.axis != AXES[0]:
        lines.append(f"axis = {toml_text(document.axis)}")
    for key in ("structure", "drive"):
        if (value := getattr(document, key)) is not None:
            lines.append(f"{key} = {toml_text(value)}")
    lines += _section("parameters", document.parameters)
    for effect, settings in document.effects.items():
        lines += _section(f"effects.{_key(effect)}", settings)
    for channel, entries in document.sensors.items():
        lines += _section(f"sensors.{_key(channel)}", entries)
    if document.sampling:
        lines += _section("sampling", document.sampling)
    if document.found:
        lines += ["", *_plain_table("found", document.found)]
    return "\n".join(lines) + "\n"


def _plain_table(title: str, table: Mapping[str, Plain]) -> list[str]:
    tables = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    lines = [f"[{title}]"]
    lines += [f"{_key(k)} = {_plain(v)}" for k, v in table.items() if k not in tables]
    for key, value in tables.items():
        lines += ["", *_plain_table(f"{title}.{_key(key)}", value)]
    return lines


def _plain(value: Plain) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return f"[{', '.join(map(_plain, value))}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(k)} = {_plain(v)}' for k, v in value.items())} }}"
    return toml_text(value) if isinstance(value, str) else repr(value)


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
    elif quantity.guess:
        parts.append("guess = true")
    if quantity.low is not None and quantity.high is not None:
        parts += [f"low = {_number(quantity.low)}", f"high = {_number(quantity.high)}"]
    if quantity.asymmetric:
        parts.append("asymmetric = true")
    return f"{{ {', '.join(parts)} }}"


def _number(value: float | tuple[float, ...]) -> str:
    return f"[{', '.join(map(repr, value))}]" if isinstance(value, tuple) else repr(value)


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else toml_text(key)
