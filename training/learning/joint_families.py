"""Joints of other datasheets, drawn around the one of a training, for a policy that suits many.

With torques divided by the torque amplitude, and velocities by that which stretches the spring at
20 Hz, joints differ by few numbers: the frequency of motor and gear on the spring, the friction and
the noise of the torque sensor. These are drawn; `observe_joint` shows them to the policy. A spring
of another stiffness gives the frequency, the inertias stay. Gains of the base controller stay as
well: laws that are designed from a model are designed for each joint.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cjt_gym.envs.core import Episodes
from cjt_gym.envs.settings import AMPLITUDE_SHARE, FRICTION_FACTOR, Settings
from cjt_gym.joint import Joint
from cjt_gym.training.learning.config import TrainConfig, environment_arguments
from cjt_gym.training.learning.policy_arguments import scales_on

MOTOR_SHARE = (0.2, 0.6)
"""Between which limits the motor's share of the friction is."""


def arguments_of(config: TrainConfig) -> list[dict[str, Any]]:
    """Return arguments of `TorqueTrackingEnv` for each joint of a training."""
    if config.datasheets.count == 0:
        return [environment_arguments(config.env)]
    return datasheets(config, config.seed, config.datasheets.count)


def datasheets(config: TrainConfig, seed: int, count: int) -> list[dict[str, Any]]:
    """Return arguments of `TorqueTrackingEnv` for joints whose datasheets are drawn.

    Their frequencies are spread evenly, in logarithm, over their range.
    """
    own, ranges = environment_arguments(config.env), config.datasheets
    settings = Episodes(1, **own).settings
    rng = np.random.default_rng(seed)
    low, high = ranges.frequency
    found = []
    for k in range(count):
        frequency = low * (high / low) ** ((k + rng.uniform()) / count)
        friction = rng.uniform(*ranges.friction)
        share = rng.uniform(*MOTOR_SHARE)
        noise = math.exp(rng.uniform(*np.log(ranges.noise)))
        found.append(_with_datasheet(own, settings, frequency, friction, share, noise))
    return found


def _with_datasheet(
    own: Mapping[str, Any],
    settings: Settings,
    frequency: float,
    friction: float,
    share: float,
    noise: float,
) -> dict[str, Any]:
    joint = settings.joint
    p = joint.parameters
    k_b = (2.0 * math.pi * frequency) ** 2 * (p.I_m + p.get("I_g", 0.0))
    values = {"k_b": k_b}
    if "k_g" in p:
        values["k_g"] = p.k_g * k_b / p.k_b
    peak = AMPLITUDE_SHARE * joint.torque_limit
    total = friction * peak
    for body, part in (("m", share), ("g", 1.0 - share)):
        values |= {name: part * total for name in (f"d_c{body}", f"d_c{body}_n") if name in p}
    amplitude = max(peak, FRICTION_FACTOR * total)
    other = dict(own) | {
        "parameters": {**(own["parameters"] or {}), **values},
        "effects": _effects(own["effects"], joint, p.k_b / k_b, noise * amplitude),
    }
    scales = scales_on(settings.layout, own, other)
    torque = scales["torque_amplitude"] / settings.layout.torque
    load = torque
    if joint.structure_row.output_fixed:
        load = scales["velocity_scale"] / settings.layout.velocity
    return (
        other
        | scales
        | {
            "reference": [replace(s, amplitude=torque * s.amplitude) for s in settings.references],
            "disturbance": [
                replace(s, amplitude=load * s.amplitude) for s in settings.disturbances
            ],
        }
    )


def _effects(given: Any, joint: Joint, finer: float, noise: float) -> dict[str, dict[str, Any]]:
    """Return the effects with a torque sensor of that noise [N m], and angles finer by a factor."""
    listed = given if isinstance(given, Mapping) else {}
    effects = {name: dict(listed.get(name) or {}) for name in joint.effects}
    before = joint.setting("noise", "tau")
    for name in ("noise", "quantization"):
        if name in effects and before > 0.0:
            values: Mapping[str, Any] = joint.effects[name]
            effects[name] = {
                channel: value * (noise / before if channel == "tau" else finer)
                for channel, value in values.items()
                if channel != "i"
            }
    return effects
