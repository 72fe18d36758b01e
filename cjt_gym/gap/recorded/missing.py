"""What a record cannot tell because a channel is missing or constant."""

from __future__ import annotations

from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.setting import Setting


def not_judged(setting: Setting) -> tuple[str, ...]:
    """Return sentences on what the missing channels leave open."""
    there = setting.series
    said = []
    if "q_m" in there.derived:
        said.append(
            "Without the motor angle (q_m is absent or empty) the joint torque stands for it, and "
            "the spring is taken as the joint file has it: neither the "
            "spring nor the scale of the torque sensor is judged."
        )
    if setting.cut is Cut.BY_ANGLES:
        said.append(
            "Without the joint torque, the spring's is that of its deflection: its stiffness, the "
            "inertias and the torque constant are known in proportion only, and the torque sensor "
            "is not judged at all."
        )
    elif setting.has_spring and "tau" not in there:
        said.append(
            "Without the joint torque, motor, spring and load are judged as one, and the torque "
            "sensor not at all."
        )
    if setting.cut is Cut.BY_TORQUE and "q_l" not in there and not setting.structure.output_fixed:
        said.append("Without the load angle neither the spring nor the load is judged.")
    if setting.still_load:
        said.append(
            "The load never moves, so that nothing of it is judged. If it is locked, give a "
            "structure whose output is fixed."
        )
    if "i_cmd" not in there:
        said.append("Without the command i_cmd the drive is not judged.")
    elif "i" not in there:
        said.append(
            "Without the measured current, delay and lag of the drive are seen through the motor "
            "only, and an offset of the drive is one of the motor."
        )
    if setting.too_slow:
        said.append(
            "The joint resonates on its spring too fast for this log: inertia and damping are "
            "judged only roughly. Record at 1 kHz."
        )
    return tuple(said)


TWINS = (("torque_bias", "torque_offset"), ("torque_constant", "torque_gain"))
"""Effects that a record may be unable to tell apart, likelier first.

A strain gauge drifts more easily than an amplifier, but keeps its scale better than a motor."""


def same_here(setting: Setting, name: str) -> tuple[str, ...]:
    """Return the effects that this record's channels cannot tell from one under any motion."""
    pairs = [set(pair) for pair in _alike(setting)]
    pairs.append({"command_delay", "measurement_delay"})  # the same delay on all channels
    if not setting.has_spring:
        pairs += [{"inertia", "load_inertia"}, {"coulomb", "load_coulomb"}]
    return tuple(sorted(other for pair in pairs if name in pair for other in pair - {name}))


def twins(setting: Setting) -> tuple[tuple[str, str], ...]:
    """Return pairs of effects in different parts that this record's channels cannot tell apart.

    Without a spring the bodies are one part, and the same effect on another body is not a rival.
    """
    offset, gain = TWINS
    found = []
    if setting.structure.output_fixed and setting.cut is Cut.BY_TORQUE:
        found.append(offset)
    if "q_m" in setting.series.derived:
        found.append(gain)
    free = setting.has_spring and not setting.structure.output_fixed
    if free and not {"tau", "q_l"} & set(setting.series.columns):
        found.append(("coulomb", "load_coulomb"))
    return tuple(found)


def _alike(setting: Setting) -> list[tuple[str, str]]:
    """Return these pairs, and those of which neither is likelier.

    Where only the motor of a held joint is seen, its friction and its spring both lag the motion.
    """
    held = setting.structure.output_fixed and setting.has_spring
    lagging = held and "tau" not in setting.series
    return [*twins(setting), *([("presliding", "spring_hysteresis")] if lagging else [])]


def undecided(setting: Setting, name: str) -> bool:
    """Return whether an effect has such a twin."""
    return any(name in pair for pair in _alike(setting))
