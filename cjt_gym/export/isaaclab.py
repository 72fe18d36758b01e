"""A joint as a table with the fields of Isaac Lab's actuator configurations.

The table is YAML of plain numbers: nothing of Isaac Lab is imported. An elastic joint becomes two
joints of an articulation in series, of which only the first is driven: `motor` turns the rotor and
`spring` is the torsion bar, with the link behind it.

References:
    Isaac Lab documentation, isaaclab.actuators, version 2.3.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

from cjt_gym.export.model import (
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

TIMESTEP = 1e-3  # unless told otherwise: the usual control step [s]
Table = dict[str, dict[str, float | int | str]]

SUPPORT: Mapping[str, tuple[str, str]] = {
    "inertia": ("exact", "armature of motor"),
    "damping": ("exact", "viscous_friction"),
    "stiffness": ("exact", "stiffness of spring"),
    "current_saturation": ("exact", "effort_limit"),
    "load_inertia": ("missing", "left to the link's own masses"),
    "torque_constant": ("nearly", "multiply the effort that is commanded by torque_per_command"),
    "command_delay": ("nearly", "whole physics steps, see min_delay and max_delay"),
    "coulomb": ("nearly", "friction and dynamic_friction, without the smoothing dq_0"),
    "coulomb_asym": ("nearly", "friction with the mean of both directions"),
    "stribeck": ("nearly", "friction is the breakaway level, dynamic_friction the Coulomb level"),
    "load_coulomb": ("nearly", "friction of spring acts on the deflection; put it on the link"),
    "presliding": ("missing", "friction has no elastic presliding"),
    "gear_stiffness": ("missing", "the compliance of the gearbox is lumped into the torsion bar"),
    "hardening": ("missing", "springs are linear"),
    "spring_hysteresis": ("missing", "springs have no memory"),
    "backlash": ("missing", "springs have no play"),
    "current_lag": ("missing", "no bandwidth of the current; a learned actuator could have one"),
    "viscous_asym": ("missing", "viscous friction is the same for both directions"),
    "load_friction": ("missing", "friction does not grow with the transmitted torque"),
    "cogging": ("missing", "no torque that is periodic in the angle; add it to the effort"),
    "gear_ripple": ("missing", "no torque that is periodic in the angle; add it to the effort"),
    "torque_offset": ("missing", "add it to the effort that is commanded"),
    "thermal_derating": ("missing", "no winding that warms"),
    "command_quantization": ("missing", "round the effort that is commanded"),
    "gravity": ("missing", "left to the masses of the robot"),
}
UNITS = {
    "effort_limit": "N m",
    "velocity_limit": "rad/s",
    "saturation_effort": "N m, stall torque",
    "stiffness": "N m/rad",
    "damping": "N m s/rad",
    "armature": "kg m^2",
    "friction": "N m, static",
    "dynamic_friction": "N m",
    "viscous_friction": "N m s/rad",
    "min_delay": "physics steps",
    "max_delay": "physics steps",
    "torque_per_command": "-",
}


def to_isaaclab(joint: Joint, timestep: float = TIMESTEP) -> Export:
    """Return the actuators of a joint as a YAML table.

    Args:
        joint: The joint.
        timestep: Physics step of the simulation that will use it, in which delays count [s].

    Raises:
        ConfigurationError: The axis is prismatic, or the time step is not > 0.
    """
    check_exportable(joint, timestep, "Isaac Lab")
    exact, nearly, missing = sorted_out(joint, SUPPORT)
    lines = [
        f"# {json.dumps(joint.file.name)} as {joint.structure}; fields of isaaclab.actuators, "
        "version 2.3.",
        f"# Delays count physics steps of {number(timestep)} s. Isaac Sim 5.0 and later take"
        " friction as an effort,",
        "# earlier ones as a coefficient, for which these numbers are no substitute.",
        *(f"# {line}" for line in listed("Approximated:", nearly)),
        *(f"# {line}" for line in listed("Not in this table:", missing)),
    ]
    for name, row in actuators(joint, timestep).items():
        lines.append(f"{name}:")
        for key, value in row.items():
            unit = f"  # {UNITS[key]}" if key in UNITS else ""
            text = number(value) if isinstance(value, float) else str(value)
            lines.append(f"  {key}: {text}{unit}")
    return Export("\n".join(lines) + "\n", exact, nearly, missing)


def actuators(joint: Joint, timestep: float = TIMESTEP) -> Table:
    """Return the fields of the actuator of the motor and, where there is a spring, of its own."""
    values, _ = values_of(joint)
    table: Table = {"motor": _motor(joint, values, timestep)}
    if bodies_of(joint).springs():
        table["spring"] = {
            "class": "ImplicitActuatorCfg",
            "stiffness": _spring(joint, values),
            "damping": values["d_gl"],
            "armature": 0.0,
            "friction": 0.0,
        }
    return table


def _motor(
    joint: Joint, values: Mapping[str, float], timestep: float
) -> dict[str, float | int | str]:
    level = sum(0.5 * (values[f"d_c{b}"] + values[f"d_c{b}_n"]) for b in "mg")
    rise = sum(values[f"d_s{b}"] for b in "mg")
    row: dict[str, float | int | str] = {
        "class": "ImplicitActuatorCfg",
        "stiffness": 0.0,
        "damping": 0.0,
        "armature": values["I_m"] + values["I_g"],
        "friction": level + rise,
        "dynamic_friction": level,
        "viscous_friction": values["d_m"] + values["d_g"],
        "torque_per_command": gain_of(joint, values),
    }
    limit = values["k_t"] * values["n"] * values["i_p"]
    if math.isfinite(limit) and limit > 0.0:
        row["effort_limit"] = limit
    speed = joint.parameters.get("dq_p", 0.0)
    if speed > 0.0:
        row["velocity_limit"] = speed
    resistance, supply = values["r"], joint.parameters.get("v_0", 0.0)
    if values["command_delay"] > 0.0:
        row["class"] = "DelayedPDActuatorCfg"
        row["min_delay"] = row["max_delay"] = round(values["command_delay"] / timestep)
    elif resistance > 0.0 and supply > 0.0 and "effort_limit" in row and speed > 0.0:
        row["class"] = "DCMotorCfg"
        row["saturation_effort"] = values["k_t"] * values["n"] * supply / resistance
    return row


def _spring(joint: Joint, values: Mapping[str, float]) -> float:
    """Return the stiffness of bar and gearbox in series, where both are compliant [N m/rad]."""
    names = [name for name, _, _ in bodies_of(joint).springs()]
    compliance = sum(1.0 / values[{"gear": "k_g", "bar": "k_b"}[name]] for name in names)
    return 1.0 / compliance
