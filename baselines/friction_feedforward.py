"""Feed-forward of reference and friction, with PD.

    u = r + kp e + kd F e_d + share (d_c tanh(w / w_0) + d_v w),   w = dr/dt / k + dq_l,
    e_d = -tau or, with lead, e

w is the velocity at which the motor has to move for the spring k (and the gearbox in series with
it) to follow the reference, so that neither noise nor delay of a measured velocity enters, and the
friction cannot be compensated into a limit cycle. d_c and d_v are the Coulomb and viscous friction
of motor and gear that the joint file names. At rest the direction is not known and nothing is
added.
"""

from __future__ import annotations

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.entry import Gain
from cjt_gym.baselines.feedforward import SHARE, SMOOTHING, pd_candidates
from cjt_gym.baselines.pid import KD, KP, LATE

ROW = composed_row(
    "friction_feedforward",
    "pd+reference+friction",
    summary="Feed-forward of reference and known friction, and PD.",
    source="Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7)",
    tunable=(
        *(KP, KD, LATE),
        Gain("share", "-", 0.0, 1.5),
        Gain("smoothing", "rad/s", 1e-4, 1.0, log=True),
    ),
    candidates=lambda model: pd_candidates(model, share=SHARE, smoothing=SMOOTHING),
)
