"""Contribution of each effect to a record: models of growing detail, each fitted anew.

Unlike the ladder of a diagnosis, whose effects keep the values of the whole explanation, every rung
is the best fit of its effects, which the caller chooses. Datasheet values and offsets stay at their
nominal values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import unknown_name
from cjt_gym.gap.fit import Model, Problem
from cjt_gym.gap.gap_size import followed, main_channel, relative
from cjt_gym.gap.hypotheses import hypotheses
from cjt_gym.gap.hypothesis import Hypothesis
from cjt_gym.gap.replay import Written, written
from cjt_gym.gap.setting import Setting, as_noisy, make_setting
from cjt_gym.gap.stages import Stages
from cjt_gym.joint import JointFile, get_structure, load_joint_file
from cjt_gym.records import Record

Floats = NDArray[np.float64]
MOVES = 30


@dataclass(frozen=True)
class Rung:
    """One model of a ladder.

    Attributes:
        effects: Names of its effects.
        values: Their numbers, by symbol, in the units of the joint's axis.
        errors: Error of each record relative to the rms of its signal: the record that was fitted,
            then the others; the joint torque, or without a spring the drive torque.
    """

    effects: tuple[str, ...]
    values: Mapping[str, float]
    errors: tuple[float, ...]


def rungs(
    record: Record,
    ladder: Sequence[Sequence[str]],
    joint: str | JointFile,
    structure: str,
    others: Sequence[Record] = (),
) -> tuple[Rung, ...]:
    """Return how well models with the named effects explain a record, and others unseen.

    Args:
        record: The record to which they are fitted.
        ladder: Names of the effects of each model.
        joint: The nominal joint.
        structure: How its bodies are joined.
        others: Records of the same joint that they are only tested on.

    Raises:
        UnknownNameError: A name is not an effect that this record can reveal.
    """
    file = joint if isinstance(joint, JointFile) else load_joint_file(joint)
    shape = get_structure(structure)
    setting = make_setting(record, file, shape)
    problem = Problem.of(Stages(setting))
    problem.shared = tuple(n for n in problem.shared if not n.unknown.prior)
    known = problem.stages.setting
    rows = hypotheses(setting, problem.stages.names)
    tested = [known, *(as_noisy(make_setting(r, file, shape), known) for r in others)]
    found = []
    for names in ladder:
        effects = tuple(_row(rows, name) for name in names)
        model, values = _fitted(problem, effects)
        errors = tuple(_error(s, model) for s in tested)
        found.append(Rung(tuple(names), values, errors))
    return tuple(found)


def _error(setting: Setting, model: Written) -> float:
    return float(relative([followed(setting, [model])[main_channel(setting)]])[0])


def _row(rows: Sequence[Hypothesis], name: str) -> Hypothesis:
    for row in rows:
        if row.name == name:
            return row
    raise unknown_name("effect", name, {row.name: row for row in rows})


def _fitted(problem: Problem, effects: tuple[Hypothesis, ...]) -> tuple[Written, dict[str, float]]:
    """Return a model fitted from its first starting points, and its effects' values."""
    start = [u.coordinate(x) for e in effects for u, x in zip(e.unknowns, e.starts[0], strict=True)]
    z = np.concatenate([np.zeros(len(problem.shared)), start])
    fit = problem.fit(Model(effects), z, MOVES)
    unknowns = [u for e in effects for u in e.unknowns]
    at = len(problem.shared)
    values = {u.symbol: u.value(float(fit.z[at + k])) for k, u in enumerate(unknowns)}
    return written(problem, fit.model, fit.z), values
