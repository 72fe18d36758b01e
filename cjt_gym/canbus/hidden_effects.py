"""Randomly drawn hidden effects, for trying a diagnosis blind."""

from __future__ import annotations

from typing import Any

import numpy as np

from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.configure import resolve_effects

HIDEABLE = (
    *("command_delay", "current_lag", "torque_constant", "torque_offset", "inertia", "damping"),
    *("coulomb", "coulomb_asym", "viscous_asym", "stribeck", "load_friction", "cogging"),
    *("gear_ripple", "stiffness", "hardening", "spring_hysteresis", "torque_gain", "torque_bias"),
)
"""Effects that may be drawn, where they can act in the joint's structure."""
LEAST, MOST = 0.6, 1.5
"""Range of the factor on how far the typical value of an effect is from none."""
TWO = 0.5
"""Probability of a second effect."""


def draw_hidden(joint: Joint, seed: int) -> dict[str, dict[str, Any]]:
    """Return one or two effects with values around their typical ones."""
    rng = np.random.default_rng(seed)
    row = joint.structure_row
    able = [name for name in HIDEABLE if EFFECTS[name].acts_in(row, joint.drive)]
    typical = resolve_effects(["all"], joint.file, row, joint.drive)
    found: dict[str, dict[str, Any]] = {}
    for _ in range(2 if rng.random() < TWO else 1):
        left = [
            name
            for name in able
            if name not in found and not any(other in EFFECTS[name].excludes for other in found)
        ]
        name = str(rng.choice(left))
        known = typical.get(name)
        if known is None:  # a rival took its place among the typical ones
            known = resolve_effects([name], joint.file, row, joint.drive)[name]
        found[name] = _scaled(joint, name, known, rng)
    return found


def _scaled(joint: Joint, name: str, values: Any, rng: np.random.Generator) -> dict[str, Any]:
    factor = float(rng.uniform(LEAST, MOST))
    scaled = dict(values)
    for symbol in EFFECTS[name].size:
        parameter = EFFECTS[name].parameter(symbol)
        assert parameter is not None
        off = parameter.neutral
        if off is None:
            off = joint.parameters.get(parameter.relative_to or "", 0.0)
        value = scaled[symbol]
        if isinstance(value, tuple):
            scaled[symbol] = tuple(off + factor * (x - off) for x in value)
        elif np.isfinite(off):
            scaled[symbol] = off + factor * (value - off)
        else:  # off at infinity, as a bandwidth
            scaled[symbol] = value / factor
    return scaled
