"""Gains that ship with the package: files that `cjt-gym tune` wrote, by joint and structure.

Each file names the command that made it. Its gains hold for the joint, the structure and the
sample time that it names, and are taken where the joint at hand is robust with them;
every other joint gets gains that are designed on its linear model (`cjt_gym.baselines.robust`).
"""

from __future__ import annotations

import tomllib
from functools import lru_cache
from pathlib import Path
from typing import Any

from cjt_gym.baselines.entry import ControllerEntry
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.robust import is_robust
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint

FOLDER = Path(__file__).parent / "tuned"
_DESIGNED: dict[str, dict[str, float]] = {}


@lru_cache(maxsize=256)
def _read(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def shipped_gains(entry: ControllerEntry, joint: Joint, dt: float) -> dict[str, float] | None:
    """Return the gains that ship for a joint with its delays, None if there are none that hold."""
    file = f"{entry.name}.toml"
    path = FOLDER / joint.parameters.name / joint.structure / file
    if path.name != file or not path.is_file():  # the name of code of one's own has folders
        return None
    known = _read(path)
    if abs(known["tuned"]["dt"] - dt) > 1e-9 * dt:
        return None
    gains = {name: float(number["value"]) for name, number in known["gains"].items()}
    try:
        law = entry.build(joint, dt, entry.complete(gains)).linear
    except ConfigurationError:  # the law does not take them on this joint
        return None
    if law is not None and not is_robust(SampledJoint(joint, dt), law):
        return None
    return gains


def designed_gains(entry: ControllerEntry, joint: Joint, dt: float) -> dict[str, float]:
    """Return the gains that are designed for a joint, made once for each."""
    row = f"{entry.name} {entry.tunable} {joint.file.hash_hex()} {joint.structure} {joint.drive}"
    key = f"{row} {joint.effects} {dt}"
    if key not in _DESIGNED:
        _DESIGNED[key] = entry.complete(entry.defaults(joint, dt))
    return dict(_DESIGNED[key])


def gains_of(entry: ControllerEntry, joint: Joint, dt: float) -> dict[str, float]:
    """Return the gains that a controller takes unless it is given others: shipped or designed."""
    entry.check_structure(joint)
    found = shipped_gains(entry, joint, dt)
    return designed_gains(entry, joint, dt) if found is None else entry.complete(found)
