"""PD with feed-forward, an outer (closed-loop) disturbance observer and a prefilter.

    r'[k] = r0 - d,   d = Pc^-1 Q tau - Q z^-delay r',   u = r' + kp (r' - tau) + kd F e_d,
    e_d = r' - tau or, without lead, -tau

Pc is the nominal closed loop from r' to tau, so that d, in the sense of a reference, is what that
loop does otherwise than it should. With a prefilter r0 = Pc^-1 Qf r, else r0 = r. Where a limit
holds the command, the state continues as if the reference had asked for just that command.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from cjt_gym.baselines.entry import FIXED, Gain
from cjt_gym.baselines.linear_law import (
    REFERENCE,
    Block,
    LinearLaw,
    assemble,
    cascade,
    static,
    through,
    total,
)
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.pid import CUTOFF_HZ, DOB_HZ, KD, KP, LEAD, damping_gains, pid
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.rational import (
    Rational,
    delayed,
    held_low_pass,
    inverse_times,
    low_pass,
    transfer_function,
    tustin,
)


def outer_dob_law(
    model: SampledJoint,
    kp: float,
    kd: float,
    dob_hz: float,
    prefilter_hz: float,
    lead: float = 1.0,
) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    what, dt = f"the torque loop of {model.name}", model.dt
    loop = closed_plant(model, kp, kd, lead >= 0.5)
    order, delay = loop.relative_order, model.loop.delay
    low = low_pass(order, dob_hz)
    inverse = tustin(inverse_times(loop, low, what), dt)
    known = _self_fed(
        delayed(held_low_pass(order, dob_hz, dt), delay), through(inverse, -1.0, tau=1.0)
    )
    inner = total([static(reference=1.0), pid(kp, 0.0, kd, dt, lead)])
    whole = cascade(known, inner)
    if prefilter_hz > 0.0:
        ahead = tustin(inverse_times(loop, low_pass(order, prefilter_hz), what), dt)
        whole = cascade(through(ahead, reference=1.0), whole)
    return assemble(dt, replace(whole, g=whole.b[:, REFERENCE] / whole.d[REFERENCE]))


def closed_plant(model: SampledJoint, kp: float, kd: float, lead: bool = True) -> Rational:
    """Return the continuous joint under feed-forward and PD, from reference to joint torque."""
    plant = model.mechanics
    (a, b), c = plant.continuous, plant.row("tau")
    w = 2.0 * np.pi * CUTOFF_HZ
    # F = w - w^2 / (s + w); its state z' = -w z + e gives the output -w^2 z + w e.
    gain = kp + kd * w
    n = len(b)
    closed = np.asarray(block_diag(a, [[-w]]))
    closed[:n, :n] -= gain * np.outer(b, c)
    closed[:n, n] = -kd * w**2 * b
    closed[n, :n] = -c
    into = np.append((1.0 + (gain if lead else kp)) * b, float(lead))
    return transfer_function(closed, into, np.append(c, 0.0))


def _self_fed(low: tuple[np.ndarray, np.ndarray, np.ndarray, float], measured: Block) -> Block:
    """Return r' = r + measured + low r' as a block; low has no feed-through."""
    a, b, c, _ = low
    first = static(reference=1.0)
    m, n = len(b), len(measured.c)
    system = np.asarray(block_diag(a, measured.a))
    system[:m, :m] += np.outer(b, c)
    system[:m, m:] = np.outer(b, measured.c)
    direct = first.d + measured.d
    into = np.concatenate([np.outer(b, direct), measured.b])
    return Block(system, into, np.concatenate([c, measured.c]), direct, np.zeros(m + n))


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    damping = damping_gains(model, (0.0, 0.03, 0.1, 0.2, 0.3, 0.5))
    cutoffs = (0.2, 2.0, 6.0, 9.0, 14.0, 20.0, 35.0)
    return grid(kp=(0.0, 0.3, 0.6), kd=damping, dob_hz=cutoffs, prefilter_hz=(0.0,))


ROW = linear_row(
    name="pid_outer_dob",
    summary="Feed-forward and PD inside a disturbance observer of the closed loop, prefilter.",
    source="Kong, Bae, Tomizuka (2009), IEEE/ASME Transactions on Mechatronics 14(1); Paine, Oh, "
    "Sentis (2014), IEEE/ASME Transactions on Mechatronics 19(3)",
    tunable=(
        KP,
        KD,
        DOB_HZ,
        Gain("prefilter_hz", "Hz", 0.0, 200.0),
        LEAD,
    ),
    law=outer_dob_law,
    candidates=_candidates,
    structures=FIXED,
)
