"""A datasheet value that is three to four of its tolerances off, which the stages do not name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.model import quiet
from cjt_gym.joint import load_joint
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

[sensors.i]
noise = { value = 0.015, unit = "A" }
[sensors.q_m]
noise = { value = 1e-6, unit = "rad" }
[sensors.q_l]
noise = { value = 5e-6, unit = "rad" }
[sensors.tau]
noise = { value = 0.05, unit = "N m" }
"""
NOISE = {"q_m": 1e-6, "q_l": 5e-6, "tau": 0.02}


@pytest.mark.parametrize("factor", [1.9, 2.0])
def test_the_effect_that_frees_it_explains_it(tmp_path: Path, factor: float) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(SHEET)
    sheet = load_joint(str(path), "rigid_gearbox")
    off = {"d_m": 3.0 * factor, "k_t": 1.01 * sheet.parameters.k_t}
    true = quiet(load_joint(str(path), "rigid_gearbox", parameters=off))
    rng, t = np.random.default_rng(0), 1e-3 * np.arange(8000)
    torque = np.repeat(rng.uniform(-15.0, 15.0, 100), 80) + 3.0 * np.sin(2.0 * np.pi * 3.0 * t)
    made = true.simulate(torque, dt=1e-3)
    amps = torque / (true.parameters.k_t * true.parameters.n)
    columns = {"t": t, "i_cmd": amps, "i": np.append(0.0, amps[:-1])}
    columns["i"] = columns["i"] + 0.015 * rng.standard_normal(len(t))
    for name, deviation in NOISE.items():
        columns[name] = made[f"true_{name}"] + deviation * rng.standard_normal(len(t))
    record = Record(columns, default_units(tuple(columns)), structure="rigid_gearbox")
    found = diagnose(record, sheet.file, "rigid_gearbox")
    assert found.verdict == "explained"
    assert [e.name for e in found.effects] == ["damping"]
    assert found.effects[0].parameters["d_m"].value == pytest.approx(off["d_m"], rel=0.02)
