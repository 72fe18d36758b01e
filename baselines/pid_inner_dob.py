"""PID with feed-forward and an inner (open-loop) disturbance observer.

    u = r + kp e + kd F e_d - d,   d = P^-1 Q tau - Q z^-delay u,   e = r - tau,
    e_d = -tau or, with lead, e

P is the linear joint from motor torque to joint torque, so that d is what friction and ripple do
at the motor, and what P lacks; see `cjt_gym.baselines.observers.disturbance`. The observer
integrates, so that the PID needs no integral.
"""

from __future__ import annotations

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.feedforward import dob_candidates
from cjt_gym.baselines.pid import DOB_HZ, KD, KP, LATE

ROW = composed_row(
    "pid_inner_dob",
    "pd+reference+inner_dob",
    summary="Feed-forward and PD, with an open-loop disturbance observer of the joint.",
    source="Lee, Tomizuka (1996), IEEE Transactions on Industrial Electronics 43(1); Hopkins et "
    "al. (2015), IEEE/ASME Transactions on Mechatronics 20(6); Roozing et al. (2016), IROS",
    tunable=(KP, KD, DOB_HZ, LATE),
    candidates=dob_candidates,
)
