"""The environments that `import cjt_gym` registers with Gymnasium: one row each."""

from __future__ import annotations

from typing import Any

import gymnasium

TRACKING = {
    "entry_point": "cjt_gym.envs.torque_tracking:TorqueTrackingEnv",
    "vector_entry_point": "cjt_gym.envs.vector:TorqueTrackingVectorEnv",
}
ROBOT = {"entry_point": "cjt_gym.envs.robot:RobotEnv"}
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "CJT/TorqueTracking-v0": TRACKING,
    "CJT/FullDynamics-v0": {**TRACKING, "kwargs": {"structure": "full_dynamics"}},
    "CJT/RigidGearbox-v0": {**TRACKING, "kwargs": {"structure": "rigid_gearbox"}},
    "CJT/Rigid-v0": {**TRACKING, "kwargs": {"structure": "rigid"}},
    "CJT/OutputFixed-v0": {**TRACKING, "kwargs": {"structure": "output_fixed"}},
    "CJT/OutputFixedRigidGearbox-v0": {
        **TRACKING,
        "kwargs": {"structure": "output_fixed_rigid_gearbox"},
    },
    "CJT/CurrentControl-v0": {"entry_point": "cjt_gym.envs.current_control:CurrentControlEnv"},
    "CJT/Arm-v0": {**ROBOT, "kwargs": {"robot": "arm"}},
    "CJT/Leg-v0": {**ROBOT, "kwargs": {"robot": "leg"}},
    "CJT/Hardware-v0": {"entry_point": "cjt_gym.envs.hardware:HardwareEnv"},
}
"""What each is registered with in Gymnasium."""


def register() -> None:
    """Register every row."""
    for name, row in ENVIRONMENTS.items():
        gymnasium.register(id=name, **row)
