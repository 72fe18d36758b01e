"""The transfer-function disturbance observer of a joint.

    d = P^-1 Q y - Q z^-delay u

estimates the torque that acts on the motor as u does, seen through the low pass Q (Butterworth,
unit gain at rest). P is the linear joint from motor torque to the output y. Both filters have the
same gain at rest: P^-1 Q is discretised by the bilinear rule, and Q as the plant sees a command,
held over a sample, so that Q has no feed-through and there is no algebraic loop.

References:
    Ohnishi, Shibata, Murakami (1996), Motion control for advanced mechatronics, IEEE/ASME
    Transactions on Mechatronics 1(1); Paine, Oh, Sentis (2014), Design and control considerations
    for high-performance series elastic actuators, IEEE/ASME Transactions on Mechatronics 19(3).
"""

from __future__ import annotations

import numpy as np

from cjt_gym.baselines.linear_law import Block, through, total
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.rational import (
    Rational,
    delayed,
    held_low_pass,
    inverse_times,
    low_pass,
    tustin,
)


def observer_block(
    plant: Rational, cutoff_hz: float, delay: int, dt: float, what: str, **signal: float
) -> Block:
    """Return the estimate as a block.

    Args:
        plant: P, from motor torque to the signal.
        cutoff_hz: Cut-off of Q [Hz].
        delay: Of the loop [samples].
        dt: Sample time [s].
        what: What P is, for errors.
        signal: The measured signal, as weights of `SIGNALS`.

    Raises:
        ConfigurationError: P cannot be inverted.
    """
    order = max(plant.relative_order, 1)
    inverse = tustin(inverse_times(plant, low_pass(order, cutoff_hz), what), dt)
    late = delayed(held_low_pass(order, cutoff_hz, dt), delay)
    return total([through(inverse, **signal), through(late, -1.0, command=1.0)])


def disturbance_observer(model: SampledJoint, cutoff_hz: float) -> LinearObserver:
    """Return the observer of "disturbance" [N m], in the sense of a motor torque.

    Args:
        model: The joint; its delays are taken into account.
        cutoff_hz: Cut-off of Q [Hz].

    Raises:
        ConfigurationError: The joint torque cannot be inverted, as with a free load.
    """
    what = f"the joint torque of {model.name}"
    delay = model.loop.delay
    block = observer_block(model.torque, cutoff_hz, delay, model.dt, what, tau=1.0)
    c, d = np.atleast_2d(block.c), np.atleast_2d(block.d)
    return LinearObserver(block.a, block.b, c, d, ("disturbance",), model.dt)
