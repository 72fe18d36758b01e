"""Controllers that are put together from parts, as "pid+reference+momentum_dob".

Controllers of the table that are no more than parts are made so too. The command is the sum of what
the parts of `cjt_gym.baselines.parts` add. What integrals keep while a limit holds the command, and
what observers know of it, is that of the whole sum. Gains are those of the parts, and their
defaults are chosen as for every law (`cjt_gym.baselines.robust`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, partial

import numpy as np

from cjt_gym.baselines.entry import SPRUNG, ControllerEntry, Gain, Gains
from cjt_gym.baselines.linear_law import REFERENCE, Block, LinearLaw, assemble, integrator, total
from cjt_gym.baselines.linear_row import MakeAddition, grid, linear_row
from cjt_gym.baselines.own import is_own
from cjt_gym.baselines.parts import OBSERVER, PARTS, Part
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError, check_name

JOINED = "+"


def is_composed(word: str) -> bool:
    """Return whether a word names parts, one or several."""
    return not is_own(word) and (JOINED in word or word in PARTS)


@lru_cache(maxsize=256)
def composed(word: str) -> ControllerEntry:
    """Return the row of a controller that is put together from the parts that a word names."""
    summary = f"Put together: {'; '.join(part.summary for part in _parts(word))}."
    return composed_row(word, word, summary=summary, source="cjt_gym.baselines.parts")


def composed_row(
    name: str,
    word: str,
    *,
    summary: str,
    source: str,
    tunable: tuple[Gain, ...] = (),
    candidates: Callable[[SampledJoint], Iterable[Gains]] | None = None,
    addition: MakeAddition | None = None,
    learning: Callable[[SampledJoint, LinearLaw], Gains] | None = None,
    structures: tuple[str, ...] = (),
) -> ControllerEntry:
    """Return the row of a controller that is put together from parts.

    Its defaults are those of `cjt_gym.baselines.robust`.

    Args:
        name: Its name.
        word: The parts, joined by a plus sign.
        summary: See `ControllerEntry`, like `source`.
        source: Where it comes from.
        tunable: Its gains; those of the parts if left out.
        candidates: Gains from which the defaults are chosen; what the parts try if left out.
        addition: Makes what it adds to the command of the parts.
        learning: Default gains that follow from the linear law with the defaults of the others.
        structures: Structures that it holds for; those of the parts if left out.
    """
    parts = _parts(word)
    holds = [part for part in parts if part.structures != SPRUNG]
    return linear_row(
        name,
        summary,
        source,
        tunable or tuple(gain for part in parts for gain in part.tunable),
        lambda model, **gains: assemble(model.dt, _whole(parts, model, gains)),
        candidates or partial(_tries, parts),
        structures or (holds or parts)[0].structures,
        addition or next((part.addition for part in parts if part.addition is not None), None),
        learning,
    )


def _tries(parts: Sequence[Part], model: SampledJoint) -> list[dict[str, float]]:
    return grid(**{name: tried for part in parts for name, tried in part.tries(model).items()})


def _parts(word: str) -> tuple[Part, ...]:
    """Return the parts that a word names."""
    names = word.split(JOINED)
    for name in names:
        check_name(f"part of the controller {word}", name, PARTS)
    parts = tuple(PARTS[name] for name in names)
    _check(parts, word)
    return parts


def _check(parts: Sequence[Part], word: str) -> None:
    observers = [part.name for part in parts if part.kind == OBSERVER]
    if len(observers) > 1:
        raise ConfigurationError(
            f"The controller {word} must have one disturbance observer at most, got "
            f"{', '.join(observers)}. Two of them would take the same torque off twice."
        )
    owners: dict[str, str] = {}
    for part in parts:
        shared = [gain.name for gain in part.tunable if gain.name in owners]
        if shared or [one.name for one in parts].count(part.name) > 1:
            other = owners[shared[0]] if shared else part.name
            raise ConfigurationError(
                f"The parts {other} and {part.name} of the controller {word} do the same. Leave "
                "one of them out."
            )
        owners |= {gain.name: part.name for gain in part.tunable}


def _whole(parts: Sequence[Part], model: SampledJoint, gains: Gains) -> Block:
    """Return the sum of parts as a block, with an integral of the error if there is a `ki`."""
    blocks = [
        part.block(model, {g.name: gains[g.name] for g in part.tunable if g.name in gains})
        for part in parts
    ]
    whole = total(blocks)
    if "ki" not in gains:
        return whole
    rest = np.linalg.solve(np.eye(len(whole.c)) - whole.a, whole.b[:, REFERENCE])
    direct = float(whole.c @ rest + whole.d[REFERENCE])
    integral = integrator(gains["ki"], model.dt, max(direct, 0.0), reference=1.0, tau=-1.0)
    return total([whole, integral])
