"""Controllers with gains for the delay of a joint on a bus, and policies in their place."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from cjt_gym.baselines import Controller
from cjt_gym.baselines.gains import Choice, choose
from cjt_gym.baselines.linear_law import LinearLaw
from cjt_gym.baselines.plant_model import LoopModel, SampledJoint
from cjt_gym.baselines.robust import SPARE_DELAY, is_stable
from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.safety import check_action
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.foreign import ForeignEpisode
from cjt_gym.envs.hardware import check_measured, complete_for
from cjt_gym.errors import CjtGymWarning, ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.effects import EFFECTS, EffectParameter
from cjt_gym.joint.files.parameters import PARAMETERS
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant.measurement import Measurement
from cjt_gym.signals import sampled_signal
from cjt_gym.training.deploy.exported import Exported
from cjt_gym.training.deploy.shipped import load_agent
from cjt_gym.training.evaluation.conditions import Conditions

BUS_DELAYS: Final = ("command_delay", "measurement_delay")
"""Effects that delay a loop as a bus does, so that they are measured before a run."""
LEFT_TO_SPARE: Final = 0.5 * SPARE_DELAY
"""Rest of a delay that is no whole control step and need not become one more [s]: designed gains
stay stable with `SPARE_DELAY` beyond the delay that they are designed for."""


def law_for(word: str, joint: Joint, dt: float, delays: Mapping[str, float]) -> Controller:
    """Return a controller with gains designed for what is known of a joint, and measured delays.

    What is known are the effects of its file, such as a diagnosis writes; a motor whose torque per
    ampere differs from nominal is commanded accordingly.

    Args:
        word: Name of a controller, or a gain file, whose gains are used unchanged.
        joint: The joint; only the effects of its file count.
        dt: Control step [s].
        delays: Measured delays [s], which add up. Where those of the file are longer, they count.

    Raises:
        ConfigurationError: No gains are robust to this delay, or the given ones have no margin.
    """
    known, late, steps = _known(joint, dt, delays)
    choice, delayed = designed_for(word, joint, dt, delays)
    law = choice.make(delayed, dt)
    law.command_gain = joint.parameters.k_t / known.parameters.k_t
    if law.linear is not None:
        loop, spare = SampledJoint(_delayed(known), dt).loop, math.ceil(SPARE_DELAY / dt - 1e-9)
        borne = _borne(loop, law.linear, steps + spare)
        if borne < steps + spare:
            raise ConfigurationError(
                f"The gains of {word} must keep the loop of {joint.parameters.name} stable with a "
                f"delay of {late * 1e3:.3g} ms and {spare * dt * 1e3:.3g} ms to "
                f"spare, {steps + spare} control steps; they bear {max(borne, 0)}. Give lower "
                "gains, the name of a controller, whose gains are designed for it, or a faster "
                "loop."
            )
    return law


def designed_for(
    word: str, joint: Joint, dt: float, delays: Mapping[str, float]
) -> tuple[Choice, Joint]:
    """Return the controller of `law_for` with all its gains, and the joint that it is made for."""
    known, _, steps = _known(joint, dt, delays)
    delayed = _delayed(known, steps * dt)
    return choose(word).spelt_out(delayed, dt), delayed


def _known(joint: Joint, dt: float, delays: Mapping[str, float]) -> tuple[Joint, float, int]:
    """Return what is known of a joint, and the delay of its loop, in s and in control steps."""
    effects = resolve_effects(None, joint.file, joint.structure_row, joint.drive)
    known = known_joint(replace(joint, effects=effects))
    late = max(sum(delays.values()), sum(known.setting(name, "delay") for name in BUS_DELAYS))
    return known, late, max(0, math.ceil((late - LEFT_TO_SPARE) / dt))


def known_joint(joint: Joint) -> Joint:
    """Return a joint whose parameters have the values that its effects give them.

    Effects that do nothing else, such as `inertia`, `damping` and `torque_constant`, become
    parameters; levels of friction become parameters, too, and stay effects. What is designed on
    the linear model of the result is designed for what is known of the joint.
    """
    values: dict[str, float] = {}
    for name, numbers in joint.effects.items():
        for row in EFFECTS[name].parameters:
            symbol, number = _parameter_of(row), numbers[row.symbol]
            if symbol is None or not isinstance(number, float):
                continue
            if number != joint.parameters.get(symbol, 0.0):
                values[symbol] = number
    rest = {
        name: numbers
        for name, numbers in joint.effects.items()
        if not all(row.replaces for row in EFFECTS[name].parameters)
    }
    file = replace(joint.file, parameters=joint.parameters.replace(**values))
    return replace(joint, file=file, effects=rest)


def _parameter_of(row: EffectParameter) -> str | None:
    """Return the parameter of the joint that a number of an effect is a value of, or None.

    Those of the negative direction follow their partners.
    """
    symbol = row.relative_to if row.replaces else row.joint_parameter
    known = symbol is not None and symbol in PARAMETERS and not symbol.endswith("_n")
    return symbol if known else None


def _borne(loop: LoopModel, law: LinearLaw, most: int) -> int:
    """Return the delay that a law tolerates [samples], up to a maximum; -1 for none."""
    return next((n for n in range(most + 1) if not is_stable(loop.later(n), law)), most + 1) - 1


def _delayed(joint: Joint, delay: float = 0.0) -> Joint:
    """Return a joint whose measurements have all the delay of the bus [s]."""
    effects = {name: values for name, values in joint.effects.items() if name not in BUS_DELAYS}
    if delay:
        effects["measurement_delay"] = {"delay": delay}
    return replace(joint, effects=effects)


def _without_torch(agent: Any) -> Any:
    from cjt_gym.training.deploy.fast_policy import fast_policy  # loads torch

    return fast_policy(agent)


def _warn_of_another_joint(agent: Any, config: HardwareConfig) -> None:
    """Warn if a policy was trained on another joint or structure.

    Training on a joint file gives no warning: the file may describe this joint, as after a
    diagnosis.
    """
    if agent.config.env.get("observe_joint"):
        return
    (name, structure), joint = agent.trained_on, config.joint
    names = (joint.file.name, Path(joint.parameters.origin).stem)
    same = bool(Path(name).suffix) or name in names
    if not (same and structure == joint.structure):
        warnings.warn(
            f"The policy {agent.name} was trained on {name}, {structure}, and is used on "
            f"{joint.file.name}, {joint.structure}, where it may fail. Try it with --emulated "
            "first, or train one:  cjt-gym train --joint.",
            CjtGymWarning,
            stacklevel=2,
        )


class PolicyLaw:
    """A policy with the interface of a controller."""

    def __init__(self, word: str, arm: CanArm, k: int, reference: Floats) -> None:
        """Load the policy.

        Args:
            word: Run folder, exported policy, or name of a policy that ships.
            arm: The joints of the bus.
            k: Index of the joint to command.
            reference: Reference torque at every control step [N m].
        """
        self._arm, self._k, config = arm, k, arm.configs[k]
        agent = load_agent(word)
        _warn_of_another_joint(agent, config)
        structure, drive = config.joint.structure, config.joint.drive
        conditions = Conditions(config.joint_name, structure, drive, dt_control=config.dt)
        t = np.arange(len(reference), dtype=np.float64) * config.dt
        arguments = agent.arguments(conditions) | {"reference": sampled_signal(t, reference)}
        arguments["episode_steps"] = len(reference) + 1
        self._task = ForeignEpisode(Episodes(1, **complete_for(arguments, config)))
        self._task.episodes.seed(0, None)
        self._network = agent.network.act if isinstance(agent, Exported) else _without_torch(agent)
        self._task.rehearse()
        self._has_begun = False

    def reset(self) -> None:
        """Forget the past."""
        self._has_begun = False

    def act(self, measured: Measurement, reference: Floats) -> Floats:
        """Return the motor torque for a control step [N m], shape (1,)."""
        task = self._task
        if self._has_begun:
            task.advance(measured)
            task.conclude(self._arm.joints[self._k].sent)
        else:
            check_measured(measured, self._arm.configs[self._k])
            task.begin(measured)
            self._has_begun = True
        action = np.asarray(self._network(task.task.observation[0]), dtype=np.float64)
        trouble = check_action(float(action.reshape(-1)[0]))
        if trouble is not None:
            self._arm.fail(trouble.kind, trouble.text, self._k)
        return task.choose(action.reshape(1, 1))
