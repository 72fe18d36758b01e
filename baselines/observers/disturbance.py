"""The transfer-function disturbance observer of a joint.

    d = P^-1 Q y - Q z^-delay u

estimates the torque that acts on the motor as u does, seen through the low pass Q (Butterworth,
unit gain at rest). P is the linear joint from motor torque to the output y, any of the seven.
Both filters have the same gain at rest: P^-1 Q is discretised by the bilinear rule, and Q as the
plant sees a command, held over a sample, so that Q has no feed-through and there is no algebraic
loop.

References:
    Ohnishi, Shibata, Murakami (1996), Motion control for advanced mechatronics, IEEE/ASME
    Transactions on Mechatronics 1(1); Paine, Oh, Sentis (2014), Design and control considerations
    for high-performance series elastic actuators, IEEE/ASME Transactions on Mechatronics 19(3).
"""

from __future__ import annotations

import numpy as np

from cjt_gym.baselines.linear_law import MEASURED, SIGNALS, through, total
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.observers.model import mechanics_for, output_row
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.rational import (
    Rational,
    delayed,
    held_low_pass,
    inverse_times,
    is_not_left,
    low_pass,
    transfer_function,
    tustin,
    zeros_text,
)
from cjt_gym.errors import ConfigurationError, check_name


def disturbance_observer(
    model: SampledJoint, cutoff_hz: float, output: str = "tau"
) -> LinearObserver:
    """Return the observer of "disturbance" [N m], in the sense of a motor torque.

    Args:
        model: The joint; its delays are taken into account.
        cutoff_hz: Cut-off of Q [Hz].
        output: Measured signal y, any of `MEASURED`; with a fixed output, angles and velocities
            count from those of the load.

    Raises:
        UnknownNameError: There is no such signal.
        ConfigurationError: The signal does not show a lasting disturbance, or does not have a
            stable inverse; the message names those that do.
    """
    check_name("output of an observer", output, MEASURED)
    what = f"{output} of {model.name}"
    plant = invertible(model, output)
    if isinstance(plant, str):
        good = [one for one in MEASURED if not isinstance(invertible(model, one), str)]
        raise ConfigurationError(
            f"{what} cannot be inverted: {plant}. Choose another output: {', '.join(good)}."
        )
    row = output_row(output, model.mechanics.fixed)
    signal = {name: float(w) for name, w in zip(SIGNALS, row, strict=True) if w != 0.0}
    dt, order = model.dt, max(plant.relative_order, 1)
    inverse = tustin(inverse_times(plant, low_pass(order, cutoff_hz), what), dt)
    late = delayed(held_low_pass(order, cutoff_hz, dt), model.loop.delay)
    block = total([through(inverse, **signal), through(late, -1.0, command=1.0)])
    c, d = np.atleast_2d(block.c), np.atleast_2d(block.d)
    return LinearObserver(block.a, block.b, c, d, ("disturbance",), dt)


def invertible(model: SampledJoint, output: str) -> Rational | str:
    """Return the transfer function to an output, or why a disturbance cannot be told from it."""
    plant = mechanics_for(model, (output,))
    (a, b), c = plant.continuous, plant.row(output)
    if not np.any(c):
        return "the motor torque does not show there"
    found = transfer_function(a, b, c)
    bad = [zero for zero in found.zeros if is_not_left(zero, found)]
    return f"it has {zeros_text(bad)} that are not in the left half plane" if bad else found
