"""What goes into an exported controller and what comes out: names, units, meaning."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cjt_gym.baselines.linear_law import INPUTS
from cjt_gym.envs.observation import ROWS

if TYPE_CHECKING:
    from cjt_gym.training.deploy.exported import Exported

OUTPUT: Final = ("torque", "N m", "motor torque to command, at the output side of the gear")


def used_inputs(policy: Exported) -> frozenset[str]:
    """Return the names of the inputs that a controller needs; the others may be zero."""
    places = zip(policy.layout.names(), policy.on_its_joint.scale, strict=True)
    used = {one for name, weight in places if weight != 0.0 for one in ROWS[name].of}
    return frozenset(used | (policy.base.uses if policy.base else set()))


def described(policy: Exported) -> dict[str, Any]:
    """Return inputs and output of a controller as plain data."""
    used, limit = used_inputs(policy), policy.limit
    inputs = [
        {
            "name": name,
            "unit": unit,
            "what": what,
            "size": policy.layout.preview + 1 if name == "reference" else 1,
            "used": name in used,
        }
        for name, (unit, what) in INPUTS.items()
    ]
    name, unit, what = OUTPUT
    output = {"name": name, "unit": unit, "what": what}
    return {"inputs": inputs, "output": output | {"limit": limit if np.isfinite(limit) else None}}
