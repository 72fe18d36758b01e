"""Joints whose effects are hidden, from a simulator that shares nothing with the package's own.

Testing a diagnosis on data from the simulator that it fits with proves little. Here the bodies, the
force laws, the integrator and the drive are implemented independently; only the format of the
records is shared.

Example:
    >>> case = draw_case(7, effects=["coulomb"], structure="rigid_gearbox", duration=2.0)
    >>> case.label["effects"], sorted(case.diagnose.columns)
    (['coulomb'], ['i', 'i_cmd', 'q_l', 'q_m', 't', 'tau'])
"""

from cjt_gym.blind.bench import Bench, make_bench
from cjt_gym.blind.case import Case, Log, draw_case
from cjt_gym.blind.defects import DEFECTS
from cjt_gym.blind.files import write_case
from cjt_gym.blind.known import KNOWN
from cjt_gym.blind.outside import OUTSIDE
from cjt_gym.blind.plan import SMALL

__all__ = [
    "DEFECTS",
    "KNOWN",
    "OUTSIDE",
    "SMALL",
    "Bench",
    "Case",
    "Log",
    "draw_case",
    "make_bench",
    "write_case",
]
