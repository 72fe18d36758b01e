"""Dead time within a sample: when it exceeds the usual latching instant of a drive.

A drive latches its command at some instant within a sample, which every fit leaves free. If that
instant comes out near the next sample, the joint is a sample late: `command_delay` replaces the
free instant and is judged like any other effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.diagnosis import Interval, NamedEffect
from cjt_gym.gap.stages.fit import Fit, Model, Problem

DELAY = "command_delay"
LATEST = 0.75
"""Share of a sample up to which latching a command is usual: two and a half times the standard
deviation that a fit allows."""
OPEN = (
    "Up to one sample of the delay between command and joint can come from how the record was "
    "made: it does not tell whether the drive is late or the log."
)


@dataclass(frozen=True, eq=False)
class Late:
    """A record whose dead time is an effect, with no free instant; only `base` is without it."""

    problem: Problem
    base: Fit
    fit: Fit
    seen: tuple[Fit, ...]


def as_effect(
    problem: Problem,
    base: Fit,
    fit: Fit,
    seen: Sequence[Fit],
    candidates: Sequence[Candidate],
) -> Late | None:
    """Return a record with its dead time as an effect, None if the dead time is usual."""
    series = problem.stages.setting.series
    at = next((k for k, n in enumerate(problem.shared) if n.field == "delay"), None)
    delay = next((h for h in candidates if h.name == DELAY), None)
    if at is None or delay is None or series.slow or _delay(problem, fit) < LATEST * series.dt:
        return None
    if any(effect.name == DELAY for effect in fit.model.effects):
        return None
    kept = tuple(n for n in problem.shared if n.field != "delay")
    late = Problem(problem.stages, kept, problem.counts)

    def renamed(one: Fit) -> Fit:
        """Return the same fit with its instant added to the dead time."""
        others = tuple(e for e in one.model.effects if e.name != DELAY)
        values = np.delete(one.z[len(problem.shared) :], _places(one.model))
        total = delay.unknowns[0].coordinate(_delay(problem, one))
        z = np.concatenate([np.delete(one.z[: len(problem.shared)], at), values, [total]])
        return replace(one, model=Model((*others, delay)), z=z, jacobian={})

    return Late(
        late,
        _prompt(late, base, at, delay.touches),
        late.fit(renamed(fit).model, renamed(fit).z),
        tuple(renamed(one) for one in seen),
    )


def _delay(problem: Problem, fit: Fit) -> float:
    """Return the dead time of a fit beyond the nominal one [s]."""
    return problem.fields(fit.model, fit.z)["delay"] - problem.stages.setting.nominal["delay"]


def _places(model: Model) -> list[int]:
    """Return the indices of the dead time among the numbers of a model's effects."""
    owners = [effect.name for effect in model.effects for _ in effect.unknowns]
    return [k for k, name in enumerate(owners) if name == DELAY]


def _prompt(late: Problem, base: Fit, at: int, touches: tuple[str, ...]) -> Fit:
    """Return the fit without effects, with its dead time removed."""
    z = np.delete(base.z, at)
    residuals = base.residuals | late.residuals(base.model, z, touches)
    mean_square = late.mean_square(residuals)
    return replace(base, z=z, residuals=residuals, mean_square=mean_square, jacobian={})


def may_be_the_records(name: str, numbers: Mapping[str, Interval], dt: float) -> bool:
    """Return whether an effect is a dead time that the recording itself may have caused.

    Such a dead time is one sample, apart from the usual instant within a sample.

    Args:
        name: Of the effect.
        numbers: Its numbers.
        dt: Sample time [s].
    """
    return name == DELAY and numbers["delay"].value < (1.0 + LATEST) * dt


def open_instant(named: Sequence[NamedEffect], dt: float) -> tuple[str, ...]:
    """Return the remarks to make if such a dead time is named."""
    late = any(may_be_the_records(effect.name, effect.parameters, dt) for effect in named)
    return (OPEN,) if late else ()
