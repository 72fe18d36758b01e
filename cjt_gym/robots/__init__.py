"""Joints inside whole robots: our actuators move the bodies of another simulation.

==========  ==========================================================
`coupling`  `CoupledRobot`: joints of a MuJoCo model and their actuators
`port`      the exchange of torque and motion at one of these joints
`models`    a one-link arm and a leg
==========  ==========================================================

MuJoCo is an optional dependency: `pip install "cjt-gym[robots]"`.

Example:
    >>> from cjt_gym.joint import load_joint
    >>> joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox")
    >>> arm = CoupledRobot(load_model("arm"), {"elbow": joint})
    >>> _ = arm.reset({"elbow": 0.5})
    >>> bool(arm.step([10.0])[0].q_l[0] > 0.4)
    True
"""

from cjt_gym.robots.coupling import CoupledRobot
from cjt_gym.robots.models import ROBOTS, Robot, get_robot, load_model
from cjt_gym.robots.port import Port

__all__ = ["ROBOTS", "CoupledRobot", "Port", "Robot", "get_robot", "load_model"]
