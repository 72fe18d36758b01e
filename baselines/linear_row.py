"""Rows of the table whose law is linear: default gains by one rule, run by one controller."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import product

from cjt_gym.baselines.controller import Controller
from cjt_gym.baselines.entry import EVERY, ControllerEntry, Gain, Gains
from cjt_gym.baselines.linear_law import LinearController, LinearLaw
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.robust import best_gains
from cjt_gym.joint import Joint
from cjt_gym.plant import limits_of


def linear_row(
    name: str,
    summary: str,
    source: str,
    tunable: tuple[Gain, ...],
    law: Callable[..., LinearLaw],
    candidates: Callable[[SampledJoint], Iterable[Gains]],
    structures: tuple[str, ...] = EVERY,
    refusal: str = "",
) -> ControllerEntry:
    """Return the row of a linear law; its defaults are those of `cjt_gym.baselines.robust`.

    `law` makes it for a sampled joint and gains, which it takes by their names; `candidates` are
    gains from which the defaults are chosen. For the rest see `ControllerEntry`.
    """

    def defaults(joint: Joint, dt: float) -> Gains:
        model = SampledJoint(joint, dt)
        usual = {gain.name: gain.usual for gain in tunable if gain.usual is not None}
        rows = [usual | dict(row) for row in candidates(model)]
        return best_gains(model, lambda gains: law(model, **gains), rows)

    def build(joint: Joint, dt: float, gains: Gains) -> Controller:
        return LinearController(law(SampledJoint(joint, dt), **gains), limits_of(joint).tau)

    return ControllerEntry(name, summary, source, tunable, defaults, build, structures, refusal)


def grid(**values: Iterable[float]) -> list[dict[str, float]]:
    """Return all combinations of values, by name.

    Example:
        >>> grid(kp=(1.0, 2.0), kd=(0.0,))
        [{'kp': 1.0, 'kd': 0.0}, {'kp': 2.0, 'kd': 0.0}]
    """
    return [dict(zip(values, one, strict=True)) for one in product(*values.values())]
