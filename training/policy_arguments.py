"""Under which arguments of the environment a policy runs, whatever form it has."""

from __future__ import annotations

from typing import Any

from cjt_gym.errors import ConfigurationError
from cjt_gym.training.conditions import Conditions
from cjt_gym.training.config import TrainConfig, environment_arguments
from cjt_gym.training.deploy.layout import Layout

CONDITIONS = ("joint", "structure", "drive", "effects", "randomization", "dt_physics")


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

    On another joint than its own, torques and velocities are scaled as is usual for that one.

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
    if (arguments["joint"], arguments["structure"]) == trained_on(config):
        arguments |= {
            "torque_amplitude": layout.torque,
            "velocity_scale": layout.velocity,
            "action_scale": layout.action,
        }
    return arguments
