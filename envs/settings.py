"""What a torque-tracking task is made of, with every default resolved."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from cjt_gym.envs.observation import Layout
from cjt_gym.envs.observe import TERMS
from cjt_gym.errors import ConfigurationError, check_name, check_range, check_type
from cjt_gym.joint import Joint, JointFile, get_structure, load_joint, load_joint_file
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.dry_friction import dry_friction
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.current_loop import with_current_loop
from cjt_gym.plant import Law, Variation
from cjt_gym.plant.randomization import resolve_randomization
from cjt_gym.plant.randomization.program import compile_plan
from cjt_gym.signals import Signal, make_signals, sampled_signal

if TYPE_CHECKING:
    from cjt_gym.envs.arguments import TaskArguments

REWARD_WEIGHTS = dict(zip(TERMS, (1.0, 0.0, 0.05, 0.0, 50.0), strict=True))
USUAL = {"structure": "output_fixed_rigid_gearbox", "drive": "current"}
"""What a joint is where neither an argument nor its file says so."""
AMPLITUDE_SHARE = 0.1
"""Torque amplitude over the peak torque: small enough that no limit is met while tracking."""
FRICTION_FACTOR = 3.0
"""Torque amplitude over the dry friction at least, so that friction is no more than a third."""
LOAD_FACTOR = 10.0
"""Inertia of a usual load over that of the actuator; a bare actuator holds no torque against it."""
BARE_SHARE = 0.1
"""Inertia of the load over that of the actuator below which a file describes a bare actuator."""
FREE_DRIFT = 1.0
"""Seconds for which a free joint without a peak speed accelerates to the speed that scales."""
TYPICAL_HZ = 20.0
"""Frequency at which the reference stretches the spring, for scales: the fastest of the tasks."""
ACTION_SHARE, RESIDUAL_SHARE = 3.0, 0.5
"""Torque of an action of 1 over the amplitude. Alone it must overcome friction and accelerate the
motor; on top of a controller it corrects, and a wide range only makes exploration rougher."""
LEAST_HISTORY = 4
"""Past samples at least: enough to see velocity and acceleration of the torque in noise."""


ControllerOrFactory = str | Law | Callable[[Joint, float], Law]


@dataclass(frozen=True)
class Settings:
    """A torque-tracking task."""

    joint: Joint
    references: tuple[Signal, ...]  # signals of which each episode draws one [N m]
    # likewise for the load input [N m] or, with a fixed output, [rad/s]
    disturbances: tuple[Signal, ...]
    layout: Layout  # what is observed, and the unit of an action
    episode_steps: int  # control steps after which an episode is truncated
    dt_physics: float  # substep [s]
    reward_weights: Mapping[str, float]  # weight of each reward term
    # what varies and how, fully spelt out
    randomization: Mapping[str, Variation] = field(default_factory=dict)


def stated_by_joint(arguments: Mapping[str, Any]) -> dict[str, str]:
    """Return structure and drive: as given, as the joint states them, or the usual ones."""
    joint = arguments["joint"]
    known = joint if isinstance(joint, Joint) else load_joint_file(joint)
    return {
        key: next(name for name in (arguments[key], getattr(known, key), usual) if name is not None)
        for key, usual in USUAL.items()
    }


def default_load(name: str, structure: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters with a load where a free output would have none.

    Joint files describe the actuator: their I_l is the bare torsion bar, against which no torque
    can be held. Where the output is free, I_l is not given and that of the file is under a tenth
    of I_m + I_g, the load is ten times I_m + I_g.
    """
    values = dict(parameters)
    file = load_joint_file(name).parameters
    actuator = values.get("I_m", file.I_m) + values.get("I_g", file.get("I_g", 0.0))
    free = not get_structure(structure).output_fixed
    if free and "I_l" not in values and file.get("I_l", 0.0) < BARE_SHARE * actuator:
        values["I_l"] = LOAD_FACTOR * actuator
    return values


def told_load(joint: Joint, loaded: Mapping[str, float]) -> str:
    """Return what to say of a load that the joint file does not have, after a sentence."""
    if "I_l" not in loaded:
        return ""
    p = joint.parameters
    return (
        f". A load of I_l = {loaded['I_l']:.4g} {p.unit('I_l')} hangs on it, as {p.name} has none "
        "against which a torque could be held; give I_l in the joint file to set it"
    )


def default_amplitude(file: JointFile) -> float:
    """Return a tenth of the peak torque, or thrice the dry friction if that is more [N m].

    The friction is that of motor and gear, as `dry_friction` counts it.
    """
    p = file.parameters
    if "i_p" not in p:
        unit = p.unit("k_t").split("/")[-1]
        raise ConfigurationError(
            f"torque_amplitude [N m] is needed: {p.origin} gives no peak current i_p from which to "
            f'take it. State it there, such as i_p = {{ value = 5, unit = "{unit}" }}.'
        )
    return max(AMPLITUDE_SHARE * p.k_t * p.n * p.i_p, FRICTION_FACTOR * dry_friction(file))


def joint_numbers(joint: Joint, amplitude: float) -> tuple[float, ...]:
    """Return what tells joints apart once torques are divided by an amplitude [N m].

    With f the frequency of motor and gear on the spring, ln(f / 20 Hz) and (20 Hz / f)^2, which is
    the torque that accelerates over that which stretches the spring at 20 Hz; the Coulomb friction
    of motor and gear and the noise of the torque sensor, both over the amplitude.
    """
    p = joint.parameters
    if "k_b" not in p or joint.structure == "rigid":
        raise ConfigurationError(
            "observe_joint must be False for a joint without a spring, got True for structure "
            f"{joint.structure} of {joint.file.name}."
        )
    f = math.sqrt(p.k_b / (p.I_m + p.get("I_g", 0.0))) / (2.0 * math.pi)
    friction = p.get("d_cm", 0.0) + p.get("d_cg", 0.0)
    known = joint.file.sensors.get("tau", {}).get("noise")
    noise = joint.effects.get("noise", {}).get("tau", 0.0 if known is None else known.value)
    assert isinstance(noise, float)
    return (
        math.log(f / TYPICAL_HZ),
        (TYPICAL_HZ / f) ** 2,
        friction / amplitude,
        noise / amplitude,
    )


def make_settings(given: TaskArguments) -> Settings:
    """Resolve the arguments of an environment."""
    joint, structure, drive = given.joint, given.structure, given.drive
    effects, parameters, dt_physics = given.effects, given.parameters, given.dt_physics
    assert structure is not None
    for name in ("parameters", "reward_weights"):
        check_type(name, getattr(given, name) or {}, Mapping, "a mapping of names to values")
    if not isinstance(joint, Joint):
        loaded = default_load(str(joint), structure, parameters or {})
        joint = load_joint(joint, structure, drive, effects, loaded)
    joint = with_current_loop(joint, dt_physics)
    check_range("episode_steps", given.episode_steps, low=1)
    load = "zero" if given.disturbance is None else given.disturbance
    disturbances = make_signals(load, 1.0, high=5.0)
    layout = _layout(joint, given, disturbances)
    variations = resolve_randomization(joint, given.randomization, layout.dt)
    layout = replace(layout, history=_history(joint, given, variations))
    steps = given.episode_steps + layout.preview + 1
    return Settings(
        joint=joint,
        references=make_signals(sampled(given.reference, steps, layout.dt), layout.torque),
        disturbances=disturbances,
        layout=layout,
        episode_steps=given.episode_steps,
        dt_physics=dt_physics,
        reward_weights=_weights(given.reward_weights),
        randomization=variations,
    )


def _layout(joint: Joint, given: TaskArguments, disturbances: tuple[Signal, ...]) -> Layout:
    """Return what is observed but its history, with usual scales where none are given."""
    torque, velocity, action = given.torque_amplitude, given.velocity_scale, given.action_scale
    if torque is None:
        torque = default_amplitude(joint.file)
    check_range("torque_amplitude", torque, "N m", above=0.0)
    if velocity is None:
        velocity = _velocity_scale(joint, torque, disturbances)
    if action is None:
        share = ACTION_SHARE if given.base_controller is None else RESIDUAL_SHARE
        action = min(share * torque, joint.torque_limit)
    n, dt = float(joint.parameters.n), given.dt_control
    layout = Layout(given.preview, 1, torque, velocity, action, n, dt)
    if not given.observe_joint:
        return layout
    return replace(layout, joint_numbers=joint_numbers(joint, layout.torque))


def sampled(reference: Any, steps: int, dt: float) -> Any:
    """Return a reference as a signal where it is an array or a function of time.

    Args:
        reference: Values [N m], one per control step, as an array or a list of shape (n,), the last
            of which holds from there on; a function of the time since the episode began [s];
            whatever else `make_signals` takes; or a list of these.
        steps: Control steps for which it is asked, that of the preview included.
        dt: Control step [s].
    """
    if isinstance(reference, (list, tuple)) and reference and all(map(_is_number, reference)):
        reference = np.asarray(reference, np.float64)
    if isinstance(reference, (list, tuple)):
        return [sampled(each, steps, dt) for each in reference]
    if isinstance(reference, np.ndarray):
        values = checked_array("reference", reference, (None,))
        values = np.pad(values, (0, max(0, steps - len(values))), "edge")
    elif callable(reference) and not isinstance(reference, Signal):
        found = [reference(k * dt) for k in range(steps)]
        values = checked_array("values of the function that is the reference", found, (steps,))
    else:
        return reference
    times: Floats = np.arange(len(values), dtype=np.float64) * dt
    return sampled_signal(times, np.asarray(values, np.float64))


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _history(joint: Joint, given: TaskArguments, variations: Mapping[str, Variation]) -> int:
    """Return how many past samples are observed, at least those that are on their way."""
    late = _lateness(joint, {}, given.dt_control)
    if given.history is None:
        longest = _lateness(joint, variations, given.dt_control)
        return max(LEAST_HISTORY, late + 2, longest)
    check_range("history", given.history, low=0, whole=True)
    if given.history < late:
        raise ConfigurationError(
            f"history must be >= {late}, the delay of the joint in control steps, so that what is "
            f"on its way stays in the observation; got {given.history}."
        )
    return max(1, given.history)


def _weights(given: Mapping[str, float] | None) -> dict[str, float]:
    for name, value in (given or {}).items():
        check_name("reward term", name, REWARD_WEIGHTS)
        check_range(f"The weight of reward term {name}", value, low=0.0)
    return {**REWARD_WEIGHTS, **(given or {})}


def _velocity_scale(joint: Joint, amplitude: float, disturbances: tuple[Signal, ...]) -> float:
    """Return the speed the task needs: to stretch the spring at 20 Hz, or that of a free load."""
    p = joint.parameters
    if joint.structure_row.output_fixed:
        load = max(abs(signal.amplitude) * (signal.kind != "zero") for signal in disturbances)
        return max(amplitude / p.k_b * 2.0 * math.pi * TYPICAL_HZ, load)
    inertia = p.I_m + p.get("I_g", 0.0) + p.get("I_l", 0.0)
    return p.get("dq_p", FREE_DRIFT * amplitude / inertia)


def _lateness(joint: Joint, variations: Mapping[str, Variation], dt: float) -> int:
    """Return the longest loop delay in control steps."""
    delays = compile_plan(joint, variations, dt).delays
    names = ("command_delay", "measurement_delay", "late_tau")
    return math.ceil(sum(delays[name] for name in names) / dt - 1e-9)
