"""What goes into an exported controller and what comes out: names, units, meaning."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cjt_gym.baselines.linear_law import MEASURED
from cjt_gym.training.deploy.layout import PER_SAMPLE

if TYPE_CHECKING:
    from cjt_gym.training.deploy.exported import Exported

REFERENCE: Final = "reference"
INPUTS: Final = {
    REFERENCE: ("N m", "wanted joint torque, now and at the next control steps"),
    "tau": ("N m", "measured joint torque"),
    "q_m": ("rad", "measured motor angle, rotor angle / n"),
    "q_g": ("rad", "measured gear angle"),
    "q_l": ("rad", "measured load angle"),
    "dq_m": ("rad/s", "measured motor velocity"),
    "dq_g": ("rad/s", "measured gear velocity"),
    "dq_l": ("rad/s", "measured load velocity"),
}
OUTPUT: Final = ("torque", "N m", "motor torque to command, at the output side of the gear")
assert tuple(INPUTS) == (REFERENCE, *MEASURED)


def used_inputs(policy: Exported) -> frozenset[str]:
    """Return the names of the inputs that a controller needs; the others may be zero."""
    scale, head = policy.on_its_joint.scale, policy.layout.head
    past = scale[head:].reshape(-1, PER_SAMPLE)
    weighs = {
        REFERENCE: np.append(scale[: head - 3], scale[head - 3]),
        "tau": np.append(past[:, 0], scale[head - 3]),
        "q_m": scale[head - 2 : head],
        "dq_m": past[:, 1],
        "dq_l": past[:, 2],
    }
    used = {name for name, values in weighs.items() if values.any()}
    return frozenset(used | (policy.base.uses if policy.base else set()))


def described(policy: Exported) -> dict[str, Any]:
    """Return inputs and output of a controller as plain data."""
    used, limit = used_inputs(policy), policy.limit
    inputs = [
        {
            "name": name,
            "unit": unit,
            "what": what,
            "size": policy.layout.preview + 1 if name == REFERENCE else 1,
            "used": name in used,
        }
        for name, (unit, what) in INPUTS.items()
    ]
    name, unit, what = OUTPUT
    output = {"name": name, "unit": unit, "what": what}
    return {"inputs": inputs, "output": output | {"limit": limit if np.isfinite(limit) else None}}
