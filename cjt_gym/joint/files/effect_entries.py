"""The entries under [effects.*] of a joint file, checked against the effect table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cjt_gym.errors import ParameterError, unknown_name
from cjt_gym.joint.effects import EFFECTS, Effect, EffectParameter
from cjt_gym.joint.files.mistakes import Mistakes
from cjt_gym.joint.files.parameter_table import axis_units
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity, Setting
from cjt_gym.joint.files.units import in_usual_unit

SELECTORS = ("body", "channel")
CHANNEL_VALUES = ("std", "noise", "resolution", "value")
"""Names for the value of the channel that an entry `channel` selects."""


def usual_effects(
    effects: Mapping[str, Mapping[str, Setting]], axis: str, origin: str, mistakes: Mistakes
) -> dict[str, dict[str, Setting]]:
    """Return the entries of effects with their values in the usual units."""
    found = {}
    for name, entries in effects.items():
        if name not in EFFECTS:
            mistakes.found.append(f"[effects] of {origin}: {unknown_name('effect', name, EFFECTS)}")
            continue
        effect = EFFECTS[name]
        for key in entries:
            if not _is_known(effect, key, entries):
                known = [p.symbol for p in effect.parameters]
                text = unknown_name(f"parameter of effect {name}", key, known)
                mistakes.found.append(f"{key} of [effects.{name}] of {origin}: {text}")
        found[name] = usual_entries(effect, entries, axis, origin, mistakes)
    return found


def usual_entries(
    effect: Effect, entries: Mapping[str, Any], axis: str, origin: str, mistakes: Mistakes
) -> dict[str, Any]:
    """Return the entries of one effect likewise; numbers and unknown keys stay as they are."""
    kept = {}
    for key, entry in entries.items():
        row = _parameter(effect, key, entries)
        with mistakes.collected():
            if row is not None and isinstance(entry, Quantity):
                owner = f"{key} of [effects.{effect.name}] of {origin}"
                entry = in_usual_unit(entry, units_of(row, axis), owner)
                checked_value(effect, row, entry.value, origin)
            kept[key] = entry
    return kept


def checked_value(effect: Effect, parameter: EffectParameter, value: Any, origin: str) -> Any:
    """Return a value as a float, or a tuple of them for a series, if it is in its domain."""
    where = f"{effect.name}.{parameter.symbol} of {origin}"
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    if numbers.ndim > int(parameter.series) or not np.isfinite(numbers).all():
        kind = "a list of finite numbers" if parameter.series else "a finite number"
        raise ParameterError(f"{where} must be {kind} [{parameter.unit}], got {value!r}.")
    low, strict, high = effect.domain(parameter)
    for number in np.atleast_1d(numbers).tolist():
        if number < low or (strict and number == low):
            bound = f"{'>' if strict else '>='} {low:g}"
        elif number > high:
            bound = f"<= {high:g}"
        else:
            continue
        raise ParameterError(f"{where} must be {bound} {parameter.unit}, got {number:g}.")
    return tuple(np.atleast_1d(numbers).tolist()) if parameter.series else float(numbers)


def check_lengths(effect: Effect, values: Mapping[str, Any], origin: str) -> None:
    """Raise an error if the series of an effect are of unequal length."""
    series = {p.symbol: values.get(p.symbol) for p in effect.parameters if p.series}
    lengths = {symbol: len(v) for symbol, v in series.items() if isinstance(v, tuple)}
    if len(set(lengths.values())) > 1:
        raise ParameterError(
            f"The series of effect {effect.name} of {origin} must be of equal length, got "
            f"{lengths}."
        )


def _is_known(effect: Effect, key: str, entries: Mapping[str, Any]) -> bool:
    selects = key in SELECTORS or (key in CHANNEL_VALUES and "channel" in entries)
    return selects or effect.parameter(key) is not None


def units_of(parameter: EffectParameter, axis: str) -> tuple[str, ...]:
    """Return the units allowed for a number of an effect, the standard one first."""
    return tuple(dict.fromkeys((*axis_units(parameter.unit, axis), parameter.unit)))


def unit_on(parameter: EffectParameter, p: JointParameters) -> str:
    """Return the usual unit of a number of an effect on a joint."""
    if parameter.symbol == "k_t":
        return p.unit("k_t")
    units = axis_units(parameter.unit, p.axis)
    return units[-1] if p.takes_volts else units[0]


def _parameter(effect: Effect, key: str, entries: Mapping[str, Setting]) -> EffectParameter | None:
    """Return the row of an entry; that of the selected channel for the names of its value."""
    channel = entries.get("channel")
    if isinstance(channel, str) and key in CHANNEL_VALUES:
        return effect.parameter(channel)
    return effect.parameter(key)
