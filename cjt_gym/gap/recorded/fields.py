"""The fields of a model of the joint, at their nominal values.

A model is a dictionary of fields. Nominal parameters, sensor offsets and effects are all fields;
an inactive effect has its neutral value. Stages read fields, candidates change them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ParameterError
from cjt_gym.joint import JointFile, JointParameters, Structure
from cjt_gym.joint.linear import check_inertias

Fields = dict[str, float]

CHAIN: Final = ("I_m", "I_g", "I_l", "k_g", "k_b", "d_m", "d_g", "d_l", "d_mg", "d_gl")
LAW: Final = ("c_p", "c_n", "s_p", "s_n", "v_s", "d_p", "d_n", "z_s", "mu", "dq_0")
"""Fields of a friction law, each followed by ``_m``, ``_g`` or ``_l``; see the kernel's columns."""
LAW_SIZE: Final = len(LAW)
NEUTRAL: Final[Mapping[str, float]] = {
    "i_0": 0.0,  # offset of the current sensor [A]
    "tau_0": 0.0,  # offset of the torque sensor [N m]
    "q_0": 0.0,  # deflection at which the spring is relaxed [rad]
    "w_i": 0.8,  # weight of the newer of two current samples in the mean between them
    "delay": 0.0,  # dead time of the command [s]
    "lag": 0.0,  # time constant of the current loop [s]
    "i_max": np.inf,  # limit of the current [A]
    "dead": 0.0,  # commands below it have no effect [A]
    "less": 0.0,  # amount by which those above it are reduced [A]
    "slew": np.inf,  # fastest change of the current [A/s]
    "step": 0.0,  # resolution of the command [A]
    "offset": 0.0,  # constant torque on the motor [N m]
    "derate": 0.0,  # loss of torque per mean square current [1/A^2]
    "heat": 5.0,  # thermal time constant [s]
    "cog_f": 0.0,
    "cog_a": 0.0,
    "cog_b": 0.0,  # cogging: frequency [rad/rad], cos and sin amplitudes [N m]
    "rip_f": 0.0,
    "rip_a": 0.0,
    "rip_b": 0.0,  # gear ripple: the same, amplitudes relative to the torque
    "play": 0.0,  # width of a backlash at the torsion bar [rad]
    "play_g": 0.0,  # width of a backlash in the compliant gear [rad]
    "centre_g": 0.0,  # its middle, from the gear's first angle [rad]
    "pull_g": 0.0,  # whether its damper resists parting teeth, 1 or 0
    "hard": 0.0,  # cubic stiffness over linear stiffness [1/rad^2]
    "hyst": 0.0,  # torque of the hysteresis [N m]
    "hyst_z": 1e-3,  # its displacement [rad]
    "hyst_n": 2.0,  # how sharply it yields: the exponent of Bouc-Wen, 0 for Maxwell slip
    "gain": 1.0,  # torque sensor: measured over true
    "late": 0.0,  # torque sensor: delay [s]
    "skew": 0.0,  # small part of the delay, within the sampling tolerance [s]
    "grav_a": 0.0,
    "grav_b": 0.0,  # weight: amplitudes of cos(q_l), sin(q_l) [N m]
} | {f"{name}_{body}": 0.0 for name in LAW for body in "mgl"}


def nominal_fields(joint: JointFile, structure: Structure) -> Fields:
    """Return the fields of the nominal joint without the effects that its file lists."""
    p = joint.parameters
    fields: Fields = dict(NEUTRAL)
    fields["n"] = p.get("n", 1.0)
    fields["k_t"] = p.k_t
    fields |= {name: p.get(name, 0.0) for name in CHAIN}
    for name in structure.needed_parameters:
        fields[name] = getattr(p, name)  # raises a clear error if it is absent
    fields["i_max"] = p.get("i_p", np.inf)
    return fields


def body_group(structure: Structure, body: str) -> str:
    """Return the letters of the bodies that move as one with a given one."""
    group = structure.groups["mgl".index(body)]
    return "".join(b for b, g in zip("mgl", structure.groups, strict=True) if g == group)


def check_bodies(p: JointParameters, structure: Structure) -> None:
    """Refuse a joint of which a body that moves, or the motor, has no inertia.

    Raises:
        ParameterError: An inertia is absent or zero.
    """
    check_inertias(p, structure)
    if p.I_m <= 0.0:
        raise ParameterError(
            f"I_m of {p.origin} must be > 0 {p.unit('I_m')}, got {p.I_m:g}. If another inertia "
            "contains the rotor's, give a part of it as I_m."
        )


def own_field(name: str, number: int) -> str:
    """Return the field that holds the difference of a field in a further record."""
    return f"{name}@{number}"


def of_record(fields: Fields, number: int) -> Fields:
    """Return the fields of the model for a further record, with its differences added."""
    mark = own_field("", number)
    own = {name.removesuffix(mark): x for name, x in fields.items() if name.endswith(mark)}
    return fields | {name: fields[name] + x for name, x in own.items()}


def friction_law(fields: Fields, body: str) -> NDArray[np.float64]:
    """Return a body's friction law in the kernel's format, shape (10,); body is m, g or l."""
    return np.array([fields[f"{name}_{body}"] for name in LAW])


def has_friction(fields: Fields, body: str) -> bool:
    """Return whether a body has more than viscous friction."""
    return any(
        fields[f"{name}_{body}"] != 0.0 for name in ("c_p", "c_n", "s_p", "s_n", "d_p", "d_n", "mu")
    )
