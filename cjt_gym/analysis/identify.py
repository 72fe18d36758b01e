"""The response of a nonlinear closed loop, measured by multisines on the simulator.

Odd random-phase multisines leave some odd harmonics and all even ones unexcited: what appears
there is distortion, and what differs between periods is noise. The response that is averaged over
phases is the best linear approximation of the loop at that size of signal.

References:
    Pintelon, Schoukens (2012), System Identification: A Frequency Domain Approach, chapter 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cjt_gym.analysis.system import Complex, Floats
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint import Joint
from cjt_gym.plant import Law, SimulatedPlant

PLACES = ("reference", "disturbance")
LINES = 40
"""Of a multisine: enough for a smooth curve over two decades, with power left in each."""
PER_GROUP = 4
"""Of which one stays silent and shows distortion (odd random-phase multisines)."""
LOWEST_GAIN = 1e-300
"""So that nothing is divided by zero."""
SETTLING_S = 2.0
"""Before a response counts as periodic [s]."""


@dataclass(frozen=True)
class Identified:
    """A measured response, each array of shape (frequencies,).

    Attributes:
        place: "reference": from it to the true joint torque. "disturbance": sensitivity, from a
            torque at the motor to the motor torque that acts.
        f: Excited frequencies [Hz].
        response: Best linear approximation [-].
        noise: Standard deviation of the response for the sensors' noise [-].
        odd: Level of odd distortion over the linear output, at unexcited odd frequencies nearby.
        even: Level of even distortion, in the same way.
        amplitude: Rms of the excitation [N m].
    """

    place: str
    f: Floats
    response: Complex
    noise: Floats
    odd: Floats
    even: Floats
    amplitude: float

    @property
    def distortion(self) -> float:
        """Level of all distortion over the linear output, rms over the frequencies [-]."""
        return float(np.sqrt(np.mean(self.odd**2 + self.even**2)))

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain data: gain [-] and phase [deg] for the response."""
        return {
            "place": self.place,
            "amplitude": self.amplitude,
            "distortion": self.distortion,
            "f": self.f.tolist(),
            "gain": np.abs(self.response).tolist(),
            "phase": np.degrees(np.unwrap(np.angle(self.response))).tolist(),
            **{name: getattr(self, name).tolist() for name in ("noise", "odd", "even")},
        }


def identify(
    law: Law,
    joint: Joint,
    dt: float,
    amplitude: float,
    place: str = "reference",
    *,
    low: float = 0.5,
    high: float = 200.0,
    phases: int = 6,
    periods: int = 2,
    seed: int = 0,
) -> Identified:
    """Measure the response of a closed loop on the simulator.

    Args:
        law: The controller; it is reset.
        joint: The joint with all its effects.
        dt: Control step [s].
        amplitude: Rms of the multisine [N m].
        place: Where it enters, see `Identified`.
        low: Lowest frequency, which also sets the period of 1 / low [Hz].
        high: Highest frequency [Hz].
        phases: Realisations of the random phases, run side by side.
        periods: Periods that are measured, after whole ones of settling for at least 2 s.
        seed: Seed of phases and noise.

    Raises:
        UnknownNameError: There is no such place.
        ConfigurationError: A number is out of range.
        SimulationError: The loop is unstable.
    """
    check_name("place of the excitation", place, PLACES)
    if not (0.0 < low < high <= 0.5 / dt) or phases < 2 or periods < 2 or amplitude <= 0.0:
        raise ConfigurationError(
            f"identify needs 0 < low < high <= {0.5 / dt:g} Hz, amplitude > 0 N m, at least 2 "
            f"phases and 2 periods, got {low:g} and {high:g} Hz, {amplitude:g} N m, {phases} and "
            f"{periods}."
        )
    rng = np.random.default_rng(seed)
    samples = round(1.0 / (low * dt))
    excited, silent = _lines(high / low, rng)
    signal = _multisine(excited, samples, phases, amplitude, rng)
    put, got = _run(law, joint, dt, signal, place, periods, seed)
    inward = np.fft.rfft(put, axis=-1) / samples
    out = np.fft.rfft(got, axis=-1) / samples
    gains = out[..., excited] / inward[..., excited]
    mean = out.mean(axis=1)
    scatter = out.std(axis=1, ddof=1) / math.sqrt(periods)
    even = np.arange(2, int(excited[-1]), 2)
    linear = np.sqrt(np.mean(np.abs(mean[:, excited]) ** 2, axis=0))
    f = excited / (samples * dt)
    levels = []
    for lines in (silent, even):
        power = np.abs(mean[:, lines]) ** 2 - scatter[:, lines] ** 2
        level = np.sqrt(np.maximum(power.mean(axis=0), 0.0))
        levels.append(np.interp(excited, lines, level) / np.maximum(linear, LOWEST_GAIN))
    noise = gains.std(axis=1, ddof=1).mean(axis=0) / math.sqrt(phases * periods)
    best = gains.mean(axis=(0, 1))
    return Identified(place, f, best, noise, levels[0], levels[1], amplitude)


def _lines(ratio: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the excited and the silent odd harmonics: one in four is silent."""
    odd = np.unique(2 * np.round((np.geomspace(1.0, ratio, LINES) - 1.0) / 2.0).astype(int) + 1)
    odd = odd[odd <= ratio]
    silent = [odd[k + int(rng.integers(1, PER_GROUP))] for k in range(0, len(odd) - 3, PER_GROUP)]
    return np.setdiff1d(odd, silent), np.array(silent)


def _multisine(
    lines: np.ndarray, samples: int, phases: int, amplitude: float, rng: np.random.Generator
) -> Floats:
    """Return one period of each realisation, shape (phases, samples)."""
    spectrum = np.zeros((phases, samples // 2 + 1), dtype=np.complex128)
    spectrum[:, lines] = np.exp(2j * np.pi * rng.random((phases, len(lines))))
    signal = np.fft.irfft(spectrum, samples, axis=1)
    return np.asarray(signal * amplitude / np.sqrt(np.mean(signal**2, axis=1, keepdims=True)))


def _run(
    law: Law,
    joint: Joint,
    dt: float,
    signal: Floats,
    place: str,
    periods: int,
    seed: int,
) -> tuple[Floats, Floats]:
    """Return what was put in and what came out, each of shape (phases, periods, samples)."""
    phases, samples = signal.shape
    plant = SimulatedPlant(joint, phases, dt)
    measured = plant.reset(seed=seed)
    law.reset()
    settling = math.ceil(SETTLING_S / (samples * dt))
    got = np.empty((settling + periods, samples, phases))
    silence = np.zeros(phases)
    for period in range(settling + periods):
        for k in range(samples):
            now = signal[:, k]
            if place == "reference":
                got[period, k] = plant.batch.arrays.tau
                measured = plant.step(law.act(measured, now))
            else:
                applied = law.act(measured, silence) + now
                got[period, k] = applied
                measured = plant.step(applied)
    put = np.repeat(signal[:, None], periods, axis=1)
    return put, np.moveaxis(got[settling:], 2, 0)
