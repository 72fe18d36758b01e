"""Iterative learning control: PD, and a feed-forward that is learnt over repeated trials.

    u = v_pd + f_j,   f_{j+1} = Q (f_j + L e_j)

The reference repeats every `trial_s`. At the end of trial j its error e_j, over the whole trial,
goes through L and Q into the feed-forward f_{j+1} of the next one. With G the closed loop from a
torque at the command to the measured torque, and * the conjugate,

    L = rate G* / (|G|^2 + b^2),   b = SOFTNESS max |G|

is the inverse of the loop where the loop answers and nothing where it does not; it looks ahead, as
only learning from trial to trial may. Q is a low pass without phase, 1 / (1 + (f / cutoff)^8).
The error shrinks from trial to trial at every frequency f where

    |Q (1 - L G)| < 1

A controller is refused where this fails for the joint, or for one with more delay or with other
parameters (`contraction`). What Q takes away is not learnt. Trials follow one another, so that
filters run in a circle through the trial (FFT). As soon as the reference departs from that of the
trial before, f is left out until the end of the trial, and forgotten.

References:
    Arimoto, Kawamura, Miyazaki (1984), Bettering operation of robots by learning, Journal of
    Robotic Systems 1(2); Bristow, Tharayil, Alleyne (2006), A survey of iterative learning control,
    IEEE Control Systems Magazine 26(3); Norrloef, Gunnarsson (2002), Time and frequency domain
    convergence properties in iterative learning control, International Journal of Control 75(14).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.baselines.entry import FIXED, Gain, Gains
from cjt_gym.baselines.feedforward import pd_candidates
from cjt_gym.baselines.linear_law import LinearLaw
from cjt_gym.baselines.pid import KD, KP, LATE
from cjt_gym.baselines.plant_model import LoopModel, SampledJoint
from cjt_gym.baselines.robust import make_bench
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint.kernel.arrays import Complex
from cjt_gym.plant import Measurement

RATE = 0.5
"""Half of an error is taken away per trial, so that noise of one trial averages out."""
TRIAL_S = 1.0
"""Duration of a trial, that of the references of the benchmark."""
CUTOFFS = (60.0, 45.0, 30.0, 20.0, 14.0, 10.0, 7.0, 5.0, 3.0)
"""Candidates for the cut-off [Hz]; the highest with which learning converges is taken."""
SOFTNESS = 0.1
"""Where the loop answers with less than this share of its largest answer, little is learnt."""
ORDER = 8
"""Of Q: steep enough to learn up to its cut-off, smooth enough not to ring in a trial."""
LARGEST_SHARE = 0.5
"""Of the torque limit that may be learnt; the other half is left to feedback."""
SAME = 1e-9
"""Relative difference up to which a reference repeats: rounding only."""
POINTS = 400
"""Frequencies at which convergence is checked."""


@final
@dataclass(eq=False)
class IterativeLearning:
    """What was learnt in the trials before; see the module."""

    model: SampledJoint
    linear: LinearLaw  # the law of the closed loop that is learnt on
    rate: float  # of the learning, > 0 and < 2 [-]
    cutoff_hz: float  # up to where it learns, > 0 [Hz]
    trial_s: float  # duration of a trial, rounded to samples, at least two of them [s]
    torque_limit: float  # largest motor torque that is commanded; half of it may be learnt [N m]

    def __post_init__(self) -> None:
        worst = contraction(self.model, self.linear, self.rate, self.cutoff_hz)
        if worst >= 1.0:
            raise ConfigurationError(
                f"Learning on {self.model.name} would not converge: the error grows up to "
                f"{worst:.3g} times from trial to trial, with the delay and the parameters that "
                "the joint may have. Lower cutoff_hz or rate."
            )
        self.samples = round(self.trial_s / self.model.dt)
        if self.samples < 2:
            raise ConfigurationError(
                f"trial_s of iterative_learning must be at least {2.0 * self.model.dt:g} s, two "
                f"samples, got {self.trial_s:g}."
            )
        f = np.asarray(np.fft.rfftfreq(self.samples, self.model.dt), dtype=np.float64)
        g = answer(self.model.loop, self.linear, f)
        self._learn, self._keep = learning(g, self.rate), smoothing(f, self.cutoff_hz)
        self._begin(0)

    def _begin(self, count: int) -> None:
        shape = self.samples, count
        self._forward, self._error = np.zeros(shape), np.zeros(shape)
        self._wanted = np.full(shape, np.nan)
        self._at, self._repeats = np.zeros(count, dtype=np.int64), np.ones(count, dtype=np.bool_)

    def step(
        self, measurement: Measurement, reference: Floats, applied: Floats, fresh: Mask
    ) -> Floats:
        """Return the feed-forward [N m], shape (n,); see `Addition`."""
        if len(self._at) != len(fresh):
            self._begin(len(fresh))
        self._at[fresh], self._repeats[fresh] = 0, True
        self._forward[:, fresh], self._wanted[:, fresh] = 0.0, np.nan
        here = self._at, np.arange(len(fresh))
        near = np.abs(reference - self._wanted[here]) <= SAME * (1.0 + np.abs(reference))
        self._repeats &= near | np.isnan(self._wanted[here])
        self._wanted[here], self._error[here] = reference, reference - measurement.tau
        added = np.where(self._repeats, self._forward[here], 0.0)
        self._at = (self._at + 1) % self.samples
        ended = self._at == 0
        if ended.any():
            self._conclude(ended)
        return np.asarray(added)

    def _conclude(self, ended: Mask) -> None:
        """Learn from trials that have ended."""
        learnt = np.where(self._repeats[ended], self._forward[:, ended], 0.0)
        step = self._learn[:, None] * np.fft.rfft(self._error[:, ended], axis=0)
        total = self._keep[:, None] * (np.fft.rfft(learnt, axis=0) + step)
        largest = LARGEST_SHARE * self.torque_limit
        found = np.fft.irfft(total, self.samples, axis=0)
        self._forward[:, ended] = np.clip(found, -largest, largest)
        self._repeats[ended] = True


def answer(loop: LoopModel, law: LinearLaw, f: Floats) -> Complex:
    """Return the response from a torque at the command to the measured torque, with the law."""
    plant = loop.response(f)[:, :-1]
    back = law.response(f)[:, 1:]
    return np.asarray(plant[:, 0] / (1.0 - np.sum(back * plant, axis=1)))


def learning(g: Complex, rate: float) -> Complex:
    """Return L for the response of a loop; see the module."""
    size = np.abs(g) ** 2
    return np.asarray(rate * np.conj(g) / (size + SOFTNESS**2 * np.max(size)))


def smoothing(f: Floats, cutoff_hz: float) -> Floats:
    """Return Q; see the module."""
    return np.asarray(1.0 / (1.0 + (f / cutoff_hz) ** ORDER))


def contraction(model: SampledJoint, law: LinearLaw, rate: float, cutoff_hz: float) -> float:
    """Return by how much the error grows from trial to trial at worst: max |Q (1 - L G)|.

    The maximum is over frequency, for the joint, for one with more delay, and for those with other
    parameters; see `cjt_gym.baselines.robust`. L is that of the joint.
    """
    bench = make_bench(model)
    f = np.geomspace(0.05, 0.499 / model.dt, POINTS)
    keep, step = smoothing(f, cutoff_hz), learning(answer(bench.nominal, law, f), rate)
    loops = (bench.nominal, *bench.others)
    return max(float(np.max(keep * np.abs(1.0 - step * answer(x, law, f)))) for x in loops)


def _learning(model: SampledJoint, law: LinearLaw) -> Gains:
    """Return the gains of learning, with as high a cut-off as converges."""
    good = [c for c in CUTOFFS if contraction(model, law, RATE, c) < 1.0]
    return {"rate": RATE, "cutoff_hz": good[0] if good else CUTOFFS[-1], "trial_s": TRIAL_S}


def _learnt(model: SampledJoint, gains: Gains, law: LinearLaw, limit: float) -> IterativeLearning:
    rate, cutoff, trial = (gains[name] for name in ("rate", "cutoff_hz", "trial_s"))
    return IterativeLearning(model, law, rate, cutoff, trial, limit)


ROW = composed_row(
    "iterative_learning",
    "pd+reference",
    summary="Feed-forward, PD, and a feed-forward learnt over trials of a repeated reference.",
    source="Arimoto, Kawamura, Miyazaki (1984), Journal of Robotic Systems 1(2); Bristow, "
    "Tharayil, Alleyne (2006), IEEE Control Systems Magazine 26(3)",
    tunable=(
        *(KP, KD, LATE),
        Gain("rate", "-", 0.01, 1.9),
        Gain("cutoff_hz", "Hz", 0.5, 200.0, log=True),
        Gain("trial_s", "s", 0.01, 60.0, log=True, asked=True),
    ),
    candidates=pd_candidates,
    addition=_learnt,
    learning=_learning,
    structures=FIXED,
)
