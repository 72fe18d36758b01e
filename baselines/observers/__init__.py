"""Observers: what a joint does not measure, from what it does; one file each.

Every linear observer is a `LinearObserver`, which runs alone over a batch of joints or inside a
linear law.
"""

from cjt_gym.baselines.observers.disturbance import disturbance_observer
from cjt_gym.baselines.observers.extended_state import extended_state_observer
from cjt_gym.baselines.observers.kalman import TimeVaryingKalman, kalman_filter
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.observers.luenberger import luenberger_observer
from cjt_gym.baselines.observers.momentum import momentum_observer
from cjt_gym.baselines.observers.table import OBSERVERS, make_observer

__all__ = [
    "OBSERVERS",
    "LinearObserver",
    "TimeVaryingKalman",
    "disturbance_observer",
    "extended_state_observer",
    "kalman_filter",
    "luenberger_observer",
    "make_observer",
    "momentum_observer",
]
