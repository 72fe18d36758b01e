"""From user input to the arrays of the kernel.

`resolve_effects` turns names or dictionaries of effects into complete, validated values;
`pack` turns a joint into one parameter record and its ripple rows.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import CjtGymWarning, ParameterError, check_name, unknown_name
from cjt_gym.joint.effects import EFFECTS, PLACES, Effect, EffectParameter, body_of
from cjt_gym.joint.files.effect_entries import (
    CHANNEL_VALUES,
    check_lengths,
    checked_value,
    usual_entries,
)
from cjt_gym.joint.files.joint_file import JointFile
from cjt_gym.joint.files.mistakes import Mistakes
from cjt_gym.joint.files.parameters import JointParameters, Quantity
from cjt_gym.joint.kernel.drives import NEEDED_PARAMETERS
from cjt_gym.joint.kernel.ripple import ripple_rows
from cjt_gym.joint.kernel.spring_table import spring_rows
from cjt_gym.joint.structures import Structure

EffectValue = float | tuple[float, ...]
EffectValues = dict[str, EffectValue]
EffectSpec = Mapping[str, Mapping[str, Any] | str] | Iterable[str] | str | None

ALL, TYPICAL = "all", "typical"
PEAK_CURRENT, PEAK_TORQUE = 10.0, 50.0
"""Of typical values for a joint whose file gives no peak current: [A], [N m]."""
BASE_FIELDS = (
    *("I_m", "I_g", "I_l", "k_g", "k_b", "d_m", "d_g", "d_l", "d_mg", "d_gl"),
    *("n", "k_t", "r", "l_a", "p", "v_0", "i_p"),
)
EFFECT_PARAMETERS = tuple(p for effect in EFFECTS.values() for p in effect.parameters)
FIELDS = tuple(dict.fromkeys((*BASE_FIELDS, *(f for p in EFFECT_PARAMETERS for f in p.fields))))
NEUTRAL = {f: p.neutral or 0.0 for p in EFFECT_PARAMETERS for f in p.fields}
PARAMETER_DTYPE = np.dtype([(name, np.float64) for name in FIELDS])


def resolve_effects(
    spec: EffectSpec, file: JointFile, structure: Structure, drive: str
) -> dict[str, EffectValues]:
    """Return every active effect with a value for each of its parameters, in the table's order.

    A value that is not given comes from the same effect in the joint file, then from the joint
    parameter or sensor it stands for, then from the table's default.

    Args:
        spec: None for the effects listed in the joint file, as far as they can act in the
            structure; a name, names, or a mapping of names to values for exactly these. Instead
            of values "typical" takes the table's typical ones where nothing is known. The name
            "all" adds all others that can act, likewise.
        file: The joint file.
        structure: Where they act.
        drive: Name of the drive.
    """
    given, assumed = _requested(spec, file)
    everything = given.pop(ALL, None) is not None
    for name in given:
        check_name("effect", name, EFFECTS)
    chosen = []
    for name in EFFECTS if everything else [name for name in EFFECTS if name in given]:
        effect = EFFECTS[name]
        if not effect.acts_in(structure, drive):
            if spec is None or name not in given:
                continue
            raise ParameterError(
                f"Effect {name} of {file.parameters.origin} needs {PLACES[effect.needs]}, got "
                f"structure {structure.name} with drive {drive}. Leave it out or choose another."
            )
        if name not in given and _lacks_nominal(effect, file.parameters):
            continue
        rivals = [other for other in effect.excludes if other in chosen or other in given]
        if rivals and name not in given:
            continue
        chosen.append(name)
    resolved: dict[str, EffectValues] = {}
    for name in chosen:
        effect = EFFECTS[name]
        for other in effect.excludes:
            if other in chosen:
                raise ParameterError(
                    f"Effects {name} and {other} of {file.parameters.origin} set the same levels. "
                    "Keep one of them."
                )
        typical = everything or name in assumed
        resolved[name] = _resolve_one(effect, given.get(name, {}), file, typical=typical)
    resolved = {
        name: values
        for name, values in resolved.items()
        if name in given or not _is_idle(EFFECTS[name], values, file.parameters)
    }
    said = {name: {**file.effects.get(name, {}), **given.get(name, {})} for name in resolved}
    _share(said, resolved, file)
    return resolved


def check_effects(file: JointFile, structure: Structure, drive: str) -> None:
    """Raise all mistakes in the effects that a joint file lists at once."""
    mistakes = Mistakes(file.parameters.origin)
    for name in file.effects:
        if EFFECTS[name].acts_in(structure, drive):
            with mistakes.collected():
                _resolve_one(EFFECTS[name], {}, file, typical=False)
    with mistakes.collected():
        resolve_effects(None, file, structure, drive)
    mistakes.check()


def _lacks_nominal(effect: Effect, p: JointParameters) -> bool:
    """Whether an effect replaces a parameter that the joint does not have."""
    replaced = [x.relative_to for x in effect.parameters if x.replaces and x.low > 0.0]
    return any(p.get(name or "", 0.0) == 0.0 for name in replaced)


def _requested(spec: EffectSpec, file: JointFile) -> tuple[dict[str, Mapping[str, Any]], set[str]]:
    """Return the requested effects with their values, and those that take typical values."""
    if spec is None:
        spec = file.effects
    elif isinstance(spec, str):
        spec = [spec]
    rows: Any = spec  # a table in a file may hold anything
    if not isinstance(rows, Mapping):
        names = list(rows) if isinstance(rows, Iterable) else [rows]
        if wrong := [name for name in names if not isinstance(name, str)]:
            raise ParameterError(
                f"Effects of {file.parameters.origin} must be names, or a mapping of names to "
                f"values, got {wrong[0]!r}."
            )
        rows = dict.fromkeys(names)
    for name, values in rows.items():
        if values != TYPICAL and not isinstance(values or {}, Mapping):
            raise ParameterError(
                f"Effect {name} of {file.parameters.origin} takes a mapping of its parameters "
                f'to values, or "{TYPICAL}", got {values!r}. Write '
                f"{{'{name}': {{'parameter': value}}}}."
            )
    assumed = {name for name, values in rows.items() if values == TYPICAL}
    given = {k: v if isinstance(v, Mapping) else {} for k, v in rows.items()}
    return given, assumed


def _share(
    given: Mapping[str, Mapping[str, Any]],
    resolved: dict[str, EffectValues],
    file: JointFile,
) -> None:
    """Give a parameter that is one number per joint the same value in all effects."""
    for symbol in {p.symbol for p in EFFECT_PARAMETERS if p.shared}:
        owners = [name for name, values in resolved.items() if symbol in values]
        said = {name: resolved[name][symbol] for name in owners if symbol in given[name]}
        if len(set(said.values())) > 1:
            raise ParameterError(
                f"{symbol} of {file.parameters.origin} is one number per joint, got {said}. "
                "Give the same value."
            )
        for name in owners if said else ():
            resolved[name][symbol] = next(iter(said.values()))


def _resolve_one(
    effect: Effect, values: Mapping[str, Any], file: JointFile, *, typical: bool
) -> EffectValues:
    listed = file.effects.get(effect.name, {})
    merged = {**_plain(effect, listed, file), **_plain(effect, values, file)}
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
            value = off_value(parameter, file.parameters)
        else:
            value = _fallback(effect, parameter, merged, file, typical=typical)
            if typical and np.all(np.asarray(value) == off_value(parameter, file.parameters)):
                value = typical_value(parameter, file.parameters)
        result[parameter.symbol] = checked_value(effect, parameter, value, file.parameters.origin)
    _check_whole(effect, result, set(effect.size) if typical else set(merged), file)
    return result


def _plain(effect: Effect, values: Mapping[str, Any], file: JointFile) -> dict[str, Any]:
    """Strip units and turn {channel, std | resolution} into {channel: value}."""
    p, noted = file.parameters, Mistakes(file.parameters.origin)
    usual = usual_entries(effect, values, p.axis, p.origin, noted)
    noted.check()
    plain = {k: v.value if isinstance(v, Quantity) else v for k, v in usual.items()}
    channel = plain.pop("channel", None)
    if channel is None:
        return plain
    check_name(f"channel of effect {effect.name}", channel, effect.channels)
    key = next((k for k in CHANNEL_VALUES if k in plain), None)
    if key is not None:
        plain[str(channel)] = plain.pop(key)
    for parameter in effect.parameters:
        if parameter.symbol in effect.channels:
            plain.setdefault(parameter.symbol, parameter.neutral)
    return plain


def off_value(parameter: EffectParameter, p: JointParameters) -> float:
    """Return the value of an effect's parameter at which the effect is off on this joint."""
    if parameter.relative_to is not None:
        return p.get(parameter.relative_to, 0.0)
    return parameter.neutral or 0.0


def typical_value(parameter: EffectParameter, p: JointParameters) -> EffectValue:
    """Return a material value of an effect's parameter on this joint.

    A joint without peak current counts as one of 10 A and 50 N m.
    """
    current = p.get("i_p", PEAK_CURRENT)
    scale = {
        "": 1.0,
        "current": current,
        "torque": p.get("k_t", 0.0) * p.get("n", 0.0) * current if "i_p" in p else PEAK_TORQUE,
    }.get(parameter.typical_of)
    if scale is None:
        scale = p.get(parameter.typical_of, 1.0)
    if parameter.relative_to is not None and parameter.typical == 0.0:
        return p.get(parameter.relative_to, 0.0)
    if isinstance(parameter.typical, tuple):
        return tuple(scale * x for x in parameter.typical)
    return scale * parameter.typical


def _fallback(
    effect: Effect,
    parameter: EffectParameter,
    merged: Mapping[str, Any],
    file: JointFile,
    *,
    typical: bool,
) -> Any:
    partner = (parameter.joint_parameter or "").removesuffix("_n")
    if partner in merged:  # a level that is given moves the one of the other direction along
        return merged[partner]
    stated = stated_by_file(parameter, file) or file.parameters.quantities.get(partner)
    if stated is not None:
        return stated.value
    if typical:
        return typical_value(parameter, file.parameters)
    if parameter.default is not None:
        return parameter.default
    if parameter.relative_to is not None and len(effect.size) > 1:
        return off_value(parameter, file.parameters)
    raise ParameterError(
        f"{effect.name}.{parameter.symbol} of {file.parameters.origin} is needed and absent "
        f"({parameter.description}, {parameter.unit}). Give it in effects={{'{effect.name}': "
        f"{{'{parameter.symbol}': ...}}}} or in the joint file under [effects.{effect.name}]; "
        f"{_typical_offer(effect)}."
    )


def _is_idle(effect: Effect, values: EffectValues, p: JointParameters) -> bool:
    size = [parameter for parameter in effect.parameters if parameter.symbol in effect.size]
    return all(np.all(np.asarray(values[x.symbol]) == off_value(x, p)) for x in size)


def _check_whole(effect: Effect, values: EffectValues, given: set[str], file: JointFile) -> None:
    """Reject series of unequal length, and effects without any known value."""
    owner = file.parameters.origin
    check_lengths(effect, values, owner)
    if not _is_idle(effect, values, file.parameters) or given & set(effect.size):
        return
    size = [p for p in effect.parameters if p.symbol in effect.size]
    if any(stated_by_file(p, file) is not None for p in size):
        warnings.warn(
            f"Effect {effect.name} of {owner} changes nothing: its values are those without it.",
            CjtGymWarning,
            stacklevel=2,
        )
        return
    names = ", ".join(f"{p.symbol} [{p.unit}]" for p in size)
    raise ParameterError(
        f"Effect {effect.name} of {owner} would do nothing: nothing is known of {names}. "
        f"Give one of them, or leave the effect out; {_typical_offer(effect)}."
    )


def _typical_offer(effect: Effect) -> str:
    return (
        f"or take typical values: effects={{'{effect.name}': '{TYPICAL}'}}, "
        f"--effect {effect.name}={TYPICAL}"
    )


def is_known(effect: Effect, file: JointFile) -> bool:
    """Return whether a joint file gives the values that switch an effect on."""
    size = [p for p in effect.parameters if p.symbol in effect.size]
    if effect.name in file.effects:
        return True
    if all(stated_by_file(p, file) is None for p in size):
        return False
    values = {
        p.symbol: checked_value(
            effect, p, _fallback(effect, p, {}, file, typical=False), file.parameters.origin
        )
        for p in effect.parameters
    }
    return not _is_idle(effect, values, file.parameters)


def stated_by_file(parameter: EffectParameter, file: JointFile) -> Quantity | None:
    """Return the value that the joint file gives outside the effect's own table."""
    source = parameter.joint_parameter or ""
    if source.startswith("sensors."):
        _, channel, key = source.split(".")
        return file.sensors.get(channel, {}).get(key)
    return file.parameters.quantities.get(source)


def pack(
    parameters: JointParameters,
    structure: Structure,
    drive: str,
    effects: Mapping[str, EffectValues],
) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    """Return the parameter record, shape (1,), and the ripple rows, shape (rows, 4).

    Effects add up: each adds to its fields what differs from its neutral value. Parameters that
    neither structure nor drive needs become zero; without a peak current the current is not
    limited.
    """
    record = np.zeros(1, PARAMETER_DTYPE)
    for name, value in NEUTRAL.items():
        record[name] = value
    for name in (*structure.needed_parameters, *NEEDED_PARAMETERS[drive], "I_m"):
        record[name] = getattr(parameters, name)
    for name in BASE_FIELDS:
        record[name] = parameters.get(name, 0.0)
    if "i_p" not in parameters:
        record["i_p"] = np.inf
    for name, values in effects.items():
        for parameter in EFFECTS[name].parameters:
            add_to(record[0], parameter, values[parameter.symbol])
    if not spring_rows(effects, parameters.origin).size:
        record["table_scale"] = 0.0
    return record, ripple_rows(effects)


def add_to(record: Any, parameter: EffectParameter, value: Any) -> None:
    """Add a parameter of an effect to a record, in place."""
    for field in parameter.fields:
        if parameter.replaces or parameter.shared:
            record[field] = value
        elif parameter.relative_to is not None:
            record[field] += value - record[parameter.relative_to]
        else:
            record[field] += value - (parameter.neutral or 0.0)


def plain_effects(effects: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of effects in a form for JSON."""
    return {
        name: {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
        for name, values in effects.items()
    }
