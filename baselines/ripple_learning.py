"""Feed-forward, PD, and a map of the ripple over the motor angle that is learnt in motion.

    u = v_pd + sum_j (a_j cos(f_j q_m) + b_j sin(f_j q_m))

with as many periods f_j per revolution as cogging and gear ripple have. The weights follow, by
normalised least mean squares, the torque against the motor that a momentum observer sees; the
regressors pass the same low pass as that torque (filtered-x), so that the observer's lag does not
turn the phase. Friction is among the regressors and is not compensated: what is learnt is only
what repeats with the angle. The map is kept while the joint stands still, and forgotten at a reset.

References:
    Widrow, Stearns (1985), Adaptive Signal Processing, Prentice-Hall, chapter 11;
    Bodson, Douglas (1997), Adaptive
    algorithms for the rejection of sinusoidal disturbances, Automatica 33(12).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.baselines.entry import Gain
from cjt_gym.baselines.feedforward import SMOOTHING, pd_candidates
from cjt_gym.baselines.observers.momentum import momentum_observer
from cjt_gym.baselines.pid import KD, KP, LATE
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement

RATE = 2.0
"""Of the learning, relative to the power of the regressors [1/s]."""
OBSERVER_HZ = 40.0
"""Bandwidth of the momentum observer [Hz]: more lets noise in; the
filter of the regressors makes up for less."""
FLOOR = 0.5
"""Of tanh(dq / SMOOTHING) above which the joint moves, and its map is learnt."""
LARGEST_SHARE = 0.1
"""Of the torque limit, beyond which a ripple is not believed."""


@final
@dataclass(eq=False)
class RippleLearning:
    """A ripple that is learnt over the motor angle; see the module."""

    model: SampledJoint
    rate: float  # of the learning, > 0 [1/s]
    observer_hz: float  # bandwidth of the momentum observer [Hz]
    # largest motor torque that is commanded; a ripple above a tenth of it is not believed [N m]
    torque_limit: float

    def __post_init__(self) -> None:
        self.periods = ripple_periods(self.model.joint)
        self._observer = momentum_observer(self.model, self.observer_hz)
        self._keep = math.exp(-2.0 * math.pi * self.observer_hz * self.model.dt)
        self._weights = self._filtered = np.zeros((0, 0))

    def step(
        self, measurement: Measurement, reference: Floats, applied: Floats, fresh: Mask
    ) -> Floats:
        """Return the ripple [N m], shape (n,); see `Addition`."""
        angle = self.periods[:, None] * measurement.q_m
        waves = np.concatenate([np.cos(angle), np.sin(angle)])
        friction = np.tanh(measurement.dq_m / SMOOTHING)[None]
        self._learn(np.concatenate([waves, friction]), measurement, applied, fresh)
        ripple = np.sum(self._weights[:-1] * waves, axis=0)
        largest = LARGEST_SHARE * self.torque_limit
        return np.asarray(np.clip(ripple, -largest, largest))

    def _learn(
        self, regressors: Floats, measurement: Measurement, applied: Floats, fresh: Mask
    ) -> None:
        """Move the weights towards what explains the observed disturbance."""
        if self._weights.shape[1] != len(fresh):
            self._weights, self._filtered = np.zeros_like(regressors), np.zeros_like(regressors)
        seen = self._observer.step(measurement, applied, fresh)["disturbance"]
        self._weights = np.where(fresh, 0.0, self._weights)
        low = self._keep * self._filtered + (1.0 - self._keep) * regressors
        self._filtered = np.where(fresh, regressors, low)
        error = seen - np.sum(self._weights * self._filtered, axis=0)
        moving = np.abs(np.tanh(measurement.dq_m / SMOOTHING)) > FLOOR
        size = 1.0 + np.sum(self._filtered**2, axis=0)
        step = self.rate * self.model.dt * np.where(moving & ~fresh, error / size, 0.0)
        self._weights = self._weights + step * self._filtered


def ripple_periods(joint: Joint) -> Floats:
    """Return the periods per revolution of q_m at which a joint's torque may ripple.

    Those of its effects; else two per rotor turn and, where the pole pairs p are known, 2 p.
    """
    found: set[float] = set()
    for name in ("cogging", "gear_ripple"):
        found |= {float(f) for f in np.atleast_1d(joint.effects.get(name, {}).get("f", ()))}
    n, p = joint.parameters.get("n", 1.0), joint.parameters.get("p", 0.0)
    found = found or ({2.0 * n, 2.0 * p * n} if p > 0.0 else {2.0 * n})
    return np.array(sorted(found))


ROW = composed_row(
    "ripple_learning",
    "pd+reference",
    summary="Feed-forward, PD, and ripple over the motor angle, learnt by filtered-x LMS.",
    source="Widrow, Stearns (1985), Adaptive Signal Processing, chapter 11; Bodson, Douglas "
    "(1997), Automatica 33(12)",
    tunable=(
        *(KP, KD, LATE),
        Gain("rate", "1/s", 0.01, 100.0, log=True),
        Gain("observer_hz", "Hz", 1.0, 200.0, log=True),
    ),
    candidates=lambda model: pd_candidates(model, rate=RATE, observer_hz=OBSERVER_HZ),
    addition=lambda model, gains, law, limit: RippleLearning(
        model, gains["rate"], gains["observer_hz"], limit
    ),
)
