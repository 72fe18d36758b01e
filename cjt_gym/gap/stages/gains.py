"""Gains of the predictors of motor and load, and the noise that they are for."""

from __future__ import annotations

import numpy as np
from scipy.signal import fftconvolve

from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import PROCESS_TORQUE, Setting
from cjt_gym.gap.stages.chain import GEAR, LOAD, MOTOR, Chain, kalman_gain
from cjt_gym.gap.stages.predictor import Gain, innovation_std, start_shapes, torque_response


def gain_of(s: Setting, springs: Fields, name: str, fields: Fields, chain: Chain) -> Gain:
    """Return the gain of a predictor, and the scatter of its innovations.

    Args:
        s: The record and its joint.
        springs: Fields whose stiffnesses noise of the angles is multiplied by.
        name: Stage of the predictor, "motor" or "load".
        fields: Values of the joint.
        chain: The stage's piece of the joint.
    """
    current = s.std("i") if "i" in s.series else 0.0
    own = abs(fields["n"] * fields["k_t"]) * current
    tau = s.std("tau") / abs(fields["gain"]) if s.cut is Cut.BY_TORQUE else 0.0
    extra = max(PROCESS_TORQUE * float(np.hypot(own, tau)), s.process)
    torque = (np.hypot(own, extra), tau, tau) if name == "motor" else (0.0, 0.0, tau)
    if s.cut is Cut.BY_ANGLES:
        felt = _felt_noise(s, springs, name)
        torque = (np.hypot(own, extra), felt, felt) if name == "motor" else (0.0, felt, felt)
    channel = "q_m" if name == "motor" else "q_l"
    jitter = s.noise[channel].jitter * float(np.sqrt(np.mean(s.series.speed(channel) ** 2)))
    noise = float(np.hypot(s.std(channel), jitter))
    k = kalman_gain(chain, (0,), torque, (noise,)).ravel()
    std = innovation_std(chain, k, torque, s.std(channel))
    shaken = s.noise[channel].jitter * s.series.speed(channel)
    # Wrong samples feed back through the gain: their effect on later ones counts as well.
    returned = innovation_std(chain, k, (0.0, 0.0, 0.0), 1.0) ** 2
    variance = std**2 + returned * shaken**2
    if name == "motor" and "i" in s.series:
        response = torque_response(chain, k, MOTOR)
        early = fields["n"] * fields["k_t"] * s.unseen("i")
        variance += fftconvolve(early**2, response**2)[: len(early)]
    if s.cut is Cut.BY_TORQUE:
        late = s.noise["tau"].jitter * s.series.speed("tau")
        response = torque_response(chain, k, GEAR if name == "motor" else LOAD)
        variance += fftconvolve(late**2, response**2)[: len(late)]
    if name == "motor":
        variance *= s.allowance**2
    scatter = np.sqrt(np.maximum(variance, 1e-300))
    return Gain(k, std, scatter, start_shapes(chain, k, scatter, s.series.valid[channel]))


def _felt_noise(s: Setting, f: Fields, name: str) -> float:
    """Return the torque that noise of the angle at a spring's far end makes [N m]."""
    far = "q_l" if name == "motor" else "q_m"
    gear = name == "load" and s.has_gear
    stiffness, damping = (f["k_g"], f["d_mg"]) if gear else (f["k_b"], f["d_gl"])
    return s.std(far) * float(np.hypot(stiffness, damping / (np.sqrt(2.0) * s.series.dt)))
