"""A bench of a joint with a spring, as a datasheet states it and as simulated records show it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.joint import Joint, load_joint
from cjt_gym.records import Record, default_units

SHEET = """
name = "bench"
source = "datasheets of motor, gear and spring"

[parameters]
n = { value = 100, unit = "-" }
k_t = { value = 0.0369, unit = "N m/A", source = "datasheet", tolerance = 0.03 }
I_m = { value = 0.25, unit = "kg m^2", source = "datasheet", tolerance = 0.05 }
I_g = { value = 0.01, unit = "kg m^2", source = "drawing", tolerance = 0.2 }
I_l = { value = 0.4, unit = "kg m^2", source = "drawing", tolerance = 0.05 }
k_b = { value = 600, unit = "N m/rad", source = "bench", tolerance = 0.02 }
d_gl = { value = 0.6, unit = "N m s/rad", source = "decay", tolerance = 0.3 }
d_m = { value = 3.0, unit = "N m s/rad", source = "no-load current", tolerance = 0.2 }
d_l = { value = 0.2, unit = "N m s/rad", source = "bearing", tolerance = 0.5 }
"""
SENSORS = """
[sensors.i]
noise = { value = 0.015, unit = "A" }
[sensors.q_m]
noise = { value = 1e-6, unit = "rad" }
[sensors.q_l]
noise = { value = 5e-6, unit = "rad" }
[sensors.tau]
noise = { value = 0.05, unit = "N m" }
"""
NOISE = {"i": 0.015, "q_m": 1e-6, "q_l": 5e-6, "tau": 0.02}
STRUCTURE = "rigid_gearbox"


def joint_of(folder: Path, more: str = "", structure: str = STRUCTURE, **options: object) -> Joint:
    """Return the joint of the datasheet with more lines, written to a file in a folder."""
    path = folder / "bench.toml"
    path.write_text(f"{SHEET.rstrip()}\n{more}\n{SENSORS}")
    return load_joint(str(path), structure, **options)  # type: ignore[arg-type]


def record_of(true: Joint, samples: int = 8000) -> Record:
    """Return a record of a joint under random steps of torque and a sine, at 1 kHz."""
    rng, t = np.random.default_rng(0), 1e-3 * np.arange(samples)
    steps = np.repeat(rng.uniform(-15.0, 15.0, samples // 80), 80)
    torque = steps + 3.0 * np.sin(2.0 * np.pi * 3.0 * t)
    made = quiet(true).simulate(torque, dt=1e-3)
    columns = {"t": t, "i_cmd": torque / (true.parameters.k_t * true.parameters.n)}
    sprung = true.structure_row.has_spring
    for name, deviation in NOISE.items():
        if name in ("q_l", "tau") and not sprung:
            continue
        columns[name] = made[name] + deviation * rng.standard_normal(samples)
    return Record(columns, default_units(tuple(columns)), structure=true.structure)
