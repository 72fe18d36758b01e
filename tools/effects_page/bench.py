"""Simulated test benches on which the effects are measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from cjt_gym.joint import Joint, load_joint
from cjt_gym.records import Record

Floats = NDArray[np.floating[Any]]
Complexes = NDArray[np.complexfloating[Any, Any]]
JOINT = "orange_80_6000"
FIXED = "output_fixed_rigid_gearbox"
H = 1e-4


def joint(
    effects: Mapping[str, Mapping[str, Any]],
    structure: str = FIXED,
    drive: str = "current",
    **parameters: float,
) -> Joint:
    """Return the joint of all figures with exactly these effects; parameters replace its own.

    Viscous damping that is replaced is replaced in both directions.
    """
    for name in ("d_m", "d_g", "d_l"):
        if name in parameters:
            parameters[f"{name}_n"] = parameters[name]
    return load_joint(JOINT, structure, drive, effects=effects, parameters=parameters)


def drag(effects: Mapping[str, Mapping[str, Any]], speed: float, tau_m: float = 0.0) -> float:
    """Return the steady torque at the output that turns at constant speed [N m].

    The bar is damped so that it settles on a falling characteristic as well.

    Args:
        effects: Effects.
        speed: Speed of the output [rad/s].
        tau_m: Motor torque [N m].
    """
    bench = joint(effects, d_gl=200.0, d_m=0.0, d_g=0.0)
    return float(np.mean(turning(bench, speed, 3000, tau_m)["true_tau"][-100:]))


def turning(
    bench: Joint, speed: float, samples: int, tau_m: float = 0.0, dt_physics: float = H
) -> Record:
    """Simulate a joint whose output turns at constant speed [rad/s], as all bodies do at first."""
    x0 = np.array([0.0, 0.0, 0.0, speed, speed, speed])
    inputs = np.full(samples, tau_m), np.full(samples, speed)
    return bench.simulate(*inputs, x0=x0, dt_physics=dt_physics)


def blocked(bench: Joint, tau_m: Floats, dt: float = 1e-3, **more: Any) -> Record:
    """Simulate a joint whose output stands still."""
    more.setdefault("dt_physics", min(dt, H))
    return bench.simulate(tau_m, np.zeros(len(tau_m)), dt, **more)


def fourier(x: Floats, t: Floats, f: float) -> complex:
    """Return the complex amplitude of the component of x at f [Hz], over whole periods."""
    return complex(2.0 * np.mean(x * np.exp(-2j * np.pi * f * t)))


def multisine(frequencies: Floats, t: Floats, amplitude: float = 1.0) -> Floats:
    """Return a sum of sines with Schroeder's phases, which keep its peaks low."""
    count = len(frequencies)
    phases = -np.pi * np.arange(count) ** 2 / count
    waves = np.sin(2.0 * np.pi * np.outer(frequencies, t) + phases[:, None])
    return np.asarray(amplitude * waves.sum(axis=0), dtype=np.float64)


def tones(low: float, high: float, count: int, step: float) -> Floats:
    """Return about `count` frequencies, evenly spread on a log scale, all multiples of a step."""
    return np.unique(np.round(np.geomspace(low, high, count) / step)) * step


def response(
    bench: Joint,
    frequencies: Floats,
    output: str = "true_tau",
    *,
    period: float = 2.0,
    dt: float = 5e-4,
) -> Complexes:
    """Return the measured frequency response from motor torque to a channel.

    A multisine runs twice; the second period counts. The hold of the command over a sample is
    divided out.

    Args:
        bench: The joint.
        frequencies: Frequencies, multiples of 1 / period [Hz].
        output: Channel.
        period: Period of the multisine [s].
        dt: Sample time [s].
    """
    samples = round(period / dt)
    t = np.arange(2 * samples) * dt
    tau_m = multisine(frequencies, t, 0.2)
    record = bench.simulate(tau_m, np.zeros(len(t)), dt, dt_physics=min(dt, H))
    last = slice(samples, None)
    y = np.array([fourier(record[output][last], t[last], f) for f in frequencies])
    u = np.array([fourier(tau_m[last], t[last], f) for f in frequencies])
    hold = np.sinc(frequencies * dt) * np.exp(-1j * np.pi * frequencies * dt)
    return np.asarray(y / u / hold, dtype=np.complex128)


def model_response(bench: Joint, frequencies: Floats) -> Complexes:
    """Return the frequency response of the linear model from motor torque to joint torque."""
    system = bench.state_space()
    one = system[system.output_labels.index("tau"), system.input_labels.index("tau_m")]
    values = one(2j * np.pi * frequencies)
    return np.asarray(values, dtype=np.complex128).reshape(-1)


def decibel(values: Complexes | Floats) -> Floats:
    """Return the gain in dB."""
    return np.asarray(20.0 * np.log10(np.abs(values)), dtype=np.float64)


def degrees(values: Complexes) -> Floats:
    """Return the phase in degrees, unwrapped."""
    return np.asarray(np.degrees(np.unwrap(np.angle(values))), dtype=np.float64)


def density(x: Floats, dt: float, window: int) -> tuple[Floats, Floats]:
    """Return frequencies [Hz] and the one-sided power spectral density of x (Welch, Hann)."""
    f, power = welch(x, 1.0 / dt, np.hanning(window), detrend=False)
    return f[2:-1], power[2:-1]
