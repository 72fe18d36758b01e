"""A measured torque: its use without a spring, and its reading at rest."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.check.balance import left_over
from cjt_gym.gap.check.pieces import smooth
from cjt_gym.gap.check.view import View
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records.repair_notes import counted

HELPS = 0.8
"""Largest residual of the motion's balance with the torque as a load, relative to that without."""
NO_TORQUE = 0.02
"""Motor torque up to which it counts as zero, relative to the largest."""
SETTLED = 0.1
"""Settling time at the start of a rest, which is ignored [s]."""
SURE = 3.0
"""Number of standard deviations for a significant difference from zero."""


def without_spring(view: View) -> list[str]:
    """Return a remark on a torque for which the structure has no spring."""
    if view.structure.has_spring or "tau" not in view or "tau_l" in view.channels:
        return []
    said = f"tau is not used: the structure {view.structure.name} has no spring to transmit it."
    sign = _load_sign(view)
    spring = "or give a structure with a spring, such as rigid_gearbox, and its stiffness k_b."
    if sign is None:
        return [
            f"{said} Map it as tau_l, with sign = -1, if it is the torque on the load; {spring}"
        ]
    way, before, after = sign
    return [
        f"{said} As the load's torque it would explain the motion better, {100.0 * after:.2g} % of "
        f"the torque left rather than {100.0 * before:.2g} %: map it as tau_l with sign = {way}, "
        f"{spring}"
    ]


def _load_sign(view: View) -> tuple[int, float, float] | None:
    """Return the sign with which a torque explains the motion, and the residuals without and with.

    None if it does not help.
    """
    balance = view.motor
    if balance is None or "tau" not in balance:
        return None
    terms = [balance[name] for name in ("a", "v", "s", "one")]
    size = max(float(np.std(balance.y)), 1e-300)
    before = left_over(balance.y, terms) / size
    after = {k: left_over(balance.y + k * balance["tau"], terms) / size for k in (-1, 1)}
    best = min(after, key=after.__getitem__)
    return (best, before, after[best]) if after[best] < HELPS * before else None


def at_rest(view: View) -> list[str]:
    """Return a remark on the torque sensor's reading at rest without motor torque."""
    if not view.structure.has_spring or "tau" not in view or view.drive is None:
        return []
    rests = _rests(view)
    if not rests:
        return [
            "The joint is never at rest without motor torque, so that the zero of tau can only be "
            "judged in motion. Begin with half a second of rest with the spring relaxed."
        ]
    means, unit = np.array([x.mean() for x in rests]), view.channels["tau"].unit
    middle, half = 0.5 * float(means.max() + means.min()), 0.5 * float(np.ptp(means))
    noise = view.channels["tau"].noise
    least = SURE * noise / np.sqrt(min(map(len, rests))) + half
    count = counted(len(rests), "time")
    said = f"At rest without motor torque ({count}) tau reads {middle:.3g} {unit}"
    if half > noise:
        said += f" ± {half:.2g} {unit}"
    if abs(middle) <= least:
        return [f"{said}: its zero is correct within {least:.2g} {unit}."]
    return [
        f"{said}: its zero is off if the spring is relaxed then. Friction or weight can keep it "
        "loaded; rests after motion in both directions would show that."
    ]


def _rests(view: View) -> list[Floats]:
    """Return the measured torque of each rest without motor torque."""
    width, found = view.width, []
    u = [np.abs(view.driving(piece)) for piece in view.stretches]
    most = NO_TORQUE * max((float(x.max()) for x in u), default=0.0)
    for piece, drive in zip(view.stretches, u, strict=True):
        if len(piece["t"]) <= 2 * width:
            continue
        rate = np.abs(smooth(piece["tau"], width, 1, view.dt))
        slow = rate < SURE * view.channels["tau"].noise / (width * view.dt) + 1e-300
        if view.motor_body is not None and view.motor_angle != "tau":
            speed = np.abs(view.motor_body.speed(piece, width))
            slow = speed < view.motor_body.least_speed(width)
        still = slow & (drive <= most) & (piece["valid"] > 0.5)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], still, [0]])))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            settled = start + round(SETTLED / view.dt)
            if stop - settled > settled - start:
                found.append(piece["tau"][settled:stop])
    return found
