"""How much dry friction a joint file states."""

from __future__ import annotations

from collections import defaultdict

from cjt_gym.joint.configure import add_to, resolve_effects
from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.files.joint_file import JointFile
from cjt_gym.joint.structures import get_structure

COULOMB, DIRECTED = "coulomb", "coulomb_asym"
DRY = (COULOMB, DIRECTED, "stribeck", "presliding")
"""Effects with levels of dry friction that no other torque scales."""


def dry_friction(file: JointFile) -> float:
    """Return the dry friction that motor and gear have at most, by all that a file states [N m].

    These are the Coulomb levels of [parameters], or those that [effects.*] give instead, the larger
    of both directions, and what Stribeck friction and presliding add to them, breakaway included.
    Friction that grows with the transmitted torque is a share of every torque and not counted.
    """
    stated = {name: file.effects[name] for name in DRY if name in file.effects}
    known = any(f"d_c{b}{side}" in file.parameters for b in "mg" for side in ("", "_n"))
    if known and COULOMB not in stated and DIRECTED not in stated:
        stated[DIRECTED] = {}
    # friction acts in every structure and with every drive
    resolved = resolve_effects(stated, file, get_structure("full_dynamics"), "current")
    level: dict[str, float] = defaultdict(float)
    for name, values in resolved.items():
        for parameter in EFFECTS[name].parameters:
            add_to(level, parameter, values[parameter.symbol])
    return sum(max(level[f"d_c{b}"], level[f"d_c{b}_n"]) + level[f"d_s{b}"] for b in "mg")
