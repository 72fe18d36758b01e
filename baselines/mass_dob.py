"""Feed-forward and PD with a disturbance observer around the motor's rotating mass.

    u = r + kp e + kd F e_d + f,   e_d = -tau or, with lead, e
       f = Q (z^-delay u - tau) - Q (J s + d) dq_m

The motor (with gear) is taken as a mass J with viscous damping d that the command and the
measured joint torque move, P = 1 / (J s + d); f is the torque that opposes it beside these two:
friction and ripple. No spring and no load is in P, so that the observer is the same whatever the
joint moves, and holds for a free load too. Q is a Butterworth low pass of second order.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cjt_gym.baselines.entry import SPRUNG
from cjt_gym.baselines.feedforward import dob_candidates, pd_law
from cjt_gym.baselines.linear_law import Block, LinearLaw, through, total
from cjt_gym.baselines.linear_row import linear_row
from cjt_gym.baselines.pid import DOB_HZ, KD, KP, LATE
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.rational import (
    Rational,
    delayed,
    held_low_pass,
    inverse_times,
    low_pass,
    tustin,
)


@lru_cache(maxsize=64)
def mass_observer(model: SampledJoint, cutoff_hz: float) -> Block:
    """Return the block of f; see the module, and the row for its gains."""
    p, dt, inertia = model.joint.parameters, model.dt, model.inertia
    damping = p.get("d_m", 0.0) + p.get("d_g", 0.0)
    low = low_pass(2, cutoff_hz)
    # A mass without friction has a pole at 0, which stands among the zeros of its inverse.
    mass = Rational(np.zeros(0, complex), np.array([-damping / inertia + 0j]), 1.0 / inertia)
    inverse = tustin(inverse_times(mass, low, "the motor's mass"), dt)
    seen, late = tustin(low, dt), delayed(held_low_pass(2, cutoff_hz, dt), model.loop.delay)
    return total(
        [
            through(late, command=1.0),
            through(seen, -1.0, tau=1.0),
            through(inverse, -1.0, dq_m=1.0),
        ]
    )


def mass_dob_law(
    model: SampledJoint, kp: float, kd: float, dob_hz: float, lead: float = 0.0
) -> LinearLaw:
    """Return the law; see the module, and `cjt_gym.baselines.pid` for its gains."""
    return pd_law(kp, kd, model.dt, mass_observer(model, dob_hz), lead=lead)


ROW = linear_row(
    name="mass_dob",
    summary="Feed-forward and PD, with a disturbance observer around the motor's mass.",
    source="Ohnishi, Shibata, Murakami (1996), IEEE/ASME Transactions on Mechatronics 1(1); Kong, "
    "Bae, Tomizuka (2009), IEEE/ASME Transactions on Mechatronics 14(1)",
    tunable=(KP, KD, DOB_HZ, LATE),
    law=mass_dob_law,
    candidates=dob_candidates,
    structures=SPRUNG,
)
