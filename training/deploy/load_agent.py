"""A policy by its path: a run folder, or a file that was exported from one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cjt_gym.training.deploy.exported import Exported, load_exported
from cjt_gym.training.deploy.shipped import policy_path

if TYPE_CHECKING:  # torch is only loaded for a run folder
    from cjt_gym.training.learning.policy import PolicyAgent


def load_agent(word: str | Path) -> PolicyAgent | Exported:
    """Return the policy of a run folder, of a file of `cjt-gym export --to numpy`, or of a name.

    Raises:
        UnknownNameError: There is neither a folder nor a policy that ships of that name.
        MissingFileError: There is no such path.
        ConfigurationError: It was not made by cjt-gym, or the run has no model yet.
    """
    path = policy_path(word)
    if path.suffix == ".npz":
        return load_exported(path)
    from cjt_gym.training.learning.policy import load_policy

    return load_policy(path)
