"""A policy by its path: a run folder, or a file that was exported from one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cjt_gym.training.deploy.exported import Exported, load_exported

if TYPE_CHECKING:  # torch is only loaded for a run folder
    from cjt_gym.training.policy import PolicyAgent


def load_agent(path: str | Path) -> PolicyAgent | Exported:
    """Return the policy of a run folder, or of a file of `cjt-gym export --to numpy`.

    Raises:
        MissingFileError: There is neither.
        ConfigurationError: It is not of ours, or the run has no model yet.
    """
    if Path(path).suffix == ".npz":
        return load_exported(path)
    from cjt_gym.training.policy import load_policy

    return load_policy(path)
