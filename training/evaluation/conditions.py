"""Under which conditions controllers are compared: joint, effects, randomisation, references."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cjt_gym.envs.settings import USUAL, default_amplitude, stated_by_joint
from cjt_gym.errors import check_name
from cjt_gym.joint import EFFECTS, get_structure, load_joint_file
from cjt_gym.joint.effect_words import parse_effects
from cjt_gym.signals import Signal, make_signals

FULLY_KNOWN = "orange_80_6000"
"""A joint of which everything is known that `realistic_effects` asks for."""
COGGING_SHARE = 0.003
"""Amplitude of cogging over the peak torque: an assumption, as joint files know none."""
RIPPLE_SHARE = 0.02
"""Amplitude of gear ripple over the transmitted torque."""
TASKS = ("step", "chirp", "multisine", "smooth")
EVALUATION_SEEDS = 1_000_000
"""Where seeds of evaluations begin; those of training stay below."""
STEP_HOLD = 0.5
"""For which a level is held [s]: to settle and to rest."""
SWEEP_STEP = 2.5e-4
"""Of the table of a sweep [s]: twenty points of its fastest period."""
BANDWIDTH_LOW, BANDWIDTH_HIGH = 1.0, 150.0
"""Between which a bandwidth is looked for [Hz]."""
SWEEP_LOW, SWEEP_HIGH, SWEEP = 0.5, 200.0, 8.0
"""A sweep from [Hz], to [Hz], in [s]: wider than where a bandwidth is looked for."""


@dataclass(frozen=True)
class Conditions:
    """What every controller of a comparison faces.

    Attributes:
        joint: Name of the joint, or path of its file.
        structure: Its structure; where None is given that of the joint file, or else
            "output_fixed_rigid_gearbox".
        drive: Its drive; where None is given that of the joint file, or else "current".
        effects: What makes it non-ideal, as for `load_joint`: None for what the joint file lists.
        randomization: What every episode draws anew, as for the environments.
        torque_amplitude: Amplitude of the references [N m]; None for `default_amplitude`.
        dt_control: Control step [s].
        dt_physics: Substep of the simulation [s], a whole fraction of it.
    """

    joint: str
    structure: str | None = None
    drive: str | None = None
    effects: Any = None
    randomization: Mapping[str, Any] = field(default_factory=dict)
    torque_amplitude: float | None = None
    dt_control: float = 1e-3
    dt_physics: float = 1e-4

    def __post_init__(self) -> None:
        if self.structure is None or self.drive is None:
            for key, stated in stated_by_joint(vars(self)).items():
                object.__setattr__(self, key, stated)

    @property
    def arguments(self) -> dict[str, Any]:
        """The same as arguments of an environment."""
        return dict(vars(self)) | {"torque_amplitude": self.amplitude}

    @property
    def amplitude(self) -> float:
        """Amplitude of the references [N m]."""
        if self.torque_amplitude is not None:
            return self.torque_amplitude
        return default_amplitude(load_joint_file(self.joint))


def realistic_effects(joint: str) -> dict[str, dict[str, Any]]:
    """Return the effects that a comparison turns on unless told otherwise.

    Friction and sensors as the joint file has them; cogging with 2 p periods per rotor turn and
    0.36 % of the peak torque; a gear ripple of 2.2 % with two periods per rotor turn; 1 ms of
    delay each of command and measurement; velocities differentiated below 200 Hz. What the file
    lists under [effects.*] holds instead, and stands for what it excludes.
    """
    file = load_joint_file(joint)
    p = file.parameters
    effects: dict[str, dict[str, Any]] = {
        "command_delay": {"delay": 1e-3},
        "measurement_delay": {"delay": 1e-3},
        "velocity_differentiation": {"cutoff": 200.0},
        "gear_ripple": {"f": (2.0 * p.n,), "a": (RIPPLE_SHARE,), "b": (0.5 * RIPPLE_SHARE,)},
    }
    if "i_p" in p and "p" in p:
        peak = COGGING_SHARE * p.k_t * p.n * p.i_p
        effects["cogging"] = {"f": (2.0 * p.p * p.n,), "a": (peak,), "b": (2.0 / 3.0 * peak,)}
    if any(p.get(f"d_c{body}", 0.0) > 0.0 for body in "mgl"):
        effects["coulomb"] = {}
    for name, key in (("noise", "noise"), ("quantization", "resolution")):
        if any(key in known for known in file.sensors.values()):
            effects[name] = {}
    rivals = {other for name in file.effects for other in EFFECTS[name].excludes}
    kept = {name: values for name, values in effects.items() if name not in rivals}
    return kept | {name: dict(values) for name, values in file.effects.items()}


def realistic_randomization(joint: str, effects: Mapping[str, Any]) -> dict[str, Any]:
    """Return what varies between episodes of a comparison, for the effects that are on.

    Inertia 10 %, torque constant and torsion bar 5 %, friction 50 %, ripples from none to double,
    delay of the command 0.5 to 2 ms.
    """
    spec: dict[str, Any] = {"I_m": (0.9, 1.1), "k_t": (0.95, 1.05)}
    if load_joint_file(joint).parameters.get("k_b", 0.0) > 0.0:
        spec["k_b"] = (0.95, 1.05)
    if "coulomb" in effects:
        spec |= {"coulomb.d_cm": (0.5, 1.5), "coulomb.d_cg": (0.5, 1.5)}
    spec |= {f"{name}.scale": (0.0, 2.0) for name in ("cogging", "gear_ripple") if name in effects}
    if "command_delay" in effects:
        spec["command_delay.delay"] = {"low": 5e-4, "high": 2e-3, "operation": "set"}
    return spec


def realistic_conditions(
    joint: str,
    structure: str | None = None,
    *,
    effects: Mapping[str, Any] | None = None,
    randomization: str | None = None,
    **others: Any,
) -> Conditions:
    """Return conditions for a comparison.

    Args:
        joint: Name of the joint, or path of its file.
        structure: Its structure; None for that of the joint file, as in `Conditions`.
        effects: What makes it non-ideal; None for `realistic_effects`.
        randomization: Preset of what every episode draws anew; None for
            `realistic_randomization`.
        **others: Other arguments of `Conditions`.
    """
    effects = realistic_effects(joint) if effects is None else effects
    varying: dict[str, Any] = {"preset": randomization}
    if randomization is None:
        varying = realistic_randomization(joint, effects)
    return Conditions(joint, structure, effects=effects, randomization=varying, **others)


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What of the conditions a command line may say."""

    drive: str | None = None  # None for that of the joint file
    # what makes the joint non-ideal, in words; None for `realistic_effects`
    effects: tuple[str, ...] | None = None
    # preset of what every episode draws anew; None for `realistic_randomization`
    randomization: str | None = None

    def conditions_on(self, joint: str, structure: str | None, **others: Any) -> Conditions:
        """Return them on a joint; see `realistic_conditions`."""
        said = {"drive": self.drive, "randomization": self.randomization, **others}
        return realistic_conditions(joint, structure, effects=parse_effects(self.effects), **said)


def transferred(env: Mapping[str, Any], joint: str) -> dict[str, Any]:
    """Return the arguments of an environment that was described for one joint, for another one.

    Structure and drive are those of the other joint's file where it states them. Where it lists
    effects, these act, and nothing varies. A file without any, as one from a datasheet, takes over
    the effects by name, with its own numbers or those of `realistic_effects`, and what varies;
    what cannot act in it, or of which nothing is known, is left out.
    """
    file = load_joint_file(joint)
    moved = {**env, "joint": joint}
    effects, varying = moved.pop("effects", None), moved.pop("randomization", None)
    for key in ("structure", "drive"):
        if getattr(file, key) is not None:
            moved[key] = getattr(file, key)
    if file.effects or effects is None:
        return moved
    if isinstance(effects, str) or not isinstance(effects, Mapping):
        effects = dict.fromkeys([effects] if isinstance(effects, str) else effects)
    usual, known = realistic_effects(joint), realistic_effects(FULLY_KNOWN)
    structure = get_structure(moved.get("structure") or USUAL["structure"])
    moved["effects"] = {
        name: usual.get(name, values or {})
        for name, values in effects.items()
        if (name in usual or name not in known)
        and EFFECTS[name].acts_in(structure, moved.get("drive") or USUAL["drive"])
    }
    if isinstance(varying, Mapping):
        varying = {
            name: row
            for name, row in varying.items()
            if name.partition(".")[0] in moved["effects"] or name in file.parameters
        }
    return moved if varying is None else {**moved, "randomization": varying}


def task_reference(task: str, amplitude: float) -> Signal:
    """Return the reference of a task of the benchmark.

    "step": random levels held for 0.5 s; the others as the environments have them.
    """
    check_name("task", task, TASKS)
    if task == "step":
        return Signal("step", amplitude=amplitude, period=STEP_HOLD)
    return make_signals(task, amplitude)[0]


def bandwidth_reference(amplitude: float) -> Signal:
    """Return the sweep from which the bandwidth is measured: 0.5 to 200 Hz within 8 s.

    Its frequency grows exponentially, so that every octave gets the same time.
    """
    t = np.arange(0.0, SWEEP, SWEEP_STEP)
    rate = np.log(SWEEP_HIGH / SWEEP_LOW) / SWEEP
    values = np.sin(2.0 * np.pi * SWEEP_LOW * np.expm1(rate * t) / rate)
    return Signal("file", amplitude, table=np.column_stack([t, values]))


def zero_reference() -> Signal:
    """Return the reference under which noise is measured."""
    return Signal("file", amplitude=0.0, table=np.zeros((1, 2)))
