"""How long a sinusoidal joint torque can be held with locked output, by amplitude and frequency.

A joint torque of amplitude T at a frequency f needs T / |G| of the motor, with the gain G of
`response`. That heats the winding like a constant torque of T / (sqrt(2) |G|), as long as the
period is short against the winding's time constant T_thw.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cjt_gym.characteristics.bandwidth import response, torque_limits
from cjt_gym.characteristics.motor import Floats, rated_torque
from cjt_gym.characteristics.thermal import time_to_critical
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import JointParameters

LEVELS = 128  # of heating, between which times are smooth
NEAREST = 1e-6
"""Least excess over the rated torque, relative, at which the time is looked at."""
TINY = 1e-9  # time that stands for none, which has no logarithm [s]


def holding_time(
    p: JointParameters, tau: ArrayLike, f: ArrayLike, winding: float | None = None
) -> Floats:
    """Return how long joint torques can be held until the winding is at Tmp_WMax [s].

    Args:
        p: Parameters.
        tau: Amplitude of the joint torque >= 0, broadcast with f [N m].
        f: Frequency > 0 [Hz].
        winding: Temperature at the start [degC]; ambient if absent.

    Returns:
        The time; infinity where it can be held for ever, NaN where current, voltage or velocity do
        not allow the torque at all.

    Raises:
        ConfigurationError: A torque or a frequency is out of range.
    """
    torque, frequency = np.broadcast_arrays(np.asarray(tau, float), np.asarray(f, float))
    if not (torque >= 0.0).all():
        raise ConfigurationError(f"tau, an amplitude, must be >= 0 N m, got {torque.min():g}.")
    single = np.unique(frequency)
    at = np.searchsorted(single, frequency)
    gain, limits = np.abs(response(p, single)[0]), torque_limits(p, single)
    heating = torque / gain[at] / math.sqrt(2.0)
    allowed = torque <= limits.peak[at] * (1.0 + 1e-12)
    out = np.full(torque.shape, np.nan)
    out[allowed] = [time_to_critical(p, float(x), winding) for x in heating[allowed]]
    return out


def holding_map(p: JointParameters, tau: Floats, f: Floats, winding: float | None = None) -> Floats:
    """Return `holding_time` over a whole grid [s], shape (frequencies, torques).

    It is computed at `LEVELS` levels of heating and interpolated between them, on logarithmic
    scales of the time and of the excess over the rated torque.

    Args:
        p: Parameters.
        tau: Amplitudes > 0, shape (torques,) [N m].
        f: Frequencies > 0, shape (frequencies,) [Hz].
        winding: As for `holding_time`.
    """
    gain, limits = np.abs(response(p, f)[0]), torque_limits(p, f)
    heating = tau[None, :] / gain[:, None] / math.sqrt(2.0)
    allowed = tau[None, :] <= limits.peak[:, None] * (1.0 + 1e-12)
    lasting = limits.continuous[:, None] >= tau[None, :]
    out = np.where(lasting & allowed, np.inf, np.nan)
    short = allowed & ~lasting
    beyond = np.maximum(heating[short] / rated_torque(p) - 1.0, NEAREST)
    if beyond.size:
        levels = np.geomspace(NEAREST, float(beyond.max()) + NEAREST, LEVELS)
        torques = rated_torque(p) * (1.0 + levels)
        times = np.array([time_to_critical(p, float(x), winding) for x in torques])
        known = np.log(np.maximum(times, TINY))
        out[short] = np.exp(np.interp(np.log(beyond), np.log(levels), known))
    return out
