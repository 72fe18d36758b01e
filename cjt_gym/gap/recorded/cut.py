"""What cuts a joint in two at its spring, so that an error on one side does not reach the other."""

from __future__ import annotations

from collections.abc import Collection
from enum import Enum

from cjt_gym.joint import Structure


class Cut(Enum):
    """Where a record cuts a joint.

    Attributes:
        NOWHERE: Motor, spring and load are one stage.
        BY_TORQUE: A measured torque separates the motor side from the load.
        BY_ANGLES: The angles at both ends of the spring do. Its torque is that of its deflection,
            in a model that knows its stiffness, so that motor and load each contain a spring.
    """

    NOWHERE = "nowhere"
    BY_TORQUE = "by torque"
    BY_ANGLES = "by angles"


def cut_of(structure: Structure, measured: Collection[str], *, still_load: bool = False) -> Cut:
    """Return what cuts a joint of which some channels were measured.

    Args:
        structure: Structure of the joint.
        measured: Names of the channels that do not follow from others.
        still_load: Whether a load that could move does not, so that its angle tells nothing.
    """
    if not structure.has_spring:
        return Cut.NOWHERE
    if "tau" in measured:
        return Cut.BY_TORQUE
    free = not structure.output_fixed and not still_load
    return Cut.BY_ANGLES if free and {"q_m", "q_l"} <= {*measured} else Cut.NOWHERE
