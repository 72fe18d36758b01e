"""Controllers: classical laws behind one contract, one file each, and their table."""

if __name__ != "cjt_gym.baselines":
    raise ImportError(
        "This folder is installed as cjt_gym.baselines: import that instead of 'baselines'."
    )

from cjt_gym.baselines.controller import Controller
from cjt_gym.baselines.entry import ControllerEntry, Gain
from cjt_gym.baselines.open_loop import OpenLoop
from cjt_gym.baselines.pd_feedforward import PdFeedForward
from cjt_gym.baselines.table import CONTROLLERS, default_gains, get_entry, make_controller

__all__ = [
    "CONTROLLERS",
    "Controller",
    "ControllerEntry",
    "Gain",
    "OpenLoop",
    "PdFeedForward",
    "default_gains",
    "get_entry",
    "make_controller",
]
