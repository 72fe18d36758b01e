"""The arguments of the torque-tracking environment, declared once.

From `TaskArguments` come the signature of the environments, the names and defaults that commands
and TOML files take, the checks of names, and the table of the documentation.
"""

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


def _told(text: str, shown: str | None = None) -> dict[str, str | None]:
    """Return what the table says of an argument."""
    return {"text": text, "shown": shown}


@dataclass(frozen=True, kw_only=True)
class TaskArguments:
    """What an environment is told; see the table of `TorqueTrackingEnv`."""

    joint: str | Joint = field(default="orange_80_6000", metadata=_told("name, path or `Joint`"))
    structure: str | None = field(
        default=None,
        metadata=_told(
            "one of the five", 'that of the joint file, or "output_fixed_rigid_gearbox"'
        ),
    )
    drive: str | None = field(
        default=None,
        metadata=_told('"current", "static", "rl" or "dq"', 'that of the joint file, or "current"'),
    )
    effects: Any = field(
        default=None,
        metadata=_told("names or {name: values}; None for those that the joint file lists"),
    )
    parameters: Mapping[str, float] | None = field(
        default=None, metadata=_told("parameters that replace those of the joint file")
    )
    randomization: Randomization = field(
        default=None, metadata=_told('"mild", "wide", "identified" or {name: variation}, see below')
    )
    base_controller: ControllerOrFactory | None = field(
        default=None,
        metadata=_told("name of a controller, controller, or function (joint, dt) -> one"),
    )
    reference: Any = field(
        default="mixed",
        metadata=_told(
            '"step", "chirp", "multisine", "smooth", "mixed", file, `Signal`, array of torques '
            "[N m], one per control step, or function of time [s]"
        ),
    )
    disturbance: Any = field(
        default=None,
        metadata=_told("the same for load torque [N m] or, output fixed, velocity [rad/s]"),
    )
    torque_amplitude: float | None = field(
        default=None, metadata=_told("amplitude of named references [N m]", "from the joint")
    )
    velocity_scale: float | None = field(
        default=None, metadata=_told("divides velocities [rad/s]", "from the task")
    )
    action_scale: float | None = field(
        default=None,
        metadata=_told("torque of an action of 1 [N m]", "3 (0.5 with a base) `torque_amplitude`"),
    )
    preview: int = field(
        default=0, metadata=_told("future samples of the reference in the observation")
    )
    history: int | None = field(
        default=None, metadata=_told("past samples in the observation", "4, or delay + 2")
    )
    observe_joint: bool = field(
        default=False, metadata=_told("whether four numbers of the datasheet end the observation")
    )
    episode_steps: int = field(default=1000, metadata=_told("control steps until truncation"))
    dt_control: float = field(default=1e-3, metadata=_told("control step [s]"))
    dt_physics: float = field(default=1e-4, metadata=_told("substep [s], a whole fraction of it"))
    reward_weights: Mapping[str, float] | None = field(
        default=None, metadata=_told("{term: weight}")
    )
    reward: Callable[[Mapping[str, Any]], Any] | None = field(
        default=None,
        metadata=_told("function that replaces the sum of the terms, see below"),
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
