"""Feed-forward and PD with a disturbance observer around the motor's rotating mass.

    u = r + kp e + kd F e_d + f,   e_d = -tau or, with lead, e
       f = Q (z^-delay u - tau) - Q (J s + d) dq_m

The motor (with gear) is taken as a mass J with viscous damping d that the command and the
measured joint torque move, P = 1 / (J s + d); f is the torque that opposes it beside these two:
friction and ripple. No spring and no load is in P, so that the observer is the same whatever the
joint moves, and holds for a free load too. Q is a Butterworth low pass of second order.
"""

from __future__ import annotations

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.feedforward import dob_candidates
from cjt_gym.baselines.pid import DOB_HZ, KD, KP, LATE

ROW = composed_row(
    "mass_dob",
    "pd+reference+mass_dob",
    summary="Feed-forward and PD, with a disturbance observer around the motor's mass.",
    source="Ohnishi, Shibata, Murakami (1996), IEEE/ASME Transactions on Mechatronics 1(1); Kong, "
    "Bae, Tomizuka (2009), IEEE/ASME Transactions on Mechatronics 14(1)",
    tunable=(KP, KD, DOB_HZ, LATE),
    candidates=dob_candidates,
)
