"""Under which arguments of the environment a policy runs, whatever form it has."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from typing import Any

from cjt_gym.envs.core import Episodes
from cjt_gym.envs.observation import Layout
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.evaluation.conditions import Conditions
from cjt_gym.training.learning.config import TrainConfig, environment_arguments

CONDITIONS = ("joint", "structure", "drive", "effects", "randomization", "dt_physics")


def conditions_of(config: TrainConfig) -> Conditions:
    """Return the conditions that a configuration trains under."""
    arguments = environment_arguments(config.env)
    given = {name: arguments[name] for name in (*CONDITIONS, "dt_control", "torque_amplitude")}
    return Conditions(**{**given, "randomization": given["randomization"] or {}})


class Trained(ABC):
    """What policies have in common, whatever their form."""

    name: str
    config: TrainConfig  # how it was trained
    layout: Layout  # what its observation is made of

    @property
    def kind(self) -> str:
        """Either "residual", on a base controller, or "learned"."""
        return "learned" if self.config.env.get("base_controller") is None else "residual"

    @property
    def renders(self) -> bool:
        """False: it follows a torque."""
        return False

    @property
    def trained_on(self) -> tuple[str, str]:
        """Joint and structure that it was trained on."""
        arguments = environment_arguments(self.config.env)
        return arguments["joint"], arguments["structure"]

    def arguments(self, conditions: Conditions) -> dict[str, Any]:
        """Return the conditions with the observation and the action that it was trained with.

        On another joint than its own, torques and velocities are scaled as is usual for that one;
        a scale that was another one in training keeps its ratio to the usual one.
        """
        layout = self.layout
        if abs(layout.dt - conditions.dt_control) > 1e-12:
            raise ConfigurationError(
                f"The policy {self.name} was trained at dt_control = {layout.dt:g} s and cannot "
                f"run at {conditions.dt_control:g} s. Set the control step to {layout.dt:g} s "
                f"(rate_hz = {1.0 / layout.dt:g} in a hardware configuration)."
            )
        own = environment_arguments(self.config.env)
        given = {key: getattr(conditions, key) for key in CONDITIONS}
        arguments = own | given
        arguments |= {"parameters": None, "disturbance": None, "history": layout.history}
        if (arguments["joint"], arguments["structure"]) == self.trained_on:
            return arguments | layout.scales()
        return arguments | scales_on(layout, own, arguments)


def scales_on(layout: Layout, own: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, float]:
    """Return the scales on another joint, in the same ratio to the usual ones."""
    scales = layout.scales()
    plain = dict.fromkeys((*scales, "disturbance", "randomization"))
    here, there = (Episodes(1, **{**a, **plain}).settings.layout.scales() for a in (own, other))
    return {name: x * there[name] / here[name] for name, x in scales.items()}
