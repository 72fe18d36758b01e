"""Dead time within a sample: when it is more than the way in which a drive takes its command over.

A drive takes its command over at some instant within a sample, which every fit leaves free. Where
that comes out near the next sample, the joint is late by a sample: `command_delay` takes the place
of the free instant and is judged like any other effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.gap.diagnosis import Interval, NamedEffect
from cjt_gym.gap.fit import Fit, Model, Problem
from cjt_gym.gap.hypothesis import Hypothesis

DELAY = "command_delay"
LATEST = 0.75
"""Share of a sample up to which a drive takes its command over: two and a half of the deviations
that a fit allows it."""
OPEN = (
    "Up to one sample of the delay between command and joint can come from how the record was "
    "made: it does not tell whether the drive is late or the log."
)


@dataclass(frozen=True, eq=False)
class Late:
    """A record whose dead time is an effect, and no instant is free.

    Attributes:
        problem: The record.
        base: The fit without effects, and so without dead time.
        fit: The fit with the effects, among them the dead time.
        seen: All other fits, with it.
    """

    problem: Problem
    base: Fit
    fit: Fit
    seen: tuple[Fit, ...]


def as_effect(
    problem: Problem,
    base: Fit,
    fit: Fit,
    seen: Sequence[Fit],
    candidates: Sequence[Hypothesis],
) -> Late | None:
    """Return a record with its dead time as an effect; None where that is nothing unusual.

    Args:
        problem: The record, its instant free.
        base: The fit without effects.
        fit: The explanation.
        seen: All other fits.
        candidates: All effects of the table that the record can show.
    """
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
        """Return the same fit, its instant added to the dead time."""
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
    """Return where a dead time stands among the numbers of a model's effects."""
    owners = [effect.name for effect in model.effects for _ in effect.unknowns]
    return [k for k, name in enumerate(owners) if name == DELAY]


def _prompt(late: Problem, base: Fit, at: int, touches: tuple[str, ...]) -> Fit:
    """Return the fit without effects as it is without any dead time."""
    z = np.delete(base.z, at)
    residuals = base.residuals | late.residuals(base.model, z, touches)
    mean_square = late.mean_square(residuals)
    return replace(base, z=z, residuals=residuals, mean_square=mean_square, jacobian={})


def may_be_the_records(name: str, numbers: Mapping[str, Interval], dt: float) -> bool:
    """Return whether an effect is a dead time that can come from how a record was made.

    That is one sample, beside the instant within a sample that is usual.

    Args:
        name: Of the effect.
        numbers: Its numbers.
        dt: Sample time [s].
    """
    return name == DELAY and numbers["delay"].value < (1.0 + LATEST) * dt


def open_instant(named: Sequence[NamedEffect], dt: float) -> tuple[str, ...]:
    """Return what is to be said where such a dead time is named."""
    late = any(may_be_the_records(effect.name, effect.parameters, dt) for effect in named)
    return (OPEN,) if late else ()
