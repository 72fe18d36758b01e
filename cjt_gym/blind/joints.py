"""Random joints and their datasheets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cjt_gym.blind.plant import CHANNELS, Drive, Plant, Sensing, Structure, World

TOLERANCES: Final = {
    "I_m": 0.02,
    "I_g": 0.05,
    "I_l": 0.02,
    "k_g": 0.05,
    "k_b": 0.015,
    "d_mg": 0.1,
    "d_gl": 0.2,
    "d_m": 0.2,
    "d_g": 0.1,
    "d_l": 0.2,
    "k_t": 0.015,
}
"""Relative tolerance (one sigma) of datasheet values."""
LOOP_BANDWIDTH: Final = (400.0, 1500.0)
"""Range of the bandwidth of the current loop [Hz]."""
DT: Final = 1e-3
"""Time between samples [s]."""


@dataclass(frozen=True)
class Datasheet:
    """Datasheet of a joint."""

    values: dict[str, float]  # symbol and value of every parameter [SI]
    tolerances: dict[str, float]  # relative tolerances (one sigma), by symbol
    i_p: float  # peak current [A]
    bandwidth: float  # of the current loop [Hz]
    resolution: tuple[float, ...]  # step of each of CHANNELS; 0 is none
    noise: tuple[float, ...]  # standard deviation of each of CHANNELS
    channels: tuple[str, ...]  # measured channels
    dt: float  # time between samples [s]
    jitter: float  # standard deviation of the sampling instants [s]
    guesses: tuple[str, ...] = ()  # parameters marked as guesses instead of having a tolerance
    # whether its file leaves out sensors, sampling, tolerances and the damping of the bar
    bare: bool = False


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_plant(structure: Structure, rng: np.random.Generator) -> Plant:
    """Return the mechanics of a random joint, without any effect.

    Ranges extend well beyond the identified joints of the Compliant Joint Toolbox.
    """
    n = float(rng.integers(30, 161))
    inertia = _log(rng, 0.03 if structure.is_locked else 0.1, 2.2)
    k_b = _log(rng, 500.0, 30000.0)
    gear = rng.uniform(0.15, 0.5)
    strong = rng.random() < 0.25
    return Plant(
        I_m=inertia * (1.0 - gear),
        I_g=inertia * gear,
        I_l=max(inertia * _log(rng, 0.3, 3.0), 0.15),
        k_g=max(_log(rng, 6000.0, 40000.0), 0.3 * k_b),
        k_b=k_b,
        d_mg=_log(rng, 40.0, 300.0) * min(inertia / 0.1, 1.0),
        d_gl=_log(rng, 0.1, 5.0) * min(inertia / 0.3, 1.0),
        d_m=_log(rng, 0.5, 5.0) * inertia if strong else _log(rng, 0.003, 0.03) * inertia,
        d_g=_log(rng, 3.0, 30.0) * inertia,
        d_l=_log(rng, 0.1, 1.0) * inertia,
        n=n,
        k_t=_drive_torque(inertia, k_b, structure, rng) / (n * 30.0),
    )


def _drive_torque(
    inertia: float, k_b: float, structure: Structure, rng: np.random.Generator
) -> float:
    """Return a suitable torque at 30 A [N m]."""
    wanted = inertia * 400.0 if not structure.is_locked else min(inertia * 600.0, 0.04 * k_b)
    return float(np.clip(wanted, 25.0, 600.0)) * rng.uniform(0.7, 1.4)


def draw_sensors(
    plant: Plant, rng: np.random.Generator
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return resolution and noise of CHANNELS, each of length 5."""
    motor = 2.0 * np.pi / 2.0 ** int(rng.integers(13, 17)) / plant.n
    gear = 2.0 * np.pi / 2.0 ** int(rng.integers(18, 21))
    load = 2.0 * np.pi / 2.0 ** int(rng.integers(18, 21))
    torque = float(rng.choice([0.005, 0.01, 0.02, 0.05]))
    current = 0.0 if rng.random() < 0.7 else 0.005
    share = rng.uniform(0.3, 0.6, 2)
    noise = (
        0.015 * _log(rng, 0.5, 2.0),
        motor * share[0],
        gear * share[1],
        load * share[1],
        torque * rng.uniform(1.5, 3.0),
    )
    return (current, motor, gear, load, torque), noise


def draw_joint(structure: Structure, rng: np.random.Generator) -> tuple[World, Datasheet]:
    """Return a random joint without any effect, and its datasheet.

    Every value of the datasheet deviates normally within its tolerance.
    """
    plant = draw_plant(structure, rng)
    resolution, noise = draw_sensors(plant, rng)
    i_p = float(rng.choice([15.0, 20.0, 30.0, 40.0, 60.0]))
    plant = plant._replace(k_t=plant.k_t * 30.0 / i_p)
    bandwidth, jitter = round(_log(rng, *LOOP_BANDWIDTH), -1), 1e-5
    zeros = rng.uniform(-0.06, 0.06, 3)
    offsets = rng.standard_normal(2) * (0.004, 0.03)
    sensing = Sensing(
        zero_i=offsets[0],
        zero_m=zeros[0],
        zero_g=zeros[1],
        zero_l=zeros[2],
        zero_tau=offsets[1],
    )
    drive = Drive(bandwidth=bandwidth, i_max=i_p)
    world = World(structure, plant, drive, sensing, resolution, noise, 0.02, jitter, sampling=DT)
    values = {
        symbol: getattr(plant, symbol) * (1.0 + sigma * rng.standard_normal())
        for symbol, sigma in TOLERANCES.items()
    }
    seen = rng.random() < 0.15 and structure.gear_is_soft
    channels = tuple(name for name in CHANNELS if name != "q_g" or seen)
    stated = {"n": plant.n, **values}
    specified = _as_sensed(world)
    sheet = Datasheet(
        stated, TOLERANCES, i_p, bandwidth, resolution, specified, channels, DT, jitter
    )
    return world, sheet


def _as_sensed(world: World) -> tuple[float, ...]:
    """Return the noise of each channel; a rigid joint passes the motor's own on to its torque."""
    *others, torque = world.noise
    if world.structure.bar_is_soft:
        return world.noise
    p = world.plant
    share = p.I_l / (p.I_m + p.I_g + p.I_l)
    return (*others, float(np.hypot(torque, share * world.process)))


def as_stated(world: World, sheet: Datasheet) -> World:
    """Return the joint that the datasheet describes: without effects or calibration errors."""
    plant = Plant(**{name: sheet.values[name] for name in Plant._fields[:12]})
    drive = Drive(bandwidth=sheet.bandwidth, i_max=sheet.i_p)
    return World(world.structure, plant, drive, sampling=world.sampling, start=world.start)
