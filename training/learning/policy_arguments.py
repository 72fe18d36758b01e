"""Under which arguments of the environment a policy runs, whatever form it has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cjt_gym.envs.core import Episodes
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.deploy.layout import Layout, layout_of
from cjt_gym.training.evaluation.conditions import Conditions
from cjt_gym.training.learning.config import TrainConfig, environment_arguments

CONDITIONS = ("joint", "structure", "drive", "effects", "randomization", "dt_physics")
SCALES = {"torque_amplitude": "torque", "velocity_scale": "velocity", "action_scale": "action"}
"""Scales of observation and action, and what a layout calls them."""


def kind_of(config: TrainConfig) -> str:
    """Return "residual" for a policy on a base controller, else "learned"."""
    return "learned" if config.env.get("base_controller") is None else "residual"


def trained_on(config: TrainConfig) -> tuple[str, str]:
    """Return joint and structure of a training."""
    arguments = environment_arguments(config.env)
    return arguments["joint"], arguments["structure"]


def policy_arguments(
    name: str, config: TrainConfig, layout: Layout, conditions: Conditions
) -> dict[str, Any]:
    """Return the conditions with the observation and the action that a policy was trained with.

    On another joint than its own, torques and velocities are scaled as is usual for that one; a
    scale that was another one in training keeps its ratio to the usual one.

    Args:
        name: Of the policy, for messages.
        config: How it was trained.
        layout: Its observation.
        conditions: What it faces.

    Raises:
        ConfigurationError: The control step is another one.
    """
    if abs(layout.dt - conditions.dt_control) > 1e-12:
        raise ConfigurationError(
            f"The policy {name} was trained at dt_control = {layout.dt:g} s and cannot run at "
            f"{conditions.dt_control:g} s."
        )
    arguments = environment_arguments(config.env)
    given = {key: getattr(conditions, key) for key in CONDITIONS}
    arguments |= {**given, "parameters": None, "disturbance": None, "history": layout.history}
    own = environment_arguments(config.env)
    if (arguments["joint"], arguments["structure"]) == (own["joint"], own["structure"]):
        return arguments | {name: getattr(layout, short) for name, short in SCALES.items()}
    return arguments | scales_on(layout, own, arguments)


def scales_on(layout: Layout, own: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, float]:
    """Return the scales on another joint: what they were over the usual ones, times those there.

    Args:
        layout: The observation of the policy.
        own: Arguments of the environment of the training.
        other: Those of the environment with the other joint.
    """
    plain = dict.fromkeys((*SCALES, "disturbance", "randomization"))
    here, there = (layout_of(Episodes(1, **{**a, **plain}).settings) for a in (own, other))
    return {
        name: getattr(layout, short) * getattr(there, short) / getattr(here, short)
        for name, short in SCALES.items()
    }
