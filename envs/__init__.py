"""Gymnasium environments: track a joint torque, simulated or real, alone or in batches.

Importing `cjt_gym` registers the environments; this package is only loaded when one is made.
"""

if __name__ != "cjt_gym.envs":
    raise ImportError("This folder is installed as cjt_gym.envs: import that instead of 'envs'.")

from cjt_gym.envs.torque_tracking import TorqueTrackingEnv
from cjt_gym.envs.vector import TorqueTrackingVectorEnv

__all__ = ["TorqueTrackingEnv", "TorqueTrackingVectorEnv"]
