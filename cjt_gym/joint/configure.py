"""From what a person writes to what the kernel reads.

`resolve_effects` turns names or dictionaries of effects into complete, validated values;
`pack` turns a joint into one parameter record and its ripple rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ParameterError, unknown_name
from cjt_gym.joint.drives import NEEDED_PARAMETERS
from cjt_gym.joint.effects import EFFECTS, Effect, EffectParameter, body_of
from cjt_gym.joint.files import JointFile
from cjt_gym.joint.parameters import JointParameters, Quantity
from cjt_gym.joint.ripple import ADDITIVE, PROPORTIONAL
from cjt_gym.joint.structures import Structure

EffectValue = float | tuple[float, ...]
EffectValues = dict[str, EffectValue]
EffectSpec = Mapping[str, Mapping[str, Any]] | Iterable[str] | str | None

BASE_FIELDS = (
    *("I_m", "I_g", "I_l", "k_g", "k_b", "d_m", "d_g", "d_l", "d_mg", "d_gl"),
    *("n", "k_t", "r", "l_a", "p", "v_0", "i_p"),
)
EFFECT_FIELDS = tuple(
    dict.fromkeys(f for effect in EFFECTS.values() for p in effect.parameters for f in p.fields)
)
FIELDS = (*BASE_FIELDS, *EFFECT_FIELDS)
PARAMETER_DTYPE = np.dtype([(name, np.float64) for name in FIELDS])
RIPPLES = {"cogging": ADDITIVE, "gear_ripple": PROPORTIONAL}


def resolve_effects(spec: EffectSpec, file: JointFile) -> dict[str, EffectValues]:
    """Return every active effect with a value for each of its parameters.

    A value that is not given comes from the same effect in the joint file, then from the joint
    parameter or sensor it stands for, then from the table's default.

    Args:
        spec: None for the effects listed in the joint file; a name, names, or a mapping of
            names to values for exactly these.
        file: The joint file.

    Raises:
        UnknownNameError: An effect or one of its parameters is not in the table.
        ParameterError: A value is missing, not finite, out of its domain or without effect.
    """
    if spec is None:
        spec = file.effects
    elif isinstance(spec, str):
        spec = [spec]
    given: dict[str, Mapping[str, Any]] = (
        {name: values or {} for name, values in spec.items()}
        if isinstance(spec, Mapping)
        else {name: {} for name in spec}
    )
    resolved: dict[str, EffectValues] = {}
    for name, values in given.items():
        if name not in EFFECTS:
            raise unknown_name("effect", name, EFFECTS)
        effect = EFFECTS[name]
        for other in effect.excludes:
            if other in given:
                raise ParameterError(
                    f"Effects {name} and {other} of {file.parameters.origin} set the same levels. "
                    "Keep one of them."
                )
        resolved[name] = _resolve_one(effect, values, file)
    return resolved


def _resolve_one(effect: Effect, values: Mapping[str, Any], file: JointFile) -> EffectValues:
    merged = {**_plain(effect, file.effects.get(effect.name, {})), **_plain(effect, values)}
    body = merged.pop("body", None)
    if body is not None and (body not in effect.bodies):
        raise unknown_name(f"body of effect {effect.name}", str(body), effect.bodies)
    for symbol in merged:
        if effect.parameter(symbol) is None:
            known = [p.symbol for p in effect.parameters]
            raise unknown_name(f"parameter of effect {effect.name}", symbol, known)
    result: EffectValues = {}
    for parameter in effect.parameters:
        if parameter.symbol in merged:
            value = merged[parameter.symbol]
        elif body is not None and body_of(parameter.symbol) not in (None, body):
            value = _off(parameter, file.parameters)
        else:
            value = _fallback(effect, parameter, merged, file)
        result[parameter.symbol] = _checked(effect, parameter, value, file)
    _check_whole(effect, result, file)
    return result


def _plain(effect: Effect, values: Mapping[str, Any]) -> dict[str, Any]:
    """Strip units and turn {channel, std | resolution} into {channel: value}."""
    plain = {k: v.value if isinstance(v, Quantity) else v for k, v in values.items()}
    channel = plain.pop("channel", None)
    if channel is None:
        return plain
    if channel not in effect.channels:
        raise unknown_name(f"channel of effect {effect.name}", str(channel), effect.channels)
    key = next((k for k in ("std", "noise", "resolution", "value") if k in plain), None)
    if key is not None:
        plain[channel] = plain.pop(key)
    for other in effect.channels:
        plain.setdefault(other, 0.0)
    return plain


def _off(parameter: EffectParameter, p: JointParameters) -> float:
    if parameter.relative_to is not None:
        return p.get(parameter.relative_to, 0.0)
    return parameter.neutral or 0.0


def _fallback(
    effect: Effect, parameter: EffectParameter, merged: Mapping[str, Any], file: JointFile
) -> Any:
    source = parameter.joint_parameter
    if source is not None and source.startswith("sensors."):
        _, channel, key = source.split(".")
        quantity = file.sensors.get(channel, {}).get(key)
        if quantity is not None:
            return quantity.value
    elif source is not None:
        partner = source.removesuffix("_n")
        if partner in merged:  # a level that is given moves the one of the other direction along
            return merged[partner]
        if source in file.parameters:
            return file.parameters.get(source, 0.0)
        if partner in file.parameters:
            return file.parameters.get(partner, 0.0)
    if parameter.default is not None:
        return parameter.default
    if parameter.relative_to is not None:
        return _off(parameter, file.parameters)
    raise ParameterError(
        f"{effect.name}.{parameter.symbol} of {file.parameters.origin} is needed and absent "
        f"({parameter.description}, {parameter.unit}). Give it in effects={{'{effect.name}': "
        f"{{'{parameter.symbol}': ...}}}} or in the joint file under [effects.{effect.name}]."
    )


def _checked(
    effect: Effect, parameter: EffectParameter, value: Any, file: JointFile
) -> EffectValue:
    where = f"{effect.name}.{parameter.symbol} of {file.parameters.origin}"
    if parameter.series:
        try:
            series = tuple(float(x) for x in np.atleast_1d(np.asarray(value, dtype=np.float64)))
        except (TypeError, ValueError):
            raise ParameterError(
                f"{where} must be a list of numbers [{parameter.unit}], got {value!r}."
            ) from None
        if not all(math.isfinite(x) for x in series):
            raise ParameterError(f"{where} must be finite {parameter.unit}, got {value}.")
        return series
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ParameterError(
            f"{where} must be a number [{parameter.unit}], got {value!r}."
        ) from None
    if not math.isfinite(number):
        raise ParameterError(f"{where} must be finite {parameter.unit}, got {number}.")
    if parameter.low >= 0.0 > number:
        raise ParameterError(f"{where} must be >= 0 {parameter.unit}, got {number:g}.")
    return number


def _check_whole(effect: Effect, values: EffectValues, file: JointFile) -> None:
    """Refuse series of unequal length and an effect that would do nothing."""
    owner = file.parameters.origin
    series = {p.symbol: values[p.symbol] for p in effect.parameters if p.series}
    lengths = {symbol: len(v) for symbol, v in series.items() if isinstance(v, tuple)}
    if len(set(lengths.values())) > 1:
        raise ParameterError(
            f"The series of effect {effect.name} of {owner} must be of equal length, got {lengths}."
        )
    size = [p for p in effect.parameters if p.symbol not in ("dq_0", "f", "scale")]
    if all(not np.any(values[p.symbol]) and not _off(p, file.parameters) for p in size):
        names = ", ".join(f"{p.symbol} [{p.unit}]" for p in size)
        raise ParameterError(
            f"Effect {effect.name} of {owner} would do nothing: all of {names} are zero or absent. "
            "Give one of them, or leave the effect out."
        )


def pack(
    parameters: JointParameters,
    structure: Structure,
    drive: str,
    effects: Mapping[str, EffectValues],
) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    """Return the parameter record, shape (1,), and the ripple rows, shape (rows, 4).

    Parameters that neither structure nor drive needs become zero; without a peak current the
    current is not limited.

    Raises:
        ParameterError: The joint lacks a parameter that the structure or the drive needs.
    """
    record = np.zeros(1, PARAMETER_DTYPE)
    for name in (*structure.needed_parameters, *NEEDED_PARAMETERS[drive], "I_m"):
        record[name] = getattr(parameters, name)
    for name in BASE_FIELDS:
        if name in parameters:
            record[name] = getattr(parameters, name)
    if "i_p" not in parameters:
        record["i_p"] = np.inf
    for name, values in effects.items():
        for parameter in EFFECTS[name].parameters:
            value = values[parameter.symbol]
            for field in parameter.fields:
                offset = record[parameter.relative_to][0] if parameter.relative_to else 0.0
                record[field] = float(value) - offset  # type: ignore[arg-type]
    return record, _ripple_rows(effects)


def _ripple_rows(effects: Mapping[str, EffectValues]) -> NDArray[np.float64]:
    rows: list[tuple[float, float, float, float]] = []
    for name, kind in RIPPLES.items():
        if name in effects:
            values = effects[name]
            columns = [np.atleast_1d(values[symbol]) for symbol in ("f", "a", "b")]
            rows += [(f, a, b, kind) for f, a, b in zip(*columns, strict=True)]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)
