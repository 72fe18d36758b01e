"""The explanation on data that it has not seen: its stages, predicted with what was fitted kept.

Only what may differ from record to record is fitted again: offsets, zeros, timing. A true effect
lowers the held-out residuals by as much as it changes them; one that only mimics the cause on the
first record does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.fields import Fields
from cjt_gym.gap.fit import Fit, Model, Problem, retuned
from cjt_gym.gap.hypothesis import Hypothesis, Values
from cjt_gym.gap.nuisances import nuisances
from cjt_gym.gap.setting import Setting, as_noisy
from cjt_gym.gap.stages import Stages

Floats = NDArray[np.float64]
PER_RECORD = ("i_0", "w_i", "delay", "tau_0", "skew", "q_0")
"""Fields that may differ from record to record."""
SEEN = 0.02
"""Mean square of the change from which an effect shows itself on a record."""


@dataclass(frozen=True)
class Trial:
    """What an effect is worth on a record that it was not fitted to.

    Attributes:
        change: Mean square by which it changes the normalised residuals of its stages.
        worth: Share of this change by which they fall: 1 for a true effect, 0 for one that does
            not help, negative for one that does harm.
    """

    change: float
    worth: float


@dataclass(frozen=True)
class HeldOut:
    """The explanation on one record that it has not seen.

    Attributes:
        before: Mean square of each stage's residual without effects, all values fitted anew.
        after: The same with the effects, nothing fitted but what differs between records.
        trials: What each effect of the model is worth.
    """

    before: Mapping[str, float]
    after: Mapping[str, float]
    trials: tuple[Trial, ...]


def worth(held: Sequence[HeldOut], index: int) -> Trial | None:
    """Return what an effect is worth over all held-out records, None where none excites it."""
    trials = [h.trials[index] for h in held]
    change = sum(trial.change for trial in trials)
    if change < SEEN:
        return None
    return Trial(change, sum(t.change * t.worth for t in trials) / change)


def on_held_out(setting: Setting, problem: Problem, fit: Fit) -> HeldOut:
    """Return what an explanation is worth on another record.

    Args:
        setting: The other record, its angles counted from the zeros of the first.
        problem: The first record.
        fit: The explanation.
    """
    setting = as_noisy(setting, problem.stages.setting)
    other = _frozen_parameters(setting, problem, fit)
    shared = tuple(n for n in nuisances(setting, Stages(setting).names) if n.field in PER_RECORD)
    stages = Stages(other)
    held = Problem(stages, shared)
    effects = _frozen(problem, fit)
    start = np.zeros(len(shared))
    whole, z = Model(effects), np.concatenate([start, _free_start(problem, fit)])
    stages.tune(held.fields(whole, z))
    held.counts = {name: int(np.count_nonzero(r)) for name, r in held.residuals(whole, z).items()}
    full = retuned(held, held.fit(whole, z))
    trials = tuple(
        _trial(held, full, k) if not effect.outside else Trial(0.0, 1.0)
        for k, effect in enumerate(effects)
    )
    free = Problem.of(Stages(setting))
    before = free.fit(Model(), np.zeros(len(free.shared))).mean_square
    return HeldOut(before, full.mean_square, trials)


def _trial(held: Problem, full: Fit, index: int) -> Trial:
    effects = full.model.effects
    less = replace(full.model, effects=effects[:index] + effects[index + 1 :])
    touched = [n for n in effects[index].touches if n in full.mean_square]
    if not touched:
        return Trial(0.0, 1.0)
    residuals = held.fit(less, full.z).residuals
    weights = {n: 1.0 / max(full.mean_square[n], 1.0) for n in touched}
    change = {n: residuals[n] - full.residuals[n] for n in touched}
    size = sum(w * float(change[n] @ change[n]) for n, w in weights.items())
    fall = sum(w * float(full.residuals[n] @ change[n]) for n, w in weights.items())
    count = max(held.counts[n] for n in touched)
    return Trial(size / max(count, 1), 1.0 + 2.0 * fall / max(size, 1e-12))


def _frozen_parameters(setting: Setting, problem: Problem, fit: Fit) -> Setting:
    nominal: Fields = dict(setting.nominal)
    for nuisance, z in zip(problem.shared, fit.z, strict=False):
        if nuisance.field not in PER_RECORD:
            nominal[nuisance.field] = nuisance.unknown.value(float(z))
    return replace(setting, nominal=nominal)


def _frozen(problem: Problem, fit: Fit) -> tuple[Hypothesis, ...]:
    """Return the effects with their values kept; causes outside the table stay free."""
    at, found = len(problem.shared), []
    for effect in fit.model.effects:
        values = {u.symbol: u.value(fit.z[at + k]) for k, u in enumerate(effect.unknowns)}
        at += len(effect.unknowns)
        found.append(effect if effect.outside else _with_values(effect, values))
    return tuple(found)


def _with_values(effect: Hypothesis, values: Values) -> Hypothesis:
    def apply(fields: Fields, _: Values) -> None:
        effect.apply(fields, values)

    return replace(effect, unknowns=(), apply=apply)


def _free_start(problem: Problem, fit: Fit) -> Floats:
    at, found = len(problem.shared), []
    for effect in fit.model.effects:
        size = len(effect.unknowns)
        found += [fit.z[at : at + size]] if effect.outside else []
        at += size
    return np.concatenate(found) if found else np.zeros(0)
