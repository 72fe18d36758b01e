"""The environments that `import cjt_gym` registers with Gymnasium: one row each."""

from __future__ import annotations

from typing import Any

import gymnasium

MODULE = "cjt_gym.envs.torque_tracking"
VECTOR_MODULE = "cjt_gym.envs.vector"
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "CJT/TorqueTracking-v0": {},
    "CJT/FullDynamics-v0": {"structure": "full_dynamics"},
    "CJT/RigidGearbox-v0": {"structure": "rigid_gearbox"},
    "CJT/Rigid-v0": {"structure": "rigid"},
    "CJT/OutputFixed-v0": {"structure": "output_fixed"},
    "CJT/OutputFixedRigidGearbox-v0": {"structure": "output_fixed_rigid_gearbox"},
}


HARDWARE = "CJT/Hardware-v0"
CURRENT = "CJT/CurrentControl-v0"
ROBOTS = {"CJT/Arm-v0": "arm", "CJT/Leg-v0": "leg"}


def register() -> None:
    """Register every row, and the environments of currents, real joints and robots: no batches."""
    for name, arguments in ENVIRONMENTS.items():
        gymnasium.register(
            id=name,
            entry_point=f"{MODULE}:TorqueTrackingEnv",
            vector_entry_point=f"{VECTOR_MODULE}:TorqueTrackingVectorEnv",
            kwargs=arguments,
        )
    gymnasium.register(id=CURRENT, entry_point="cjt_gym.envs.current_control:CurrentControlEnv")
    gymnasium.register(id=HARDWARE, entry_point="cjt_gym.envs.hardware:HardwareEnv")
    for name, robot in ROBOTS.items():
        gymnasium.register(
            id=name, entry_point="cjt_gym.envs.robot:RobotEnv", kwargs={"robot": robot}
        )
