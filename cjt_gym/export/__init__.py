"""Identified joints for other simulators: what they can express, and what they cannot.

==========  =====================================================
`mujoco`    an MJCF model: rotor, gear and load, springs, drive
`isaaclab`  a table with the fields of Isaac Lab's actuators
==========  =====================================================

Example:
    >>> from cjt_gym.joint import load_joint
    >>> found = to_mujoco(load_joint("orange_80_6000", "output_fixed", effects=["coulomb"]))
    >>> 'frictionloss="' in found.text, list(found.nearly)
    (True, ['coulomb'])
"""

from cjt_gym.export.isaaclab import to_isaaclab
from cjt_gym.export.model import Export
from cjt_gym.export.mujoco import to_mujoco

__all__ = ["TARGETS", "Export", "to_isaaclab", "to_mujoco"]

TARGETS = {"mujoco": to_mujoco, "isaaclab": to_isaaclab}
"""What an export can be made for."""
