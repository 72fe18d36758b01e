"""The table of figures: what is drawn for each effect, its equation and its caption."""

from __future__ import annotations

from tools.effects_page.figures import (
    backlash,
    drive,
    friction,
    heat,
    load,
    motor,
    ripple,
    sensors,
    signals,
    springs,
)

_MODULES = (drive, motor, heat, friction, ripple, backlash, springs, sensors, signals, load)
PLOTS = {plot.draw.__name__: plot for module in _MODULES for plot in module.PLOTS}
