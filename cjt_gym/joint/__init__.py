"""Joints: parameters, structures, drives, effects, linear models and simulation."""

from cjt_gym.joint.effects import EFFECTS, STAGES, Effect, EffectParameter
from cjt_gym.joint.files.joint_file import JointFile, joint_names, load_joint_file, to_toml
from cjt_gym.joint.files.parameters import PARAMETERS, JointParameters, Quantity
from cjt_gym.joint.joint import Joint, load_joint
from cjt_gym.joint.kernel.drives import DRIVES
from cjt_gym.joint.kernel.spring_table import read_spring
from cjt_gym.joint.structures import STRUCTURES, Structure, get_structure

__all__ = [
    "DRIVES",
    "EFFECTS",
    "PARAMETERS",
    "STAGES",
    "STRUCTURES",
    "Effect",
    "EffectParameter",
    "Joint",
    "JointFile",
    "JointParameters",
    "Quantity",
    "Structure",
    "get_structure",
    "joint_names",
    "load_joint",
    "load_joint_file",
    "read_spring",
    "to_toml",
]
