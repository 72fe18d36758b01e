"""From variations by name to what compiled code reads, with every check on the way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.batch import CHANNEL_DELAYS, DELAYS, INERTIAS
from cjt_gym.joint.configure import FIELDS
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant.randomization import draw as columns
from cjt_gym.plant.randomization.draw import Program, normal_share
from cjt_gym.plant.randomization.target import Domain, Target, find_target
from cjt_gym.plant.randomization.variation import (
    DISTRIBUTIONS,
    OPERATIONS,
    TIMES,
    Variation,
    constant,
)

DISCRETISED = (*INERTIAS, "k_g", "k_b", "d_m", "d_g", "d_l", "d_mg", "d_gl", "play_gap")
DRIFT_STEPS = 1000  # updates of a drift per time constant, at most one per control step
Span = tuple[float, float]


@dataclass(frozen=True)
class Plan:
    """A randomisation that has been checked."""

    names: tuple[str, ...]  # what varies, in the order of the columns of `Draws.values`
    nominal: Floats  # values without randomisation, shape (names,)
    program: Program  # for compiled code; its rows may be more than the names
    delays: Mapping[str, float]  # longest value of each delay [s]

    @cached_property
    def within(self) -> bool:
        """Whether anything varies within an episode."""
        return bool((self.program.sources[:, columns.WHEN] >= columns.INTERVAL).any())

    @property
    def longest(self) -> float:
        """Time that commands or measurements may have to be kept [s]."""
        late = max(self.delays[name] for name in CHANNEL_DELAYS)
        return max(self.delays["command_delay"], self.delays["measurement_delay"] + late)


def compile_plan(joint: Joint, variations: Mapping[str, Variation], dt: float) -> Plan:
    """Return the plan of a randomisation, for control steps of `dt` [s]."""
    owner = joint.parameters.name
    pairs = [(find_target(joint, name), v) for name, v in variations.items()]
    sources, mixed = _sources(variations, dt)
    pairs = _with_dependents(joint, pairs)
    record, _ = joint.packed()
    spans: dict[str, Span] = {f: (float(record[f][0]), float(record[f][0])) for f in FIELDS}
    touched = [field for target, _ in pairs for field in target.fields]
    modes = [_mode(target, spans, touched) for target, _ in pairs]
    for (target, variation), mode in zip(pairs, modes, strict=True):
        _widen(spans, target, target.span(variation, owner), mode)
    _check_fields(joint, pairs, spans)
    fields: list[int] = []
    table: list[tuple[float, float]] = []
    mixtures: list[tuple[float, float]] = []
    rows = np.zeros((len(pairs), columns.COLUMNS))
    for k, ((target, variation), mode) in enumerate(zip(pairs, modes, strict=True)):
        _fill(rows[k], target, variation, table)
        rows[k, columns.MIXED_FROM] = len(mixtures)
        mixtures += mixed.get(target.name, ())
        rows[k, columns.MIXED_TO] = len(mixtures)
        rows[k, columns.MODE], rows[k, columns.FIRST] = mode, len(fields)
        fields += [FIELDS.index(field) for field in target.fields]
        rows[k, columns.LAST] = len(fields)
        if set(target.fields) & set(DISCRETISED):
            for source, _ in mixed.get(target.name, ()):
                sources[int(source), columns.IS_LINEAR] = 1.0
    program = Program(
        sources,
        rows,
        np.array(mixtures, dtype=np.float64).reshape(-1, 2),
        np.array(fields, dtype=np.int64),
        np.array(table, dtype=np.float64).reshape(-1, 2),
        bool(set(touched) & set(DISCRETISED)),
    )
    named = [target for target, _ in pairs if target.name in variations]
    nominal = np.array([target.nominal for target in named], dtype=np.float64)
    delays = {name: spans[name][1] for name in DELAYS}
    return Plan(tuple(t.name for t in named), nominal, program, delays)


def exact_plan(joint: Joint, values: Mapping[str, float], dt: float) -> Plan:
    """Return the plan that sets exact values."""
    if not isinstance(values, Mapping):
        raise ConfigurationError(
            f"Exact parameters are a mapping of names to values, got {values!r}."
        )
    variations = {}
    for name, value in values.items():
        for effect in joint.effects:
            if any(p.replaces and p.symbol == name for p in EFFECTS[effect].parameters):
                raise ConfigurationError(
                    f"{name} of {joint.parameters.name} is replaced by effect {effect}. Give "
                    f"{effect}.{name}."
                )
        try:
            variations[name] = constant(value)
        except ConfigurationError:
            raise ConfigurationError(f"{name} must be a finite number, got {value!r}.") from None
    return compile_plan(joint, variations, dt)


def _sources(
    variations: Mapping[str, Variation], dt: float
) -> tuple[Floats, dict[str, list[tuple[float, float]]]]:
    """Return the sources of randomness, and by name which of them act with which weights."""
    rows: list[tuple[float, float, float, float]] = []
    groups: dict[str, tuple[int, str]] = {}
    mixed: dict[str, list[tuple[float, float]]] = {}
    for name, variation in variations.items():
        if variation.distribution == "choice" and len(variation.values) == 1:
            continue
        source = _source(name, variation, dt)
        parts = mixed[name] = []
        for group, weight in variation.weights_of_groups:
            common, first = groups.setdefault(group, (len(rows), name))
            if first == name:
                rows.append(source)
            elif rows[common] != source:
                raise ConfigurationError(
                    f"randomization of {first} and {name} share the group {group!r} and so "
                    "must agree in when, interval and time_constant."
                )
            parts.append((float(common), weight))
        if variation.own_weight > 0.0:
            parts.append((float(len(rows)), variation.own_weight))
            rows.append(source)
    return np.array(rows, dtype=np.float64).reshape(-1, 4), mixed


def _source(name: str, variation: Variation, dt: float) -> tuple[float, float, float, float]:
    when, every, keep = float(TIMES.index(variation.when)), 0.0, 0.0
    time = variation.interval or variation.time_constant
    if time is not None:
        if time < (1.0 - 1e-9) * dt:
            raise ConfigurationError(
                f"randomization of {name}: "
                f"{'interval' if variation.interval else 'time_constant'} must be at least a "
                f"control step of {dt:g} s, got {time:g} s."
            )
        every = float(round(time / dt))
        if variation.time_constant is not None:
            every = float(max(1, round(time / dt / DRIFT_STEPS)))
            keep = math.exp(-every * dt / time)
    return when, every, keep, 0.0


def _with_dependents(
    joint: Joint, pairs: list[tuple[Target, Variation]]
) -> list[tuple[Target, Variation]]:
    """Put what counts from another parameter last, and add what counts from one that varies.

    So that damping at negative velocity stays what it is called when the damping at positive
    velocity varies, from which its kernel parameter is counted.
    """
    varied = {field for target, _ in pairs for field in target.fields}
    known = {target.name for target, _ in pairs}
    last = [pair for pair in pairs if pair[0].relative_to is not None]
    for effect, values in joint.effects.items():
        for symbol, value in values.items():
            name = f"{effect}.{symbol}"
            if name in known or not isinstance(value, float):
                continue
            target = find_target(joint, name)
            if target.relative_to in varied:
                last.append((target, constant(value)))
    return [pair for pair in pairs if pair[0].relative_to is None] + last


def _mode(target: Target, spans: Mapping[str, Span], touched: list[str]) -> int:
    if target.relative_to is not None:
        return columns.COUNTS_FROM
    # Setting gives exactly the value where nothing else contributes to the field.
    alone = all(spans[f][0] == target.nominal and touched.count(f) == 1 for f in target.fields)
    return columns.REPLACES if target.replaces or alone else columns.ADDS


def _widen(spans: dict[str, Span], target: Target, span: Span, mode: int) -> None:
    """Follow what a row does to the range of its fields."""
    for field in target.fields:
        low, high = span
        if mode == columns.ADDS:
            low += spans[field][0] - target.nominal
            high += spans[field][1] - target.nominal
        elif mode == columns.COUNTS_FROM:
            assert target.relative_to is not None
            start = spans[target.relative_to]
            low, high = low - start[1], high - start[0]
        spans[field] = (low, high)


def _check_fields(
    joint: Joint, pairs: list[tuple[Target, Variation]], spans: Mapping[str, Span]
) -> None:
    """Refuse names that together take a parameter out of its domain."""
    for target, _ in pairs:
        if target.relative_to is not None or target.domain.low < 0.0:
            continue
        for field in target.fields:
            together = [other.name for other, _ in pairs if field in other.fields]
            if not _holds(target.domain, spans[field]):
                raise ConfigurationError(
                    f"randomization of {' and '.join(together)} of {joint.parameters.name} must "
                    f"keep {field} {target.domain}, got a lowest value of {spans[field][0]:g}. "
                    "Vary only one of what sets it, or less."
                )


def _holds(domain: Domain, span: Span) -> bool:
    """Whether a range is allowed, give or take the rounding of sums."""
    slack = 0.0 if domain.strict else 1e-12 * max(abs(span[0]), abs(span[1]), 1e-300)
    return domain.holds(span[0] + slack, -math.inf)


def _fill(
    row: Floats,
    target: Target,
    variation: Variation,
    table: list[tuple[float, float]],
) -> None:
    """Write all of a row but its score, what its fields are and how they follow."""
    row[columns.SHAPE] = DISTRIBUTIONS.index(variation.distribution)
    row[columns.OPERATION] = OPERATIONS.index(variation.operation)
    row[columns.NOMINAL] = target.nominal
    if target.relative_to is not None:
        row[columns.RELATIVE] = FIELDS.index(target.relative_to)
    if variation.distribution == "choice":
        row[columns.FROM] = len(table)
        table.extend(zip(variation.values, np.cumsum(variation.shares).tolist(), strict=True))
        row[columns.TO] = len(table) - 1
        return
    row[columns.LOW], row[columns.HIGH] = variation.span
    if variation.distribution == "normal":
        assert variation.mean is not None
        assert variation.std is not None
        row[columns.MEAN], row[columns.STD] = variation.mean, variation.std
        spread = max(variation.std, 1e-300)
        for column, end in ((columns.FROM, variation.span[0]), (columns.TO, variation.span[1])):
            row[column] = normal_share((end - variation.mean) / spread)
