"""The bodies and springs of each stage, which depend on what cuts the joint."""

from __future__ import annotations

from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.stages.chain import GEAR, LOAD, MOTOR, Chain, Link, build_chain

Groups = tuple[int, int, int]
Links = tuple[Link, ...]


def stage_chain(setting: Setting, name: str, fields: Fields) -> Chain:
    """Return the chain of a stage of a joint.

    Args:
        setting: The record and its joint.
        name: "motor", "transmission" or "load"; "loose" behind it for a gear that is in its play.
        fields: Values of the joint.
    """
    gear, bar = (fields["k_g"], fields["d_mg"]), (fields["k_b"], fields["d_gl"])
    driven = Link(GEAR, None, *gear)  # by the measured angle of the motor
    chains: dict[str, tuple[Groups, Links]] = {
        "motor loose": ((0, 1, -1), ()),
        "transmission": ((-1, 0, -1), (driven,)),
        "transmission loose": ((-1, 0, -1), ()),
        "load": ((-1, -1, 0), ()),
    }
    if name == "motor":
        groups, links = _motor(setting, gear, bar)
    elif name == "load" and setting.cut is Cut.BY_ANGLES and setting.has_gear:
        groups, links = (-1, 1, 0), (driven, Link(GEAR, LOAD, *bar))
    elif name == "load" and setting.cut is Cut.BY_ANGLES:
        groups, links = (-1, -1, 0), (Link(LOAD, None, *bar),)
    else:
        groups, links = chains[name]
    inertia = [fields[f] for f in ("I_m", "I_g", "I_l")]
    damping = [fields[f] for f in ("d_m", "d_g", "d_l")]
    return build_chain(groups, inertia, damping, links, setting.series.dt)


def _motor(
    setting: Setting, gear: tuple[float, float], bar: tuple[float, float]
) -> tuple[Groups, Links]:
    """Return the bodies of the motor's stage and what joins them: as far as a measured signal."""
    last = 1 if setting.has_gear else 0
    links = (Link(MOTOR, GEAR, *gear),) if setting.has_gear else ()
    if setting.cut is Cut.BY_TORQUE:
        return (0, last, -1), links
    if not setting.has_spring:
        return (0, last, last), links
    if setting.structure.output_fixed or "q_l" in setting.series:
        return (0, last, -1), (*links, Link(GEAR, None, *bar))
    return (0, last, last + 1), (*links, Link(GEAR, LOAD, *bar))
