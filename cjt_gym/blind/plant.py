"""Parts of a joint of the blind tests: bodies, drive, sensors, and how they are joined.

All values are in SI units on the link side of the gear. A field at its default has no effect.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOTOR, GEAR, LOAD, MOUNT = 0, 1, 2, 3
BODY_NAMES: Final = ("motor", "gear", "load")
CHANNELS: Final = ("i", "q_m", "q_g", "q_l", "tau")
"""Measured channels, in the order of the columns of every array of measurements."""


class Plant(NamedTuple):
    """Mechanics of a joint, including all disturbances.

    Bodies carry the suffixes m (motor), g (gear), l (load) and f (a mass on a flexible mount).
    """

    I_m: float
    I_g: float
    I_l: float
    k_g: float
    k_b: float
    d_mg: float
    d_gl: float
    d_m: float
    d_g: float
    d_l: float
    n: float
    k_t: float
    torque_offset: float = 0.0
    # Damping that is added at negative velocity [N m s/rad], and drag c v |v| [N m s^2/rad^2].
    extra_m: float = 0.0
    extra_g: float = 0.0
    extra_l: float = 0.0
    drag_m: float = 0.0
    drag_l: float = 0.0
    # Dry friction: levels for the two directions, and the breakaway above them [N m].
    up_m: float = 0.0
    down_m: float = 0.0
    up_g: float = 0.0
    down_g: float = 0.0
    up_l: float = 0.0
    down_l: float = 0.0
    rise_m: float = 0.0
    rise_g: float = 0.0
    rise_l: float = 0.0
    v_s: float = 1.0
    mu_m: float = 0.0
    mu_g: float = 0.0
    # Friction of the motor that fades with time and travel, and friction that depends on position.
    cold: float = 0.0
    cold_time: float = 1.0
    cold_travel: float = 1.0
    spot: float = 0.0
    spot_f: float = 0.0
    spot_phase: float = 0.0
    # Elastic presliding: level [N m] and deflection [rad] of the bristles.
    bristle_m: float = 0.0
    bristle_g: float = 0.0
    bristle_l: float = 0.0
    z_s: float = 1.0
    # Torques periodic in q_m: amplitudes of cos and sin, periods per revolution.
    cog_a: float = 0.0
    cog_b: float = 0.0
    cog_f: float = 0.0
    mesh_a: float = 0.0
    mesh_b: float = 0.0
    mesh_f: float = 0.0
    # Warming of the winding: time constant [s], loss of torque per squared current [1/A^2].
    heat_time: float = 1.0
    heat_loss: float = 0.0
    # Play [rad]: total width, and a part of it that varies with q_m.
    play: float = 0.0
    loose: float = 0.0
    loose_f: float = 0.0
    loose_phase: float = 0.0
    # Torsion bar: cubic stiffness, difference between the two directions, creep, hysteresis.
    k_3: float = 0.0
    skew: float = 0.0
    creep: float = 0.0
    creep_time: float = 1.0
    slip_torque: float = 0.0
    slip_width: float = 1.0
    wen_torque: float = 0.0
    wen_width: float = 1.0
    # Load and surroundings.
    m_g_l: float = 0.0
    q_0: float = 0.0
    shake_m: float = 0.0
    shake_l: float = 0.0
    shake_f: float = 0.0
    shake_phase: float = 0.0
    I_f: float = 1.0
    k_f: float = 0.0
    d_f: float = 0.0


class Drive(NamedTuple):
    """From the command to the motor current."""

    bandwidth: float
    i_max: float
    delay: float = 0.0
    resolution: float = 0.0
    dead: float = 0.0
    slew: float = np.inf


class Sensing(NamedTuple):
    """Systematic errors of the sensors, beyond rounding and white noise."""

    gain: float = 1.0
    bias: float = 0.0
    delay: float = 0.0
    crosstalk: float = 0.0
    drift: float = 0.0
    drift_time: float = 1.0
    hum: float = 0.0
    hum_f: float = 50.0
    hum_phase: float = 0.0
    ecc_m: float = 0.0
    ecc_m_f: float = 0.0
    ecc_l: float = 0.0
    ecc_phase: float = 0.0
    counts: float = 0.0
    # Ordinary calibration errors, no effects.
    zero_i: float = 0.0
    zero_m: float = 0.0
    zero_g: float = 0.0
    zero_l: float = 0.0
    zero_tau: float = 0.0


def packed(values: Plant | Drive | Sensing) -> Any:
    """Return the fields as a NumPy record, which compiled functions take by reference."""
    dtype = np.dtype([(name, np.float64) for name in values._fields])
    return np.array([tuple(values)], dtype)[0]


@dataclass(frozen=True)
class Structure:
    """Which bodies move together.

    Attributes:
        name: Name of the structure.
        leads: For motor, gear, load and mount the body whose motion it shares; -1 if it is held.
    """

    name: str
    leads: tuple[int, int, int, int]

    @property
    def gear_is_soft(self) -> bool:
        """Whether motor and gear are joined by a spring."""
        return self.leads[GEAR] != self.leads[MOTOR]

    @property
    def bar_is_soft(self) -> bool:
        """Whether gear and load are joined by a spring."""
        return self.leads[LOAD] != self.leads[GEAR]

    @property
    def is_locked(self) -> bool:
        """Whether the load is held."""
        return self.leads[LOAD] < 0

    @property
    def lead_array(self) -> Ints:
        """The leads as an array, shape (4,)."""
        return np.array(self.leads, dtype=np.int64)


STRUCTURES: Final[dict[str, Structure]] = {
    row.name: row
    for row in (
        Structure("full_dynamics", (0, 1, 2, 3)),
        Structure("rigid_gearbox", (0, 0, 2, 3)),
        Structure("rigid", (0, 0, 0, 3)),
        Structure("output_fixed", (0, 1, -1, 3)),
        Structure("output_fixed_rigid_gearbox", (0, 0, -1, 3)),
    )
}


PERFECT: Final = Sensing()
"""Sensors without any error."""


@dataclass(frozen=True)
class World:
    """The true joint, which the simulator runs."""

    structure: Structure  # how the bodies are joined
    plant: Plant  # mechanics
    drive: Drive  # from command to current
    sensing: Sensing = PERFECT  # systematic errors of the sensors
    # step of each of CHANNELS [its unit], shape (5,); 0 is none
    resolution: tuple[float, ...] = (0.0,) * 5
    # standard deviation of each of CHANNELS [its unit], shape (5,)
    noise: tuple[float, ...] = (0.0,) * 5
    process: float = 0.0  # standard deviation of the torque that disturbs the motor [N m]
    jitter: float = 0.0  # standard deviation of the sampling instants [s]
    lost: float = 0.0  # rate at which counts of the motor encoder are lost [1/s]
    sampling: float = 1e-3  # time between samples [s]
    start: dict[str, float] = field(default_factory=dict)
