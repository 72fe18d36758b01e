"""Policies that ship with the package: small files of numbers, each with a card.

`policies/NAME.npz` is what `cjt-gym export --to numpy` writes, arrays and texts that are read
without pickle. `policies/NAME.toml` is its card: what it was trained on, what it was tested on,
where it fails.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from cjt_gym.disk import read_toml
from cjt_gym.errors import ConfigurationError, UnknownNameError, check_name, unknown_name

if TYPE_CHECKING:  # torch is only loaded for a run folder
    from cjt_gym.training.deploy.exported import Exported
    from cjt_gym.training.learning.policy import PolicyAgent


@dataclass(frozen=True)
class Card:
    """What is known of a policy that ships."""

    name: str
    summary: str  # what it is, in one line
    trained_on: str  # joint, structure, effects, recipe and steps of its training
    tested_on: str  # what it was compared on, and what came out
    fails: str  # where it should not be used


def policy_names() -> list[str]:
    """Return the names of the policies that ship."""
    return sorted(path.stem for path in _folder().glob("*.npz"))


def policy_card(name: str) -> Card:
    """Return the card of a policy that ships."""
    check_name("policy", name, policy_names())
    return Card(name, **read_toml(_folder() / f"{name}.toml", ConfigurationError))


def policy_path(word: str | Path) -> Path:
    """Return the file of a policy that ships where a word is its name, else the word as a path.

    A run folder or file of that name comes first.
    """
    path, text = Path(word), str(word)
    if path.exists() or len(path.parts) > 1 or path.suffix:
        return path
    if text in policy_names():
        return _folder() / f"{text}.npz"
    known = unknown_name("policy", text, policy_names())
    raise UnknownNameError(f"{known} Or give the path of a run folder or of an exported policy.")


def load_agent(word: str | Path) -> PolicyAgent | Exported:
    """Return the policy of a run folder, of a file of `cjt-gym export --to numpy`, or of a name."""
    path = policy_path(word)
    if path.suffix == ".npz":
        from cjt_gym.training.deploy.exported import load_exported

        return load_exported(path)
    from cjt_gym.training.learning.policy import load_policy

    return load_policy(path)


def _folder() -> Path:
    return Path(str(resources.files("cjt_gym.training"))) / "policies"
