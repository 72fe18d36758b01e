"""The controller of a run on a bus, with gains for the delay that this bus and loop have."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from cjt_gym.baselines import Controller
from cjt_gym.baselines.linear_law import LinearLaw
from cjt_gym.baselines.plant_model import LoopModel, SampledJoint
from cjt_gym.baselines.robust import SPARE_DELAY, is_stable
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.training.tuning.gains import choose

LEFT_TO_SPARE: Final = 0.5 * SPARE_DELAY
"""Rest of a delay that is no whole control step and need not become one more [s]: designed gains
bear `SPARE_DELAY` beyond what they are designed for."""


def law_for(word: str, joint: Joint, dt: float, delays: Mapping[str, float]) -> Controller:
    """Return a controller with gains that are designed for measured delays.

    Args:
        word: A row of `CONTROLLERS`, or a gain file, whose gains are taken as they are.
        joint: The nominal joint.
        dt: Control step [s].
        delays: What was measured [s]; all of them add up.

    Raises:
        ConfigurationError: No gains keep the loop robust with this delay, or the given ones have no
            margin with it.
    """
    late = sum(delays.values())
    steps = max(0, math.ceil((late - LEFT_TO_SPARE) / dt))
    delayed = _delayed(joint, steps * dt)
    law = choose(word).make(delayed, dt)
    if law.linear is not None:
        loop, spare = SampledJoint(joint, dt).loop, math.ceil(SPARE_DELAY / dt - 1e-9)
        borne = _borne(loop, law.linear, steps + spare)
        if borne < steps + spare:
            raise ConfigurationError(
                f"The gains of {word} must keep the loop of {joint.parameters.name} stable with "
                f"its measured delay of {late * 1e3:.3g} ms and {spare * dt * 1e3:.3g} ms to "
                f"spare, {steps + spare} control steps; they bear {max(borne, 0)}. Give lower "
                "gains, the name of a controller, whose gains are designed for it, or a faster "
                "loop."
            )
    return law


def _borne(loop: LoopModel, law: LinearLaw, most: int) -> int:
    """Return the delay that a law bears [samples], at most so many; -1 where it bears none."""
    return next((n for n in range(most + 1) if not is_stable(loop.later(n), law)), most + 1) - 1


def _delayed(joint: Joint, delay: float) -> Joint:
    """Return a joint whose measurement is late [s]."""
    if not delay:
        return joint
    wanted = {**joint.effects, "measurement_delay": {"delay": delay}}
    effects = resolve_effects(wanted, joint.file, joint.structure_row, joint.drive)
    return replace(joint, effects=effects)
