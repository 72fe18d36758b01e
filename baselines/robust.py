"""Default gains: the best of a set of candidates whose loop is robust.

Every law with gains gets its defaults by one rule. Among the candidates that its file lists, the
one with the least

    the mean of |P S|^2, weighted by 1 / f    (friction, which enters at the motor)
    + the mean of |1 - T|^2 to 20 Hz          (the reference)

is taken for which the sampled loop with its delays

    is stable, also with `SPARE_DELAY` more, with `SPREAD` more and less inertia, and with a
        stiffness that is off by half of that in the other direction,
    has |S| <= `PEAK` at the motor's command, and
    amplifies the noise of the sensors into the command at most `NOISE` times, relative to the
        noise of the torque sensor.

P is the joint from motor torque to joint torque, S the sensitivity at the motor's command, T the
response from reference to joint torque. Frequencies are spread evenly over the octaves, so that
the first mean is the squared error after a step of torque at the motor: such a step is what
friction does wherever the motor turns back.

How much the constants matter, for pid_feedforward on orange_80_6000 with 1 ms of delay: a `PEAK` of
1.6, 2.0 and 2.5 gives kp = 0.4, 0.7 and 1.0; a `NOISE` of 4 halves kp and kd, takes ki from 90 to
20, one of 16 changes nothing; nor does a `SPARE_DELAY` of 0 to 2 ms or a `SPREAD` of 0.1 to 0.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov
from threadpoolctl import threadpool_limits

from cjt_gym.baselines.controller import Floats
from cjt_gym.baselines.linear_law import COMMAND, LinearLaw
from cjt_gym.baselines.plant_model import LoopModel, SampledJoint, loop_model
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint

PEAK = 2.0
"""Of the sensitivity: at least 6 dB gain margin and 29 degrees phase margin."""
SPARE_DELAY = 1e-3
"""One control step more than is known [s], which a bus or a slow computer costs at once."""
SPREAD = 0.2
"""Of inertia, relative; the stiffness is off by half of it. An allowance for datasheets."""
NOISE = 8.0
"""Largest amplification of noise into the command: the heat and sound that are accepted."""
REFERENCE_BAND = 20.0
"""Up to which a reference is to be followed [Hz], as in the tasks of the benchmark."""
POINTS = 120
"""Frequencies per loop, evenly over the octaves."""
MARGIN = 1.0 + 1e-6
"""Largest modulus of a pole; a load that turns freely has poles at 1."""


@dataclass(frozen=True)
class Bench:
    """What laws for a joint are tried on."""

    nominal: LoopModel  # the loop
    others: tuple[LoopModel, ...]  # loops on which a law must be stable too
    f: Floats  # frequencies [Hz], shape (points,)
    # response from command to measurement and torque, shape (points, 8)
    plant: NDArray[np.complex128]

    def is_stable(self, law: LinearLaw) -> bool:
        """Return whether a law is stable on all loops."""
        return all(is_stable(loop, law) for loop in (self.nominal, *self.others))

    def cost(self, law: LinearLaw) -> float:
        """Return the cost of a law, infinite where |S| or noise break their limits."""
        answer = law.response(self.f)
        measured, torque = self.plant[:, :-1], self.plant[:, -1]
        sensitivity = 1.0 / (1.0 - np.sum(answer[:, 1:] * measured, axis=1))
        if np.max(np.abs(sensitivity)) > PEAK:
            return math.inf
        low = self.f <= REFERENCE_BAND
        tracking = 1.0 - (answer[:, 0] * torque * sensitivity)[low]
        disturbed = np.average(np.abs(torque * sensitivity) ** 2, weights=1.0 / self.f)
        return float(disturbed + np.mean(np.abs(tracking) ** 2))


def is_stable(loop: LoopModel, law: LinearLaw) -> bool:
    """Return whether no pole of the closed loop is outside the unit circle."""
    poles = np.linalg.eigvals(loop.closed(law)[0])
    return bool(np.max(np.abs(poles)) <= MARGIN)


def is_robust(model: SampledJoint, law: LinearLaw) -> bool:
    """Return whether a law is stable on a joint, also a changed one, and |S| keeps its limit."""
    bench = make_bench(model)
    return bench.is_stable(law) and math.isfinite(bench.cost(law))


def noise_gain(loop: LoopModel, law: LinearLaw) -> float:
    """Return the standard deviation of the command over that of the torque sensor's noise."""
    a, noise, command = loop.closed(law)
    scaled = noise * (loop.scatter / loop.scatter[0])
    # The poles at 1 of a free load take no part: they are moved inwards a little.
    spread = solve_discrete_lyapunov(a / MARGIN**2, scaled @ scaled.T, method="bilinear")
    direct = (law.d[1:COMMAND] @ loop.noise_out) * (loop.scatter / loop.scatter[0])
    return math.sqrt(max(float(command @ spread @ command + direct @ direct), 0.0))


def make_bench(model: SampledJoint) -> Bench:
    """Return what laws for a joint are tried on."""
    joint, dt, nominal = model.joint, model.dt, model.loop
    others = [nominal.later(math.ceil(SPARE_DELAY / dt - 1e-9))]
    others += [loop_model(_changed(joint, sign * SPREAD), dt) for sign in (1.0, -1.0)]
    f = np.geomspace(0.5, 0.499 / dt, POINTS)
    return Bench(nominal, tuple(others), f, nominal.response(f))


def _changed(joint: Joint, share: float) -> Joint:
    p = joint.parameters
    values = {name: p.get(name, 0.0) * (1.0 + share) for name in ("I_m", "I_g") if name in p}
    values |= {name: p.get(name, 0.0) * (1.0 - share / 2.0) for name in ("k_b", "k_g") if name in p}
    file = replace(joint.file, parameters=p.replace(**values))
    return replace(joint, file=file)


def best_gains(
    model: SampledJoint,
    law: Callable[[Mapping[str, float]], LinearLaw],
    candidates: Iterable[Mapping[str, float]],
) -> dict[str, float]:
    """Return the candidate with the least cost whose loop is robust; see the module."""
    scored: list[tuple[float, int, Mapping[str, float], LinearLaw]] = []
    refused: ConfigurationError | None = None
    with threadpool_limits(1):  # small matrices gain nothing from threads
        bench = make_bench(model)
        for gains in candidates:
            try:
                made = law(gains)
            except ConfigurationError as error:  # as where poles cannot be placed
                refused = error
                continue
            cost = bench.cost(made)
            if math.isfinite(cost):
                scored.append((cost, len(scored), gains, made))
        for _, _, gains, made in sorted(scored, key=lambda entry: entry[:2]):
            if bench.is_stable(made) and noise_gain(bench.nominal, made) <= NOISE:
                return dict(gains)
    if refused is not None and not scored:
        raise refused
    raise ConfigurationError(
        f"No default gains keep the loop of {model.name} robust at dt = {model.dt:g} s with "
        f"{bench.nominal.delay} samples of delay. Give gains, sample faster, or take a controller "
        "that asks for less."
    )
