"""Rows of the table whose law is linear: default gains by one rule, run by one controller."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import product

from cjt_gym.baselines.controller import Controller
from cjt_gym.baselines.entry import EVERY, ControllerEntry, Gain, Gains
from cjt_gym.baselines.linear_law import Addition, LinearController, LinearLaw
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.robust import best_gains
from cjt_gym.joint import Joint
from cjt_gym.plant import limits_of

MakeAddition = Callable[[SampledJoint, Gains, LinearLaw, float], Addition]
"""Makes an addition for a sampled joint, gains, the linear law beside it and the torque limit."""


def linear_row(
    name: str,
    summary: str,
    source: str,
    tunable: tuple[Gain, ...],
    law: Callable[..., LinearLaw],
    candidates: Callable[[SampledJoint], Iterable[Gains]],
    structures: tuple[str, ...] = EVERY,
    addition: MakeAddition | None = None,
    learning: Callable[[SampledJoint, LinearLaw], Gains] | None = None,
) -> ControllerEntry:
    """Return the row of a linear law; its defaults are those of `cjt_gym.baselines.robust`.

    `law` makes it for a sampled joint and gains, which it takes by their names; `candidates` are
    gains from which the defaults are chosen; `addition` makes what is added to its command;
    `learning` gives default gains that follow from the law with the defaults of the others. For the
    rest see `ControllerEntry`.
    """

    def defaults(joint: Joint, dt: float) -> Gains:
        model = SampledJoint(joint, dt)
        usual = {gain.name: gain.usual for gain in tunable if gain.usual is not None}
        rows = [usual | dict(row) for row in candidates(model)]
        found = best_gains(model, lambda gains: law(model, **gains), rows)
        learnt = learning(model, law(model, **found)) if learning is not None else {}
        return found | dict(learnt)

    def build(joint: Joint, dt: float, gains: Gains) -> Controller:
        model, limit = SampledJoint(joint, dt), limits_of(joint).tau
        linear = law(model, **gains)
        added = addition(model, gains, linear, limit) if addition is not None else None
        return LinearController(linear, limit, added, name, gains)

    return ControllerEntry(name, summary, source, tunable, defaults, build, structures)


def grid(**values: Iterable[float]) -> list[dict[str, float]]:
    """Return all combinations of values, by name.

    Example:
        >>> grid(kp=(1.0, 2.0), kd=(0.0,))
        [{'kp': 1.0, 'kd': 0.0}, {'kp': 2.0, 'kd': 0.0}]
    """
    return [dict(zip(values, one, strict=True)) for one in product(*values.values())]
