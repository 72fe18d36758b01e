"""Joint file of a judgement: effects with their intervals, and the ranges of validity."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.diagnosis import Interval, NamedEffect
from cjt_gym.gap.digits import short
from cjt_gym.gap.horizons.findings.by_torque import inertia_by_torque
from cjt_gym.gap.horizons.fitting.covariance import Scatter
from cjt_gym.gap.horizons.selection.judgement import Judgement
from cjt_gym.gap.identified import identified
from cjt_gym.joint import EFFECTS, Joint, JointFile
from cjt_gym.joint.files.effect_entries import unit_on
from cjt_gym.joint.files.quantity import FrozenMapping, Plain, Quantity, freeze
from cjt_gym.joint.files.quantity import Setting as Entry
from cjt_gym.joint.outside import frequency_of

OPEN = "which leaves it open: it predicts best, and is not drawn"
"""What the source of a value says that the record hardly determines."""
TORN = "open: predictions and a regression of the torque disagree, the interval covers both"
"""What the source of an inertia says on which they do."""
REGRESSED = "by a regression of the torque"
"""What the source of a value says that only such a regression shows."""
RARE = 1e-3
"""Share of samples ignored at each end of the speed range, mostly glitches of a derivative."""


def joint_of(
    judged: Judgement,
    effects: Sequence[NamedEffect],
    record: str,
    by_torque: Collection[str] = (),
) -> JointFile:
    """Return the joint file of a judgement's answer.

    Args:
        judged: The judgement.
        effects: Named effects with their intervals.
        record: Name of the record, for the sources of the entries.
        by_torque: Those of the effects whose numbers a regression of the torque gave.
    """
    answer, nominal = judged.joint, judged.case.joint.file
    source = f"identified from {record}"
    if judged.answer == "datasheet":
        return nominal
    scatter = _scatter(judged)
    intervals = {
        f"{e.name}.{symbol}": interval for e in effects for symbol, interval in e.parameters.items()
    }
    regressed = {key: x for key, x in intervals.items() if key.split(".")[0] in by_torque}
    untold: frozenset[str] = frozenset()
    if scatter is not None:
        untold = scatter.untold([e.name for e in effects])
        fitted = {k: one for k, one in scatter.intervals().items() if k not in untold}
        same = {k: i for k, i in intervals.items() if k in fitted and _same(i, fitted[k])}
        torn = _torn(judged, scatter)
        intervals = fitted | same | torn | regressed
        untold |= torn.keys() | regressed.keys()
    table: dict[str, dict[str, Entry]] = {n: dict(v) for n, v in nominal.effects.items()}
    for name in table.keys() - answer.effects.keys():
        if EFFECTS[name].excludes and set(EFFECTS[name].excludes) & answer.effects.keys():
            del table[name]
    for name, values in answer.effects.items():
        entries: dict[str, Entry] = {
            k: v for k, v in table.get(name, {}).items() if isinstance(v, str)
        }
        for symbol, value in values.items():
            key, listed = f"{name}.{symbol}", table.get(name, {}).get(symbol)
            if isinstance(listed, Quantity) and listed.value == value and key not in intervals:
                entries[symbol] = listed  # nothing changed it
                continue
            why = (OPEN if key not in intervals else TORN) if key in untold else ""
            why = REGRESSED if key in regressed else why
            said = f"{source}, {why}" if why else source
            entries[symbol] = _entry(judged.case.joint, name, symbol, value, said, intervals)
        table[name] = entries
    p = nominal.parameters
    moved = {
        s: Quantity(_finite(q.number), q.unit, source)
        for s, q in answer.parameters.quantities.items()
        if s not in p.quantities or q.number != p.quantities[s].number
    }
    parameters = replace(
        p.replace(**moved), name=identified(p.name), source=f"{p.source}; effects {source}"
    )
    return replace(
        nominal, parameters=parameters, effects=table, structure=answer.structure,
        drive=answer.drive, found=found_at(judged, untold),
    )  # fmt: skip


def _torn(judged: Judgement, scatter: Scatter) -> dict[str, Interval]:
    """Return the inertias on which predictions and torque disagree, with intervals over both.

    They are drawn apart from the other numbers, as their covariance knows the predictions alone.
    """
    model, fit = scatter.spread.model, scatter.spread.fit
    known, found = scatter.intervals(), {}
    shape = judged.case.joint.structure_row
    single = shape.size == 1 and not shape.output_fixed  # no spring hides the motor's inertia
    for index, term in enumerate(model.terms if single else ()):
        factors = inertia_by_torque(judged, term)
        if not factors:
            continue
        ratios = [x / model.values(fit.z)[index][0] for x in factors]
        for k in np.flatnonzero(scatter.slopes[:, model.span(index)].any(axis=1)):
            name, one = scatter.names[k], known[scatter.names[k]]
            others = [ratio * one.value for ratio in ratios]
            if max(others) < one.low or min(others) > one.high:
                low, high = min(one.low, *others), max(one.high, *others)
                found[name] = replace(one, low=low, high=high)
    return found


def _same(one: Interval, other: Interval) -> bool:
    """Return whether two intervals belong to the same number, not to a part of it."""
    return math.isclose(one.value, other.value, rel_tol=1e-6)


def _entry(
    joint: Joint,
    effect: str,
    symbol: str,
    value: object,
    source: str,
    intervals: dict[str, Interval],
) -> Quantity:
    parameter = EFFECTS[effect].parameter(symbol)
    assert parameter is not None
    unit = unit_on(parameter, joint.parameters)
    if isinstance(value, tuple):
        return Quantity(tuple(_finite(x) for x in value), unit, source)
    number = _finite(float(value))  # type: ignore[arg-type]
    known = intervals.get(f"{effect}.{symbol}")
    if known is None:
        return Quantity(number, unit, source)
    low, strict, high = EFFECTS[effect].domain(parameter)
    least = low + 1e-12 if strict else low
    ends = sorted((min(max(known.low, least), number), min(max(known.high, number), high)))
    if ends[0] == ends[1]:
        return Quantity(number, unit, source)
    return Quantity(number, unit, source, low=_finite(ends[0]), high=_finite(ends[1]))


def found_at(judged: Judgement, untold: Collection[str] = ()) -> FrozenMapping[Plain]:
    """Return the ranges in which the joint was identified, and the covariance of its numbers.

    Args:
        judged: The judgement.
        untold: Numbers that the record leaves open, which are left out of the covariance.
    """
    logs = judged.case.logs
    speed = np.concatenate([log.speed[log.inside] for log in logs])
    ends = np.quantile(speed, [RARE, 1.0 - RARE])
    p = judged.case.joint.parameters
    gain = p.k_t * p.n / (p.r if logs[0].voltage else 1.0)
    torque = np.concatenate([gain * log.command[log.whole] for log in logs])
    top = max(frequency_of(log.command, log.dt) for log in logs)
    unit, force = ("m/s", "N") if p.axis == "prismatic" else ("rad/s", "N m")
    found: dict[str, object] = {
        "speed": {"low": _finite(ends[0]), "high": _finite(ends[1]), "unit": unit},
        "torque": {"low": _finite(torque.min()), "high": _finite(torque.max()), "unit": force},
        "frequency": {"low": 0.0, "high": _finite(top), "unit": "Hz"},
    }
    first = logs[0]
    drawn = first.load.any() and not judged.case.joint.structure_row.output_fixed
    if first.share or drawn:
        found["input"] = {
            "share": first.share,
            "load_share": 0.5 if drawn else 0.0,
            "dt": _finite(first.dt / first.rows),
        }
    heat = [log.temperature for log in logs if log.temperature is not None]
    if heat:
        low, high = (_finite(x) for x in (min(t[0] for t in heat), max(t[1] for t in heat)))
        found["temperature"] = {"low": low, "high": high, "unit": "degC"}
    if (scatter := _scatter(judged)) is not None and (table := scatter.table(untold))["names"]:
        found["covariance"] = table
    return freeze(found)


def _scatter(judged: Judgement) -> Scatter | None:
    """Return the scatter of the answer's numbers; None if they are not from the fit."""
    if judged.answer != "found" or judged.found is None or judged.problem is None:
        return None
    return Scatter.of(judged.spread)


def _finite(x: float) -> float:
    return short(x) if math.isfinite(x) else 0.0
