"""What a tuned loop must keep: margins, sensitivity, noise, and passivity of the port.

The impedance of the output is Z = S Z_0, with S the sensitivity and Z_0 = I s k / (I s^2 + k) that
of the inertia I = I_m + I_g behind the spring k. A law that takes disturbances at the motor away up
to w has S near s / (s + w), and Re Z falls to about -I w: unless the joint has as much viscous
friction, no controller that integrates or observes a disturbance is passive. What touches the
output has to add the damping I w, which is (w / w_0) sqrt(k I) with w_0 = sqrt(k / I). So the limit
on the port is a share of sqrt(k I), and says up to which share of the joint's own frequency
disturbances may be taken away. What integrals do to passivity: Vallery, Ekkelenkamp, van der Kooij,
Buss (2007), IEEE/RSJ IROS.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from cjt_gym.analysis import LinearPlant, Loop, Responses, identify, margins, probe_law
from cjt_gym.analysis.figures import figures_of
from cjt_gym.baselines import Controller
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.robust import is_robust, noise_gain
from cjt_gym.errors import SimulationError, check_range
from cjt_gym.joint import Joint
from cjt_gym.plant import Law, SimulatedPlant, limits_of

QUIET_S = 0.4
"""At rest, before noise is measured [s], for observers and integrals to settle."""
NOISE_SHARE = 1e-3
"""Noise of the torque sensor over the torque limit, small enough that no limit is met."""
SENSORS = ("noise", "quantization")
PHASES, PERIODS, LOWEST_HZ = 2, 2, 1.0
"""Multisines with different phases, periods of each, and their lowest frequency: few,
because every candidate pays for them."""
EXCITATION = 0.5
"""Of the amplitude of references, so that the loop is identified where it is used."""
UNSTABLE = 10.0
"""Violation by an unstable loop, above those of stable ones; it grows with the pole."""


@dataclass(frozen=True)
class Limits:
    """Limits on the loop around the nominal joint.

    Attributes:
        gain_margin: Factor on the loop gain with which the loop must be stable, > 1 [-].
        phase_margin: Smallest phase margin [deg].
        delay_margin: Additional delay with which it must be stable [s].
        sensitivity_peak: Largest Ms, > 1 [-].
        noise_amplification: Largest standard deviation of the command over that of the torque
            sensor's noise, from the noise of all sensors [-].
        port_share: Damping of the environment with which the output must be passive, as a share
            of `port_resistance` [-].
    """

    gain_margin: float = 2.0
    phase_margin: float = 30.0
    delay_margin: float = 1e-3
    sensitivity_peak: float = 2.0
    noise_amplification: float = 8.0
    port_share: float = 0.25

    def __post_init__(self) -> None:
        lowest = {"gain_margin": 1.0, "sensitivity_peak": 1.0}
        for known in fields(self):
            what, low = f"{known.name} of the limits of tuning", lowest.get(known.name, 0.0)
            high, unit = (90.0, "deg") if known.name == "phase_margin" else (math.inf, "")
            check_range(what, getattr(self, known.name), unit, low=low, high=high, finite=False)

    def violation(self, found: Assessment) -> float:
        """Return by how much a loop breaks the limits, 0 where it keeps them all.

        It is the sum of the relative violations, and 1 more where the loop is not robust; an
        unstable loop breaks them by at least 10.
        """
        if not found.stable:
            return UNSTABLE + max(0.0, found.growth)
        short = {
            "gain_margin": math.log(self.gain_margin / found.gain_margin)
            if math.isfinite(found.gain_margin)
            else 0.0,
            "phase_margin": 1.0 - found.phase_margin / max(self.phase_margin, 1e-9),
            "delay_margin": 1.0 - found.delay_margin / max(self.delay_margin, 1e-9),
            "sensitivity_peak": math.log(found.sensitivity_peak / self.sensitivity_peak),
            "noise_amplification": math.log(
                max(found.noise_amplification, 1e-9) / max(self.noise_amplification, 1e-9)
            ),
        }
        if found.port_share is not None:
            short["port_share"] = math.log(max(found.port_share, 1e-9) / max(self.port_share, 1e-9))
        return sum(max(0.0, value) for value in short.values()) + (not found.robust)


def port_resistance(joint: Joint) -> float:
    """Return sqrt(k_b (I_m + I_g)), with which a joint resists a sudden motion [N m s/rad]."""
    p = joint.parameters
    return math.sqrt(p.get("k_b", 0.0) * (p.I_m + p.get("I_g", 0.0)))


@dataclass(frozen=True)
class Assessment:
    """What the limits look at; infinite margins where there is no feedback."""

    # whether it comes from the linear model. Otherwise the law is not linear, and it comes from
    # multisines on the simulated joint with all its effects
    linear: bool
    stable: bool  # whether the loop is stable
    # of an unstable loop, the logarithm of its fastest pole's size per sample [-]
    growth: float = 0.0
    gain_margin: float = math.inf  # [-]
    phase_margin: float = math.inf  # [deg]
    delay_margin: float = math.inf  # [s]
    sensitivity_peak: float = 1.0  # [-]
    noise_amplification: float = 0.0  # [-]
    # damping that the environment must add, as a share of `port_resistance` [-]; None where it is
    # not known, because the law is not linear
    port_share: float | None = None
    bandwidth_hz: float = math.nan  # from the reference [Hz]
    # whether the linear part of the law is stable on changed joints too, see
    # `cjt_gym.baselines.robust`; gains that ship are taken only there
    robust: bool = True

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain data; what is not finite or not known is left out.

        An unstable loop has no margins, only poles.
        """
        values = asdict(self)
        if not self.stable:
            values = {name: values[name] for name in ("linear", "stable", "growth")}
        return {
            name: value
            for name, value in values.items()
            if isinstance(value, bool) or (value is not None and math.isfinite(value))
        }


def assess(law: Controller, joint: Joint, plant: LinearPlant, amplitude: float) -> Assessment:
    """Return what the limits look at."""
    sampled = SampledJoint(joint, plant.dt)
    robust = law.linear is None or is_robust(sampled, law.linear)
    model = probe_law(law, joint, plant.dt)
    if not model.is_linear:
        return replace(_by_simulation(law, joint, plant.dt, amplitude), robust=robust)
    loop, port = Loop(model, plant), port_resistance(joint)
    found = figures_of(loop)
    if not found.stable:
        return Assessment(True, False, float(np.log(np.max(np.abs(loop.poles())))))
    return Assessment(
        True,
        True,
        0.0,
        found.gain_margin,
        found.phase_margin,
        found.delay_margin,
        found.sensitivity_peak,
        _noise(law, joint, plant.dt)
        if law.linear is None
        else noise_gain(sampled.loop, law.linear),
        found.port_shortage / port if port > 0.0 else None,  # no spring, no port
        found.bandwidth_hz,
        robust,
    )


def _by_simulation(law: Law, joint: Joint, dt: float, amplitude: float) -> Assessment:
    """Assess a law that is not linear, around the signals of its use."""
    try:
        seen = identify(
            law,
            joint,
            dt,
            EXCITATION * amplitude,
            "disturbance",
            low=LOWEST_HZ,
            phases=PHASES,
            periods=PERIODS,
        )
    except SimulationError:
        return Assessment(False, False)
    s, nothing = seen.response, np.zeros(len(seen.f), dtype=np.complex128)
    loop = 1.0 / s - 1.0
    m = margins(Responses(seen.f, loop, s, nothing, nothing, nothing, nothing))
    noise = _noise(law, joint, dt)
    return Assessment(False, True, 0.0, m.gain, m.phase, m.delay, m.sensitivity, noise)


def _noise(law: Law, joint: Joint, dt: float) -> float:
    """Return the command's standard deviation over that of the torque sensor's noise, at rest.

    The sensors are as noisy as the joint says; where it says nothing of them, the noise of the
    torque sensor alone is a thousandth of the torque limit.
    """
    if not any(name in joint.effects for name in SENSORS):
        quiet = dict.fromkeys(("i", "q_m", "q_g", "q_l"), 0.0)
        alone: dict[str, Any] = {"noise": {**quiet, "tau": NOISE_SHARE * limits_of(joint).tau}}
        joint = replace(joint, effects=alone | dict(joint.effects))
    plant = SimulatedPlant(joint, 4, dt)
    measured, zero = plant.reset(seed=0), np.zeros(4)
    law.reset()
    commands, noises = [], []
    for _ in range(round(QUIET_S / dt)):
        command = law.act(measured, zero)
        commands.append(command)
        noises.append(measured.tau - plant.batch.arrays.tau)
        measured = plant.step(command)
    half = len(commands) // 2
    noise = float(np.std(np.array(noises)[half:]))
    spread = float(np.sqrt(np.mean(np.var(np.array(commands)[half:], axis=0))))
    return spread / noise if noise > 0.0 else 0.0
