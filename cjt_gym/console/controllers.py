"""How a controller is named on every command line."""

from __future__ import annotations

from cjt_gym.baselines import CONTROLLERS
from cjt_gym.baselines.parts import PARTS

CONTROLLER_HELP = (
    f"{', '.join(CONTROLLERS)}; parts joined by +, as pid+reference+momentum_dob, of "
    f"{', '.join(PARTS)}; or PATH.py:NAME, code of your own, which is imported"
)
