"""A joint as an MJCF model for MuJoCo.

Rotor, gear and load become hinges on one axis, with their inertias as armature; springs between
them become fixed tendons, so that all coordinates stay the absolute angles of the link side. To put
the joint into a robot, let the link's own joint take the place of "load" and the body that carries
the actuator that of the world.

References:
    MuJoCo documentation, XML reference and technical note "MuJoCo DC Motor Model", version 4.0.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

from cjt_gym.export.model import (
    Bodies,
    Export,
    bodies_of,
    check_exportable,
    gain_of,
    listed,
    number,
    sorted_out,
    values_of,
)
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.ripple import COGGING

TIMESTEP = 2.5e-4  # unless told otherwise: four to a usual control step [s]
ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML file can hold, however they are written."""
SPEED_OF_BRISTLES = 0.1
"""Frequency of a bristle against its body, as a share of what the time step allows."""
DAMPING_OF_BRISTLES = 0.5
"""Damping of bristles over the root of stiffness times inertia."""
CURRENT_FREE = "current"
_PARAMETER = "in the joint's parameters"

SUPPORT: Mapping[str, tuple[str, str]] = {
    "torque_constant": ("exact", "gain of the actuator"),
    "torque_offset": ("exact", "an actuator without input and with a bias"),
    "inertia": ("exact", _PARAMETER),
    "damping": ("exact", _PARAMETER),
    "stiffness": ("exact", _PARAMETER),
    "gear_stiffness": ("exact", _PARAMETER),
    "load_inertia": ("exact", _PARAMETER),
    "hardening": ("exact", "cubic stiffness of the tendon"),
    "current_saturation": ("exact", "ctrlrange"),
    "voltage_saturation": ("exact", "largest voltage of the dcmotor's controller"),
    "current_lag": ("exact", "first-order filter of the actuator"),
    "command_delay": ("exact", "delay of the actuator"),
    "coulomb": ("nearly", "frictionloss: a soft constraint, without the smoothing dq_0"),
    "load_coulomb": ("nearly", "frictionloss: a soft constraint, without the smoothing dq_0"),
    "coulomb_asym": ("nearly", "frictionloss with the mean of both directions, and no smoothing"),
    "backlash": ("nearly", "dead band of the tendon; its damper acts within the play as well"),
    "stribeck": ("nearly", "a passive dcmotor with LuGre friction, whose bristles yield a little"),
    "presliding": ("nearly", "a passive dcmotor with LuGre friction"),
    "cogging": ("exact", "a passive dcmotor per harmonic"),
    "thermal_derating": ("missing", "the dcmotor warms its resistance, not its torque constant"),
    "gear_ripple": ("missing", "no torque that is periodic and grows with the load"),
    "viscous_asym": (
        "missing",
        "damping is the same for both directions; the positive one is used",
    ),
    "load_friction": ("missing", "friction does not grow with the transmitted torque"),
    "spring_hysteresis": ("missing", "springs have no memory"),
    "command_quantization": ("missing", "round the command before it is written to ctrl"),
    "gravity": ("missing", "left to the masses of the robot"),
}
WITHOUT_DCMOTOR: Mapping[str, tuple[str, str]] = {
    "stribeck": ("nearly", "frictionloss at the Coulomb level: no higher breakaway"),
    "presliding": ("nearly", "frictionloss: no elastic presliding"),
    "cogging": ("missing", "needs the dcmotor of MuJoCo 4"),
    "voltage_saturation": ("missing", "needs the dcmotor of MuJoCo 4"),
}


@dataclass(frozen=True)
class Friction:
    """Dry friction of a coordinate: level and breakaway above it [N m], presliding [N m/rad]."""

    loss: float
    rise: float
    stiffness: float

    @property
    def has_bristles(self) -> bool:
        """Whether it is more than a level."""
        return self.rise > 0.0 or self.stiffness > 0.0


def to_mujoco(joint: Joint, timestep: float = TIMESTEP, dcmotor: bool = True) -> Export:
    """Return an MJCF model of a joint, with its torque command [N m] as control.

    Args:
        joint: The joint.
        timestep: Of the model [s].
        dcmotor: Whether MuJoCo's `dcmotor` may be used, which version 4 takes with the inputs that
            are needed here.

    Raises:
        ConfigurationError: The axis is prismatic, or the time step is not > 0.
    """
    check_exportable(joint, timestep, "MuJoCo")
    values, ripple = values_of(joint)
    bodies = bodies_of(joint)
    support = dict(SUPPORT) | ({} if dcmotor else dict(WITHOUT_DCMOTOR))
    exact, nearly, missing = sorted_out(joint, support)
    friction = _frictions(bodies, values)
    model = Element("mujoco", model=ILLEGAL.sub("?", joint.file.name))
    model.append(Comment(_comment(joint, nearly, missing)))
    SubElement(model, "option", timestep=number(timestep), integrator="Euler", gravity="0 0 0")
    _add_hinges(SubElement(model, "worldbody"), bodies, values, friction, timestep, dcmotor)
    _add_tendons(model, bodies, values)
    actuator = SubElement(model, "actuator")
    _add_drive(actuator, joint, values, timestep, dcmotor)
    _add_passive(actuator, bodies, values, ripple, friction, timestep, dcmotor)
    _add_sensors(SubElement(model, "sensor"), bodies)
    indent(model)
    return Export(tostring(model, encoding="unicode") + "\n", exact, nearly, missing)


def _comment(joint: Joint, nearly: Mapping[str, str], missing: Mapping[str, str]) -> str:
    """Return what the model is; nothing in it comes from a file, so that it cannot end early."""
    lines = [
        f"{joint.structure}, drive {joint.drive}. Angles and torques are those of the link side;",
        "the control is the motor torque in N m. Joint torque = stiffness (and damping) of tendon"
        " 'bar'.",
        *listed("Approximated:", nearly),
        *listed("Not in this model:", missing),
    ]
    return "\n" + "".join(f"    {line}\n" for line in lines) + "  "


# ---- mechanics
def _frictions(bodies: Bodies, values: Mapping[str, float]) -> list[Friction]:
    p, n = (bodies.total(values, "d_c", way) for way in ("", "_n"))
    rises, stiff = (bodies.total(values, stem) for stem in ("d_s", "sigma_"))
    return [
        Friction(0.5 * (up + down), rise, k)
        for up, down, rise, k in zip(p, n, rises, stiff, strict=True)
    ]


def _add_hinges(
    world: Element,
    bodies: Bodies,
    values: Mapping[str, float],
    friction: list[Friction],
    timestep: float,
    dcmotor: bool,
) -> None:
    inertia, damping = bodies.total(values, "I_"), bodies.total(values, "d_")
    for k, name in enumerate(bodies.names):
        body = SubElement(world, "body", name=name)
        SubElement(body, "inertial", pos="0 0 0", mass="1e-6", diaginertia="1e-9 1e-9 1e-9")
        given = {"armature": number(inertia[k]), "damping": number(damping[k])}
        loss = 0.0 if dcmotor and friction[k].has_bristles else friction[k].loss
        if loss > 0.0:
            # With MuJoCo's usual 20 ms the constraint of friction lets a joint creep that should
            # stick.
            given |= {
                "frictionloss": number(loss),
                "solreffriction": f"{number(2.0 * timestep)} 1",
            }
        SubElement(body, "joint", {"name": name, "axis": "0 0 1", **given})


def _add_tendons(model: Element, bodies: Bodies, values: Mapping[str, float]) -> None:
    springs = bodies.springs()
    tendons = SubElement(model, "tendon") if springs else model
    for name, one, other in springs:
        k, d = ("k_g", "d_mg") if name == "gear" else ("k_b", "d_gl")
        stiffness = number(values[k])
        if name == "bar" and values["k_3"] != 0.0:
            stiffness += f" 0 {number(values['k_3'])}"
        rest = "0"
        if values["play_gap"] > 0.0 and name == springs[0][0]:
            half, middle = 0.5 * values["play_gap"], values["play_offset"]
            rest = f"{number(middle - half)} {number(middle + half)}"
        given = {"stiffness": stiffness, "damping": number(values[d]), "springlength": rest}
        spring = SubElement(tendons, "fixed", {"name": name, **given})
        SubElement(spring, "joint", joint=bodies.names[one], coef="1")
        if other >= 0:
            SubElement(spring, "joint", joint=bodies.names[other], coef="-1")


# ---- drive
def _add_drive(
    actuator: Element, joint: Joint, values: Mapping[str, float], timestep: float, dcmotor: bool
) -> None:
    limit = joint.parameters.k_t * values["n"] * values["i_p"]
    given = {"name": "drive", "joint": "motor"}
    if math.isfinite(limit) and limit > 0.0:
        given["ctrlrange"] = f"{number(-limit)} {number(limit)}"
    delay = values["command_delay"]
    if delay > 0.0:
        samples = math.ceil(delay / timestep) + 1
        given |= {"delay": number(delay), "nsample": str(samples)}
    if joint.drive != CURRENT_FREE and dcmotor:
        SubElement(actuator, "dcmotor", given | _winding(joint, values))
        return
    lag = values["current_bandwidth"]
    if lag > 0.0:
        given |= {"dyntype": "filterexact", "dynprm": number(1.0 / (2.0 * math.pi * lag))}
    SubElement(actuator, "general", {**given, "gainprm": number(gain_of(joint, values))})


def _winding(joint: Joint, values: Mapping[str, float]) -> dict[str, str]:
    constant = number(values["k_t"] * values["n"])
    inductance = values["l_a"] if joint.drive in ("rl", "dq") else 0.0
    return {
        "input": "ff",
        "motorconst": f"{constant} {constant}",
        "resistance": number(values["r"]),
        "inductance": f"{number(inductance)} 0",
        "controller": f"0 0 0 0 0 {number(values['v_0'])}",
    }


# ---- what acts without a command
def _add_passive(
    actuator: Element,
    bodies: Bodies,
    values: Mapping[str, float],
    ripple: Floats,
    friction: list[Friction],
    timestep: float,
    dcmotor: bool,
) -> None:
    if values["torque_offset"] != 0.0:
        bias = f"{number(values['torque_offset'])} 0 0"
        given = {"name": "offset", "joint": "motor", "gainprm": "0", "biastype": "affine"}
        SubElement(actuator, "general", {**given, "biasprm": bias})
    if not dcmotor:
        return
    inertia = bodies.total(values, "I_")
    for k, name in enumerate(bodies.names):
        if friction[k].has_bristles:
            law = _bristles(friction[k], values, inertia[k], timestep)
            _add_silent(actuator, f"friction_{name}", name, lugre=law)
    for k, (f, amplitude, phase) in enumerate(harmonics(values, ripple)):
        law = f"{number(amplitude)} {number(f)} {number(phase)}"
        _add_silent(actuator, f"cogging_{k + 1}", "motor", cogging=law)


def _add_silent(actuator: Element, name: str, joint: str, **law: str) -> None:
    given = {"input": "none", "motorconst": "0 0", "resistance": "1"}
    SubElement(actuator, "dcmotor", {"name": name, "joint": joint, **given, **law})


def _bristles(law: Friction, values: Mapping[str, float], inertia: float, timestep: float) -> str:
    """Return LuGre's numbers; bristles that are not given are as stiff as the time step allows."""
    stiffness = law.stiffness or inertia * (SPEED_OF_BRISTLES / timestep) ** 2
    damping = (
        values["sigma_1"] if law.stiffness else DAMPING_OF_BRISTLES * math.sqrt(stiffness * inertia)
    )
    speed = values["v_s"] if values["v_s"] > 0.0 else 1.0
    numbers = (stiffness, damping, law.loss, law.loss + law.rise, speed)
    return " ".join(number(x) for x in numbers)


def harmonics(values: Mapping[str, float], ripple: Floats) -> list[tuple[float, float, float]]:
    """Return frequency [1/rad of q_m], amplitude [N m] and phase of each harmonic of the cogging.

    a cos(f q) + b sin(f q) = amplitude sin(f q + phase).
    """
    found = []
    for f, a, b, kind in ripple:
        if kind == COGGING and (a != 0.0 or b != 0.0):
            amplitude = values["cogging_scale"] * math.hypot(a, b)
            found.append((float(f), amplitude, math.atan2(a, b)))
    return found


def _add_sensors(sensor: Element, bodies: Bodies) -> None:
    for name in bodies.names:
        for kind, prefix in (("jointpos", "q"), ("jointvel", "dq")):
            SubElement(sensor, kind, name=f"{prefix}_{name[0]}", joint=name)
    if any(name == "bar" for name, _, _ in bodies.springs()):
        SubElement(sensor, "tendonpos", name="deflection", tendon="bar")
        SubElement(sensor, "tendonvel", name="deflection_rate", tendon="bar")
