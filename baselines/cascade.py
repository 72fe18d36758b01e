"""Cascade: a torque loop that asks for a motor velocity, around a velocity loop.

    w = dq_l + kt (r - tau),   u = r + kv (w - dq_m) + ki integral of (w - dq_m)

To change the torque of a spring is to move the motor against the load, so the outer loop asks for
a velocity in proportion to the torque's error. The fast inner loop takes friction and ripple away
where they arise; its integral is held back where the command is limited.
"""

from __future__ import annotations

from cjt_gym.baselines.entry import SPRUNG, Gain
from cjt_gym.baselines.linear_law import LinearLaw, assemble, integrator, static
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.pid import damper
from cjt_gym.baselines.plant_model import SampledJoint

LOOPS = (0.0, 0.03, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0)  # gains of the torque loop that are tried
RESETS = (0.5, 2.0, 5.0, 10.0, 20.0, 50.0, 150.0, 400.0)
"""Candidates for kt kv [-] and ki / kv [1/s]."""


def cascade_law(model: SampledJoint, kt: float, kv: float, ki: float) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    error = {"reference": kt, "tau": -kt, "dq_l": 1.0, "dq_m": -1.0}
    proportional = static(**{name: kv * weight for name, weight in error.items()})
    integral = integrator(ki, model.dt, 1.0 + kv * kt, **error)
    return assemble(model.dt, static(reference=1.0), proportional, integral)


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    rows = []
    for kv in damper(model, (0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.8)):
        for row in grid(loop=LOOPS, reset=RESETS):
            rows.append({"kt": row["loop"] / kv, "kv": kv, "ki": row["reset"] * kv})
    return rows


ROW = linear_row(
    name="cascade",
    summary="Torque loop around a velocity loop with integral, feed-forward.",
    source="Pratt, Krupp, Morse (2002), Industrial Robot 29(3); Wyeth (2008), Control issues for "
    "velocity sourced series elastic actuators, ACRA",
    tunable=(
        Gain("kt", "rad/(s N m)", 0.0, 1.0),
        Gain("kv", "N m s/rad", 0.0, 1000.0),
        Gain("ki", "N m/rad", 0.001, 1e5, log=True, off=True),
    ),
    law=cascade_law,
    candidates=_candidates,
    structures=SPRUNG,
)
