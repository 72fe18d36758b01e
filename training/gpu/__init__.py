"""Batches of episodes as torch tensors, on the CPU or on a CUDA device.

`pip install "cjt-gym[train]"` for the CPU, and `cjt-gym[gpu]` with it for a device.
"""

from __future__ import annotations

from typing import Any

from cjt_gym.errors import check_name
from cjt_gym.training.gpu.host import HostEpisodes

__all__ = ["HostEpisodes", "make_episodes"]


def make_episodes(num_envs: int, device: str = "cpu", **arguments: Any) -> Any:
    """Return episodes whose observations, rewards and ends are tensors.

    Args:
        num_envs: How many.
        device: "cpu" or "cuda".
        **arguments: Those of `TorqueTrackingEnv`.

    Raises:
        ConfigurationError: There is no CUDA device, or an argument is not valid.
        UnknownNameError: The device is neither of the two.
    """
    check_name("device", device, ("cpu", "cuda"))
    if device == "cpu":
        return HostEpisodes(num_envs, **arguments)
    from cjt_gym.training.gpu.device import DeviceEpisodes

    return DeviceEpisodes(num_envs, **arguments)
