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
from collections.abc import Mapping
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError
from cjt_gym.export.model import (
    Bodies,
    Export,
    bodies_of,
    gain_of,
    listed,
    number,
    sorted_out,
    values_of,
)
from cjt_gym.joint import Joint
from cjt_gym.joint.ripple import COGGING

Ripple = NDArray[np.float64]
TIMESTEP = 2.5e-4
SPEED_OF_BRISTLES = 0.1
"""Frequency of a bristle against its body, as a share of what the time step allows."""
DAMPING_OF_BRISTLES = 0.5
"""Damping of bristles over the root of stiffness times inertia."""
CURRENT_FREE = "current"
_SENSOR = "the sensors of MuJoCo are ideal; add it to what they report"
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
    "torque_gain": ("missing", _SENSOR),
    "torque_bias": ("missing", _SENSOR),
    "torque_delay": ("missing", _SENSOR),
    "quantization": ("missing", _SENSOR),
    "noise": ("missing", _SENSOR),
    "measurement_delay": ("missing", _SENSOR),
}
WITHOUT_DCMOTOR: Mapping[str, tuple[str, str]] = {
    "stribeck": ("nearly", "frictionloss at the Coulomb level: no higher breakaway"),
    "presliding": ("nearly", "frictionloss: no elastic presliding"),
    "cogging": ("missing", "needs the dcmotor of MuJoCo 4"),
    "voltage_saturation": ("missing", "needs the dcmotor of MuJoCo 4"),
}


@dataclass(frozen=True)
class Friction:
    """Dry friction of one coordinate.

    Attributes:
        loss: Level [N m].
        rise: What breakaway lies above it [N m].
        stiffness: Of presliding [N m/rad]; 0 for none.
    """

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
    if not (math.isfinite(timestep) and timestep > 0.0):
        raise ConfigurationError(f"timestep of the export must be > 0 s, got {timestep}.")
    if joint.parameters.axis == "prismatic":
        raise ConfigurationError(
            f"{joint.file.name} is prismatic; only rotary joints can be exported to MuJoCo."
        )
    values, ripple = values_of(joint)
    bodies = bodies_of(joint)
    support = dict(SUPPORT) | ({} if dcmotor else dict(WITHOUT_DCMOTOR))
    exact, nearly, missing = sorted_out(joint, support)
    friction = _frictions(bodies, values)
    lines = [
        "<!--",
        *_comment(joint, nearly, missing),
        "-->",
        f"<mujoco model={quoteattr(joint.file.name)}>",
        f'  <option timestep="{number(timestep)}" integrator="Euler" gravity="0 0 0"/>',
        "  <worldbody>",
        *_hinges(bodies, values, friction, timestep, dcmotor),
        "  </worldbody>",
        *_section("tendon", _tendons(bodies, values)),
        "  <actuator>",
        *_drive(joint, values, timestep, dcmotor),
        *_passive(bodies, values, ripple, friction, timestep, dcmotor),
        "  </actuator>",
        "  <sensor>",
        *_sensors(bodies),
        "  </sensor>",
        "</mujoco>",
    ]
    return Export("\n".join(lines) + "\n", exact, nearly, missing)


def _comment(joint: Joint, nearly: Mapping[str, str], missing: Mapping[str, str]) -> list[str]:
    return [
        f"  {joint.file.name} as {joint.structure}, drive {joint.drive}. "
        "Angles and torques are those of the link side;",
        "  the control is the motor torque in N m. Joint torque = stiffness (and damping) of tendon"
        " 'bar'.",
        *(f"  {line}" for line in listed("Approximated:", nearly)),
        *(f"  {line}" for line in listed("Not in this model:", missing)),
    ]


def _section(name: str, lines: list[str]) -> list[str]:
    return [f"  <{name}>", *lines, f"  </{name}>"] if lines else []


# ---- mechanics
def _frictions(bodies: Bodies, values: Mapping[str, float]) -> list[Friction]:
    p, n = (bodies.total(values, "d_c", way) for way in ("", "_n"))
    rises, stiff = (bodies.total(values, stem) for stem in ("d_s", "sigma_"))
    return [
        Friction(0.5 * (up + down), rise, k)
        for up, down, rise, k in zip(p, n, rises, stiff, strict=True)
    ]


def _hinges(
    bodies: Bodies,
    values: Mapping[str, float],
    friction: list[Friction],
    timestep: float,
    dcmotor: bool,
) -> list[str]:
    lines = []
    inertia, damping = bodies.total(values, "I_"), bodies.total(values, "d_")
    for k, name in enumerate(bodies.names):
        loss = 0.0 if dcmotor and friction[k].has_bristles else friction[k].loss
        # With MuJoCo's usual 20 ms the constraint of friction lets a joint creep that should stick.
        hard = f'solreffriction="{number(2.0 * timestep)} 1"'
        more = f' frictionloss="{number(loss)}" {hard}' if loss > 0.0 else ""
        lines += [
            f'    <body name="{name}">',
            '      <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>',
            f'      <joint name="{name}" axis="0 0 1" armature="{number(inertia[k])}" '
            f'damping="{number(damping[k])}"{more}/>',
            "    </body>",
        ]
    return lines


def _tendons(bodies: Bodies, values: Mapping[str, float]) -> list[str]:
    lines = []
    springs = bodies.springs()
    for name, one, other in springs:
        k, d = ("k_g", "d_mg") if name == "gear" else ("k_b", "d_gl")
        stiffness = number(values[k])
        if name == "bar" and values["k_3"] != 0.0:
            stiffness += f" 0 {number(values['k_3'])}"
        rest = "0"
        if values["play_gap"] > 0.0 and name == springs[0][0]:
            half, middle = 0.5 * values["play_gap"], values["play_offset"]
            rest = f"{number(middle - half)} {number(middle + half)}"
        lines.append(
            f'    <fixed name="{name}" stiffness="{stiffness}" damping="{number(values[d])}" '
            f'springlength="{rest}">'
        )
        lines.append(f'      <joint joint="{bodies.names[one]}" coef="1"/>')
        if other >= 0:
            lines.append(f'      <joint joint="{bodies.names[other]}" coef="-1"/>')
        lines.append("    </fixed>")
    return lines


# ---- drive
def _drive(joint: Joint, values: Mapping[str, float], timestep: float, dcmotor: bool) -> list[str]:
    limit = joint.parameters.k_t * values["n"] * values["i_p"]
    common = 'name="drive" joint="motor"'
    if math.isfinite(limit) and limit > 0.0:
        common += f' ctrlrange="{number(-limit)} {number(limit)}"'
    delay = values["command_delay"]
    if delay > 0.0:
        samples = math.ceil(delay / timestep) + 1
        common += f' delay="{number(delay)}" nsample="{samples}"'
    if joint.drive != CURRENT_FREE and dcmotor:
        return [f"    <dcmotor {common} {_winding(joint, values)}/>"]
    lag = values["current_bandwidth"]
    if lag > 0.0:
        common += f' dyntype="filterexact" dynprm="{number(1.0 / (2.0 * math.pi * lag))}"'
    return [f'    <general {common} gainprm="{number(gain_of(joint, values))}"/>']


def _winding(joint: Joint, values: Mapping[str, float]) -> str:
    constant = number(values["k_t"] * values["n"])
    inductance = values["l_a"] if joint.drive in ("rl", "dq") else 0.0
    return (
        f'input="ff" motorconst="{constant} {constant}" resistance="{number(values["r"])}" '
        f'inductance="{number(inductance)} 0" controller="0 0 0 0 0 {number(values["v_0"])}"'
    )


# ---- what acts without a command
def _passive(
    bodies: Bodies,
    values: Mapping[str, float],
    ripple: Ripple,
    friction: list[Friction],
    timestep: float,
    dcmotor: bool,
) -> list[str]:
    lines = []
    if values["torque_offset"] != 0.0:
        lines.append(
            '    <general name="offset" joint="motor" gainprm="0" biastype="affine" '
            f'biasprm="{number(values["torque_offset"])} 0 0"/>'
        )
    if not dcmotor:
        return lines
    inertia = bodies.total(values, "I_")
    for k, name in enumerate(bodies.names):
        if friction[k].has_bristles:
            law = _bristles(friction[k], values, inertia[k], timestep)
            lines.append(_silent(f"friction_{name}", name, f'lugre="{law}"'))
    for k, (f, amplitude, phase) in enumerate(harmonics(values, ripple)):
        law = f"{number(amplitude)} {number(f)} {number(phase)}"
        lines.append(_silent(f"cogging_{k + 1}", "motor", f'cogging="{law}"'))
    return lines


def _silent(name: str, joint: str, law: str) -> str:
    """Return a dcmotor without input and without current."""
    return (
        f'    <dcmotor name="{name}" joint="{joint}" input="none" motorconst="0 0" '
        f'resistance="1" {law}/>'
    )


def _bristles(law: Friction, values: Mapping[str, float], inertia: float, timestep: float) -> str:
    """Return LuGre's numbers; bristles that are not given are as stiff as the time step allows."""
    stiffness = law.stiffness or inertia * (SPEED_OF_BRISTLES / timestep) ** 2
    damping = (
        values["sigma_1"] if law.stiffness else DAMPING_OF_BRISTLES * math.sqrt(stiffness * inertia)
    )
    speed = values["v_s"] if values["v_s"] > 0.0 else 1.0
    numbers = (stiffness, damping, law.loss, law.loss + law.rise, speed)
    return " ".join(number(x) for x in numbers)


def harmonics(values: Mapping[str, float], ripple: Ripple) -> list[tuple[float, float, float]]:
    """Return frequency [1/rad of q_m], amplitude [N m] and phase of each harmonic of the cogging.

    a cos(f q) + b sin(f q) = amplitude sin(f q + phase).
    """
    found = []
    for f, a, b, kind in ripple:
        if kind == COGGING and (a != 0.0 or b != 0.0):
            amplitude = values["cogging_scale"] * math.hypot(a, b)
            found.append((float(f), amplitude, math.atan2(a, b)))
    return found


def _sensors(bodies: Bodies) -> list[str]:
    lines = [
        f'    <joint{kind} name="{prefix}_{name[0]}" joint="{name}"/>'
        for name in bodies.names
        for kind, prefix in (("pos", "q"), ("vel", "dq"))
    ]
    if any(name == "bar" for name, _, _ in bodies.springs()):
        lines += [
            '    <tendonpos name="deflection" tendon="bar"/>',
            '    <tendonvel name="deflection_rate" tendon="bar"/>',
        ]
    return lines
