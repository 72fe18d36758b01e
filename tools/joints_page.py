"""The page of the site that shows every joint that ships: what it is and what it can do."""

from __future__ import annotations

from cjt_gym.characteristics import CHARACTERISTICS, acting
from cjt_gym.joint import JointFile, joint_names, load_joint_file

HEAD = """# Joints that ship

Each is a file of parameters with units and sources; its name goes wherever a joint is asked for.
The figures follow from the parameters ([characteristics](characteristics.md)), on the link side;
what a file lacks is left out. Effects are those that act unless others are asked for; the figures
include those that are another value of a parameter, such as Coulomb friction.
"""


def joints_page() -> str:
    """Return the page in Markdown."""
    joints = {name: load_joint_file(name) for name in joint_names()}
    return "\n".join([HEAD, *(_section(name, joint) for name, joint in joints.items())])


def _section(name: str, joint: JointFile) -> str:
    p = acting(joint)
    rows = [
        f"| {row.title} | {row.symbol} | {value:.4g} | {row.unit(p.axis)} |"
        for row in CHARACTERISTICS.values()
        if (value := row.value(p)) is not None
    ]
    effects = [
        f"| {effect} | {key} | {setting.value:.4g} | {setting.unit} |"
        for effect, settings in joint.effects.items()
        for key, setting in settings.items()
        if not isinstance(setting, str)
    ]
    tables = ["| quantity | symbol | value | unit |", "|---|---|---|---|", *rows, ""]
    if effects:
        tables += ["| effect | key | value | unit |", "|---|---|---|---|", *effects, ""]
    return "\n".join([f"## {name}", "", f"{p.source}.", "", *tables])
