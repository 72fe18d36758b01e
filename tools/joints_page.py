"""The page of the site that shows every joint that ships: what it is and what it can do."""

from __future__ import annotations

from collections.abc import Mapping

from cjt_gym.characteristics import CHARACTERISTICS, acting
from cjt_gym.datasheet import plots
from cjt_gym.datasheet.figures import alone
from cjt_gym.datasheet.notation import number
from cjt_gym.joint import JointFile, joint_names, load_joint_file

HEAD = """# Joints that ship

Each is a file of parameters with units and sources; its name goes wherever a joint is asked for.
The figures follow from the parameters ([characteristics](characteristics.md)), on the link side;
what a file lacks is left out. Effects are those that act unless others are asked for; the figures
include those that are another value of a parameter, such as Coulomb friction. Torque and speed:
dark is continuous, light for a short time; friction comes off the motor's torque. The rest is
written by `cjt-gym datasheet NAME --out FILE.pdf`.
"""


def joints_page() -> tuple[str, dict[str, str]]:
    """Return the page in Markdown, and its pictures, SVG texts by the path from the page."""
    joints = {name: load_joint_file(name) for name in joint_names()}
    pictures = {
        f"joints/{name}.svg": alone(plots.torque_speed, [acting(joint)])
        for name, joint in joints.items()
        if CHARACTERISTICS["t_r"].value(joint.parameters) is not None
    }
    sections = [_section(name, joint, pictures) for name, joint in joints.items()]
    return "\n".join([HEAD, *sections]), pictures


def _section(name: str, joint: JointFile, pictures: Mapping[str, str]) -> str:
    p, picture = acting(joint), f"joints/{name}.svg"
    rows = [
        f"| {row.title} | {row.symbol} | {number(value)} | {row.unit(p.axis)} |"
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
    shown = [f"![Torque and speed of {name}]({picture})", ""] if picture in pictures else []
    return "\n".join([f"## {name}", "", f"{p.source}.", "", *shown, *tables])
