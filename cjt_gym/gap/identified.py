"""The joint that a diagnosis found: the nominal joint file with the named effects added.

The named numbers become rows of the effect table, each with its 95 % interval. Datasheet values
that the record determines better than their tolerance are refined: value and tolerance are then
those of the fit. Angles are those of the record, not relative to its first sample.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from cjt_gym.gap.candidates.nuisances import FRICTION, WEIGHT
from cjt_gym.gap.diagnosis import NamedEffect, told_symbols
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.recorded.spring_damping import NOT_STATED
from cjt_gym.gap.recorded.tolerances import OF_TORQUE, common_deviation
from cjt_gym.gap.stages.as_rows import ROWS, Found, Number, in_symbols
from cjt_gym.joint import EFFECTS, Effect, JointFile
from cjt_gym.joint.effects import body_of
from cjt_gym.joint.files.effect_entries import unit_on
from cjt_gym.joint.files.quantity import WIDEST, Quantity
from cjt_gym.joint.files.quantity import Setting as Entry

ASYMMETRIC, SMOOTHED = "coulomb_asym", "dq_0"
TOLERATED = 3.0
"""Number of tolerances up to which a refined value is said to keep to the datasheet."""
OF_SENSORS = ("noise", "quantization")
IDENTIFIED = "_identified"
Refined = Mapping[str, tuple[float, float]]
Table = dict[str, dict[str, Entry]]


def identified_joint(
    setting: Setting,
    fields: Fields,
    named: Sequence[NamedEffect],
    refined: Refined,
    record: str,
) -> JointFile:
    """Return the nominal joint with the named effects added.

    Args:
        setting: The record that was explained, with the nominal joint.
        fields: The model that explains it.
        named: The effects to add.
        refined: Fitted datasheet values by symbol, each with its relative deviation; "lag" [s] is
            that of a current loop whose bandwidth the file states.
        record: Name of the record, for the entries' sources.
    """
    joint, source = setting.joint, f"identified from {record}"
    table: Table = {name: dict(entries) for name, entries in joint.effects.items()}
    asymmetric = _is_asymmetric(joint, named)
    if asymmetric and "coulomb" in table:
        table[ASYMMETRIC] = _both_ways(table.pop("coulomb"))
    for effect in named:
        if effect.name in OF_SENSORS:
            continue
        found = Found(setting, fields, effect, asymmetric)
        for name, numbers in ROWS[effect.name](found).items():
            _put(table, EFFECTS[name], effect.body, numbers, joint, source)
    _share_smoothing(table, joint)
    if "lag" in refined and "current_lag" not in {effect.name for effect in named}:
        _refine_lag(table, *refined["lag"], source)
    common = common_deviation(joint, cut=setting.cut is Cut.BY_TORQUE, but=told_symbols(named))
    if "coulomb" not in {effect.name for effect in named}:
        _refine_friction(table, refined, source)
    if "gravity" not in {effect.name for effect in named}:
        _refine_weight(table, refined, source, common)
    p = joint.parameters
    known = {
        symbol: (value, rounded(math.hypot(own, common)) if symbol.startswith(OF_TORQUE) else own)
        for symbol, (value, own) in refined.items()
        if symbol in p.quantities
    }
    parameters = replace(
        p,
        name=identified(p.name),
        source=f"{p.source}; effects {source}" if named else p.source,
        quantities={**p.quantities, **_refined(p.quantities, known, source)},
    )
    new = replace(joint, parameters=parameters, effects=table, structure=setting.structure.name)
    return with_sensors(new, named, record)


def identified(name: str) -> str:
    """Return the name of the joint that a diagnosis of a joint found."""
    return name if name.endswith(IDENTIFIED) else name + IDENTIFIED


def told_by(
    setting: Setting, fields: Fields, named: Sequence[NamedEffect]
) -> tuple[NamedEffect, ...]:
    """Return effects with the numbers of the joint file, as a diagnosis states them."""
    asymmetric = _is_asymmetric(setting.joint, named)
    return tuple(in_symbols(Found(setting, fields, effect, asymmetric)) for effect in named)


def _is_asymmetric(joint: JointFile, named: Sequence[NamedEffect]) -> bool:
    """Return whether the joint's Coulomb friction has a level for each direction."""
    return ASYMMETRIC in joint.effects or any(effect.name == ASYMMETRIC for effect in named)


def _both_ways(entries: Mapping[str, Entry]) -> dict[str, Entry]:
    """Return symmetric Coulomb friction written with one level per direction."""
    levels = {key: entry for key, entry in entries.items() if key.startswith("d_c")}
    return {**entries, **{f"{key}_n": entry for key, entry in levels.items()}}


def _put(
    table: Table,
    row: Effect,
    body: str | None,
    numbers: Mapping[str, Number],
    joint: JointFile,
    source: str,
) -> None:
    """Add the numbers of an effect to a table, leaving its other entries unchanged."""
    entries = table.setdefault(row.name, {})
    if row.bodies and body is not None:
        if not entries:
            entries["body"] = body
        elif entries.get("body", "") not in ("", body):
            _name_no_body(entries, row, {str(entries["body"]), body}, joint)
    for symbol, number in numbers.items():
        parameter = row.parameter(symbol)
        assert parameter is not None
        value, low, high = number.within(*row.domain(parameter))
        text = f"{source}; {number.note}" if number.note else source
        quantity = Quantity(value, unit_on(parameter, joint.parameters), text)
        if high > low:
            quantity = replace(quantity, low=low, high=high)
        entries[symbol] = _as_series(quantity) if parameter.series else quantity


def _as_series(quantity: Quantity) -> Quantity:
    """Return a quantity that holds a one-element list."""
    if isinstance(quantity.value, tuple):
        return quantity
    low, high = ((x,) if isinstance(x, float) else x for x in (quantity.low, quantity.high))
    return replace(quantity, value=(quantity.value,), low=low, high=high)


def _name_no_body(entries: dict[str, Entry], row: Effect, kept: set[str], joint: JointFile) -> None:
    """Apply an effect to two bodies; the third stays without, whatever the joint file states."""
    del entries["body"]
    for parameter in row.parameters:
        if body_of(parameter.symbol) in (None, *kept) or parameter.joint_parameter is None:
            continue
        off = joint.parameters.get(parameter.relative_to, 0.0) if parameter.relative_to else 0.0
        entries[parameter.symbol] = Quantity(
            off, unit_on(parameter, joint.parameters), "none of it"
        )


def _share_smoothing(table: Table, joint: JointFile) -> None:
    """Give all dry friction the same smoothing: the one found, else the nominal joint's."""
    owners = [entries[SMOOTHED] for entries in table.values() if SMOOTHED in entries]
    found = [entry for entry in owners if isinstance(entry, Quantity) and entry.low is not None]
    stated = [entries[SMOOTHED] for entries in joint.effects.values() if SMOOTHED in entries]
    for entries in table.values():
        if SMOOTHED in entries:
            entries[SMOOTHED] = (*found, *stated, *owners)[0]


def with_sensors(joint: JointFile, named: Sequence[NamedEffect], record: str) -> JointFile:
    """Return a joint whose channels scatter, or are as coarse, as named effects say."""
    sensors = {channel: dict(entries) for channel, entries in joint.sensors.items()}
    table: Table = {name: dict(entries) for name, entries in joint.effects.items()}
    for effect in named:
        if effect.name not in OF_SENSORS:
            continue
        key, found = next(iter(effect.parameters.items()))
        channel = str(effect.channel)
        value, low, high = (rounded(x) for x in (found.value, found.low, found.high))
        quantity = Quantity(value, found.unit, f"identified from {record}", low=low, high=high)
        sensors.setdefault(channel, {})[key] = quantity
        table.setdefault(effect.name, {})[channel] = quantity
    return replace(joint, effects=table, sensors=sensors)


# ---- datasheet values
def _refined(
    quantities: Mapping[str, Quantity], refined: Refined, source: str
) -> dict[str, Quantity]:
    """Return the refined datasheet values; both directions move together."""
    found = {}
    for symbol, numbers in refined.items():
        value, deviation = numbers[0], min(numbers[1], WIDEST)
        old = quantities[symbol]
        how = "corrected from the guess of" if old.guess else "refined from"
        stated = f"{how} {old.number:.6g}" if old.source != NOT_STATED else "not stated"
        within = _within(value, old)
        text = f"{stated}{within}, {source}"
        found[symbol] = replace(
            old, value=value, source=text, tolerance=deviation or None, guess=False
        )
        back = quantities.get(f"{symbol}_n")
        if back is not None and back.number == old.number:
            found[f"{symbol}_n"] = replace(back, value=value, source=text, tolerance=deviation)
    return found


def _within(value: float, old: Quantity) -> str:
    """Return how far a refined value is from the datasheet's, if its tolerance allows it."""
    if old.guess or not old.tolerance or not old.number:
        return ""
    far = abs(value / old.number - 1.0) / old.tolerance
    if far <= 1.0:
        return " within its tolerance"
    return f" by {far:.1f} times its tolerance" if far <= TOLERATED else ""


def _refine_lag(table: Table, lag: float, deviation: float, source: str) -> None:
    """Set a current loop's stated bandwidth to the fitted one."""
    entries = table.get("current_lag", {})
    old = entries.get("bandwidth")
    if isinstance(old, Quantity):
        text = f"refined from {old.number:.6g}, {source}"
        bandwidth = rounded(1.0 / (2.0 * math.pi * lag))
        entries["bandwidth"] = Quantity(bandwidth, old.unit, text, tolerance=rounded(deviation))


def _refine_friction(table: Table, refined: Refined, source: str) -> None:
    """Set the listed levels of Coulomb friction to the fitted ones."""
    for field, symbol in FRICTION.items():
        old = table.get("coulomb", {}).get(symbol)
        if field in refined and isinstance(old, Quantity):
            value, deviation = refined[field][0], min(refined[field][1], WIDEST)
            text = f"refined from {old.number:.6g}, {source}"
            table["coulomb"][symbol] = replace(
                old, value=value, source=text, tolerance=rounded(deviation)
            )


def _refine_weight(table: Table, refined: Refined, source: str, common: float) -> None:
    """Set the size of a listed weight to the fitted one.

    Args:
        table: The effects of the joint.
        refined: Fitted values, each with its relative deviation.
        source: What a source begins with.
        common: Relative deviation of the scale of all torques.
    """
    old = table.get("gravity", {}).get("torque")
    if isinstance(old, Quantity) and refined.keys() >= set(WEIGHT):
        (a, deviation), (b, _) = (refined[name] for name in WEIGHT)
        how = "corrected from the guess of" if old.guess else "refined from"
        text, size = (
            f"{how} {old.number:.6g}, {source}",
            math.copysign(math.hypot(a, b), old.number),
        )
        table["gravity"]["torque"] = replace(
            old, value=rounded(size), source=text, guess=False,
            tolerance=rounded(math.hypot(min(deviation, WIDEST), common)),
        )  # fmt: skip


def rounded(x: float) -> float:
    """Return a number with six digits."""
    return float(f"{x:.6g}")
