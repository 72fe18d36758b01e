"""The parameters that a joint has once its effects act, such as those that a diagnosis named.

Some effects are another value of a parameter: friction that the data sheet does not know, another
stiffness, inertia, torque constant or peak current. Torque, speed, power and bandwidth follow from
the values that act. Other effects (Stribeck and load-dependent friction, ripple, delays, noise) are
no parameter and are left out.
"""

from __future__ import annotations

from dataclasses import replace

from cjt_gym.joint import EFFECTS, Joint, JointFile, JointParameters, Quantity, get_structure
from cjt_gym.joint.configure import resolve_effects

SYMBOLS = (
    *("I_m", "I_g", "I_l", "k_g", "k_b", "k_t", "i_p"),
    *("d_m", "d_g", "d_l", "d_cm", "d_cg", "d_cl"),
)
"""Parameters that effects may change."""
SIGMAS = 2.0 * 1.959964
"""Width of a 95 % interval in standard deviations."""


def with_effects(file: JointFile) -> Joint:
    """Return the joint of a file with its effects, in the widest structure that it allows."""
    p = file.parameters
    structure = "rigid"
    if "k_b" in p:
        structure = "full_dynamics" if "k_g" in p else "rigid_gearbox"
    effects = resolve_effects(None, file, get_structure(structure), "current")
    return Joint(file, structure, "current", effects)


def acting(file: JointFile) -> JointParameters:
    """Return the parameters of a joint file as its effects make them.

    A 95 % interval of an effect becomes the tolerance of the parameter.

    Example:
        >>> from dataclasses import replace
        >>> from cjt_gym.joint import load_joint_file
        >>> file = load_joint_file("orange_80_6000")
        >>> found = {"coulomb": {"d_cm": Quantity(4.0, "N m", low=3.8, high=4.2)}}
        >>> acting(replace(file, effects=found)).d_cm
        4.0
    """
    p, joint = file.parameters, with_effects(file)
    changed: dict[str, Quantity] = {}
    for symbol, value in _changed(joint).items():
        said = [file.effects[name].get(symbol) for name in joint.effects]
        known = [q for q in said if isinstance(q, Quantity) and q.value == value]
        entry = known[0] if known else Quantity(value, p.unit(symbol), f"effects of {file.name}")
        changed[symbol] = replace(entry, tolerance=_tolerance(entry), low=None, high=None)
        if (back := f"{symbol}_n") in p:
            opposite = float(joint.packed()[0][back][0]) if symbol.startswith("d_c") else value
            changed[back] = replace(changed[symbol], value=opposite, asymmetric=True)
    return p.replace(**changed)


def changing(file: JointFile) -> tuple[str, ...]:
    """Return the names of the effects of a joint file that change one of its parameters."""
    joint = with_effects(file)
    changed = set(_changed(joint))
    return tuple(name for name in joint.effects if changed & set(file.effects[name]))


def _changed(joint: Joint) -> dict[str, float]:
    """Return the parameters that effects change, with the values that act.

    A level that the file does not give and that stands for no parameter, such as the Coulomb
    friction that may come with Stribeck friction, changes none.
    """
    record, _ = joint.packed()
    touched = {
        field
        for name in joint.effects
        for row in EFFECTS[name].parameters
        if row.symbol in joint.file.effects[name] or row.joint_parameter or row.relative_to
        for field in row.fields
        if field in SYMBOLS
    }
    values = {symbol: float(record[symbol][0]) for symbol in sorted(touched)}
    return {s: value for s, value in values.items() if value != joint.parameters.get(s, 0.0)}


def _tolerance(quantity: Quantity) -> float | None:
    if not (isinstance(quantity.low, float) and isinstance(quantity.high, float)):
        return quantity.tolerance
    return (quantity.high - quantity.low) / SIGMAS / abs(quantity.number)
