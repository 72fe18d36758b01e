"""The explanation on unseen data: predictions of its stages with the fitted numbers kept.

Offsets, zeros and timing may differ from record to record and are fitted again; all other numbers
may move within their uncertainty from the first record. A true effect lowers the held-out residuals
by as much as it changes them; one that only mimics the cause on the first record does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.gap.candidates.candidate import Candidate, Values
from cjt_gym.gap.candidates.nuisances import Nuisance, nuisances
from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting, as_noisy
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.fit import Fit, Model, Problem
from cjt_gym.gap.stages.intervals import Covariance, covariance

PER_RECORD = ("i_0", "w_i", "delay", "tau_0", "skew", "q_0")
"""Fields that may differ from record to record."""
MOVES = 4
"""Steps of a fit to a held-out record."""
LEAST = 1e-3
"""Smallest standard deviation of a coordinate that is fitted again."""
SEEN = 0.02
"""Mean square of the change above which a record excites an effect."""


@dataclass(frozen=True)
class Trial:
    """Performance of an effect on a record that it was not fitted to."""

    change: float  # mean square by which it changes the normalised residuals of its stages
    # their reduction as a share of this change: 1 for a true effect, 0 for one that does not help,
    # negative for one that does harm
    worth: float


@dataclass(frozen=True)
class HeldOut:
    """The explanation on one unseen record."""

    # mean square of each stage's residual without effects, all values fitted anew
    before: Mapping[str, float]
    # the same with the effects, all numbers as certain as the first record leaves them
    after: Mapping[str, float]
    trials: tuple[Trial, ...]  # worth of each effect of the model


def worth(held: Sequence[HeldOut], index: int) -> Trial | None:
    """Return the worth of an effect over all held-out records, None if none excites it."""
    trials = [h.trials[index] for h in held]
    change = sum(trial.change for trial in trials)
    if change < SEEN:
        return None
    return Trial(change, sum(t.change * t.worth for t in trials) / change)


def on_held_out(setting: Setting, problem: Problem, fit: Fit) -> HeldOut:
    """Evaluate an explanation on another record, its angles counted from the zeros of the first."""
    setting = as_noisy(setting, problem.stages.setting)
    known = covariance(problem, fit)
    stages = Stages(setting)
    held = Problem(stages, _shared(setting, stages.names, problem, fit, known))
    effects = _narrowed(problem, fit, known)
    whole = Model(effects)
    z = np.zeros(len(held.unknowns(whole)))
    stages.tune(held.fields(whole, z))
    held.counts = {name: stages.count(name) for name in stages.names}
    full = held.fit(whole, z, MOVES)
    kept, last = _kept(held, full)
    trials = tuple(
        _trial(kept, last, k) if not effect.outside else Trial(0.0, 1.0)
        for k, effect in enumerate(effects)
    )
    free = Problem.of(Stages(setting))
    before = free.fit(Model(), np.zeros(len(free.shared)), MOVES).mean_square
    return HeldOut(before, full.mean_square, trials)


def _trial(held: Problem, full: Fit, index: int) -> Trial:
    touched = [n for n in full.model.effects[index].touches if n in full.mean_square]
    if not touched:
        return Trial(0.0, 1.0)
    residuals = held.fit(full.model.without(index), full.z, MOVES).residuals
    weights = {n: 1.0 / max(full.mean_square[n], 1.0) for n in touched}
    change = {n: residuals[n] - full.residuals[n] for n in touched}
    size = sum(w * float(change[n] @ change[n]) for n, w in weights.items())
    fall = sum(w * float(full.residuals[n] @ change[n]) for n, w in weights.items())
    count = max(held.counts[n] for n in touched)
    return Trial(size / max(count, 1), 1.0 + 2.0 * fall / max(size, 1e-12))


def _kept(held: Problem, full: Fit) -> tuple[Problem, Fit]:
    """Return problem and fit with all numbers fixed but those that differ from record to record.

    An effect that merely relieves strain on the datasheet is also judged by what it changes:
    without it the other values must not take its place.
    """
    setting = held.stages.setting
    nominal = dict(setting.nominal)
    free = []
    for k, n in enumerate(held.shared):
        if n.field in PER_RECORD:
            free.append(k)
        else:
            nominal[n.field] = n.unknown.value(float(full.z[k]))
    stages = Stages(
        replace(setting, nominal=nominal), held.stages.gains, springs=held.stages.springs
    )
    effects = []
    for index, effect in enumerate(full.model.effects):
        if effect.outside:
            effects.append(effect)
            free += range(len(full.z))[held.span(full.model, index)]
        else:
            effects.append(_with_values(effect, held.values(full.model, full.z, index)))
    shared = tuple(n for n in held.shared if n.field in PER_RECORD)
    last = Fit(Model(tuple(effects)), full.z[free], full.cost, full.mean_square, full.residuals)
    return Problem(stages, shared, held.counts), last


def _with_values(effect: Candidate, values: Values) -> Candidate:
    def apply(fields: Fields, _: Values) -> None:
        effect.apply(fields, values)

    return replace(effect, unknowns=(), apply=apply)


def _shared(
    setting: Setting, names: tuple[str, ...], problem: Problem, fit: Fit, known: Covariance
) -> tuple[Nuisance, ...]:
    """Return what may differ, and datasheet values as certain as the first record leaves them."""
    values = {
        n.field: _narrow(n.unknown, float(fit.z[k]), known.std(k))
        for k, n in enumerate(problem.shared)
        if n.field not in PER_RECORD
    }
    own = nuisances(setting, names)
    if "delay" not in {n.field for n in problem.shared}:  # its dead time is an effect
        own = tuple(n for n in own if n.field != "delay")
    return tuple(n if n.field not in values else replace(n, unknown=values[n.field]) for n in own)


def _narrowed(problem: Problem, fit: Fit, known: Covariance) -> tuple[Candidate, ...]:
    """Return the effects with their numbers as certain as the first record leaves them.

    Causes outside the table may differ from record to record and stay as free as they were.
    """
    found = []
    for index, effect in enumerate(fit.model.effects):
        at = problem.span(fit.model, index).start
        numbers = tuple(
            _narrow(u, float(fit.z[at + k]), 1.0 if effect.outside else known.std(at + k))
            for k, u in enumerate(effect.unknowns)
        )
        found.append(replace(effect, unknowns=numbers))
    return tuple(found)


def _narrow(unknown: Number, z: float, std: float) -> Number:
    """Return a number that starts at its fitted value, with its uncertainty as the prior."""
    scale = unknown.scale * max(std, LEAST)
    return replace(unknown, start=unknown.value(z), scale=scale, prior=True)
