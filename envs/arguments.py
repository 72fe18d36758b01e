"""The arguments of the torque-tracking environment, declared once.

From `TaskArguments` come the signature of the environments, the names and defaults that commands
and TOML files take, the checks of names, and the table of the documentation.
"""

# ruff: noqa: RUF009 - `_told` returns fields
from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from cjt_gym.envs.settings import ControllerOrFactory, stated_by_joint
from cjt_gym.errors import ConfigurationError, unknown_name
from cjt_gym.joint import Joint
from cjt_gym.plant.randomization import Randomization

Class = TypeVar("Class", bound=type)


def _told(default: Any, text: str, shown: str | None = None) -> Any:
    """Return an argument by its default, its meaning, and what the table shows as its default."""
    return field(default=default, metadata={"text": text, "shown": shown})


@dataclass(frozen=True, kw_only=True)
class TaskArguments:
    """The arguments of an environment; see the table of `TorqueTrackingEnv`."""

    joint: str | Joint = _told("orange_80_6000", "name, path or `Joint`")
    structure: str | None = _told(
        None, "one of the five", 'that of the joint file, or "output_fixed_rigid_gearbox"'
    )
    drive: str | None = _told(
        None, '"current", "static", "rl" or "dq"', 'that of the joint file, or "current"'
    )
    effects: Any = _told(None, "names or {name: values}; None for those that the joint file lists")
    parameters: Mapping[str, float] | None = _told(
        None, "parameters that replace those of the joint file"
    )
    randomization: Randomization = _told(
        None, '"mild", "wide", "identified" or {name: variation}, see below'
    )
    base_controller: ControllerOrFactory | None = _told(
        None, "name of a controller, gain file, controller, or function (joint, dt) -> one"
    )
    reference: Any = _told(
        "mixed",
        '"step", "chirp", "multisine", "smooth", "mixed", file, `Signal`, torques '
        "[N m] as array or list, one per control step, or function of time [s]",
    )
    disturbance: Any = _told(
        None, "the same for load torque [N m] or, output fixed, velocity [rad/s]"
    )
    torque_amplitude: float | None = _told(
        None, "amplitude of named references [N m]", "from the joint"
    )
    velocity_scale: float | None = _told(None, "divides velocities [rad/s]", "from the task")
    action_scale: float | None = _told(
        None, "torque of an action of 1 [N m]", "3 (0.5 with a base) `torque_amplitude`"
    )
    preview: int = _told(0, "future samples of the reference in the observation")
    history: int | None = _told(None, "past samples in the observation", "4, or delay + 2")
    observe_joint: bool = _told(False, "whether four numbers of the datasheet end the observation")
    episode_steps: int = _told(1000, "control steps until truncation")
    dt_control: float = _told(1e-3, "control step [s]")
    dt_physics: float = _told(1e-4, "substep [s], a whole fraction of it")
    reward_weights: Mapping[str, float] | None = _told(None, "{term: weight}")
    reward: Callable[[Mapping[str, Any]], Any] | None = _told(
        None, "function that replaces the sum of the terms, see below"
    )


DEFAULTS: dict[str, Any] = {one.name: one.default for one in fields(TaskArguments)}


def complete(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments with their defaults and those that the joint states."""
    for name in arguments:
        if name not in DEFAULTS:
            what = "argument of TorqueTrackingEnv"
            raise ConfigurationError(str(unknown_name(what, name, DEFAULTS)))
    filled = DEFAULTS | dict(arguments)
    return filled | stated_by_joint(filled)


def argument_table() -> str:
    """Return the table of the documentation."""
    rows = ["| Argument | Default | Meaning |", "|---|---|---|"]
    for one in fields(TaskArguments):
        default = f'"{one.default}"' if isinstance(one.default, str) else str(one.default)
        shown = one.metadata["shown"] or default
        rows.append(f"| `{one.name}` | {shown} | {one.metadata['text']} |")
    return "\n".join(rows)


def takes_arguments(target: Class) -> Class:
    """Give a class the signature of `TaskArguments`.

    Its `__init__` takes `self`, arguments of its own, and `**arguments`.
    """
    init: Callable[..., None] = vars(target)["__init__"]
    own = [p for p in inspect.signature(init).parameters.values() if p.kind is not p.VAR_KEYWORD]
    task = [
        inspect.Parameter(
            one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=one.type
        )
        for one in fields(TaskArguments)
    ]
    init.__signature__ = inspect.Signature([*own, *task])  # type: ignore[attr-defined]
    return target
