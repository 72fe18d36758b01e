"""What a datasheet states with a tolerance, and what it leaves unstated."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.horizons.model import quiet
from cjt_gym.gap.recorded.series import stretches
from cjt_gym.gap.stages.kernel import smooth_speed
from cjt_gym.gap.stages.smoothing import with_smoothing
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
FRICTION = 'd_cm = { value = 2.5, unit = "N m", source = "no-load current", tolerance = 0.2 }\n'
NOISE = {"q_m": 1e-6, "q_l": 5e-6, "tau": 0.02}


def joint_of(folder: Path, text: str, **options: object) -> Joint:
    path = folder / "bench.toml"
    path.write_text(text + SENSORS)
    return load_joint(str(path), "rigid_gearbox", **options)  # type: ignore[arg-type]


def record_of(true: Joint) -> Record:
    """Return eight seconds of a joint under random steps of torque and a sine."""
    rng, t = np.random.default_rng(0), 1e-3 * np.arange(8000)
    torque = np.repeat(rng.uniform(-15.0, 15.0, 100), 80) + 3.0 * np.sin(2.0 * np.pi * 3.0 * t)
    made = quiet(true).simulate(torque, dt=1e-3)
    amps = torque / (true.parameters.k_t * true.parameters.n)
    columns = {"t": t, "i_cmd": amps, "i": np.append(0.0, amps[:-1])}
    columns["i"] = columns["i"] + 0.015 * rng.standard_normal(len(t))
    for name, deviation in NOISE.items():
        columns[name] = made[f"true_{name}"] + deviation * rng.standard_normal(len(t))
    return Record(columns, default_units(tuple(columns)), structure="rigid_gearbox")


@pytest.mark.parametrize("factor", [1.9, 2.0])
def test_the_effect_that_frees_a_value_far_off_explains_it(tmp_path: Path, factor: float) -> None:
    sheet = joint_of(tmp_path, SHEET)
    off = {"d_m": 3.0 * factor, "k_t": 1.01 * sheet.parameters.k_t}
    found = diagnose(
        record_of(joint_of(tmp_path, SHEET, parameters=off)), sheet.file, "rigid_gearbox"
    )
    assert found.verdict == "explained"
    assert [e.name for e in found.effects] == ["damping"]
    assert found.effects[0].parameters["d_m"].value == pytest.approx(off["d_m"], rel=0.02)


def sticking(folder: Path, level: float) -> Diagnosis:
    """Return the diagnosis of a joint that sticks, by a datasheet that does not say that it does.

    Its friction is 2.5 N m within 20 %.
    """
    sheet = joint_of(folder, SHEET.rstrip() + "\n" + FRICTION + "[effects.coulomb]\n")
    effects = {"coulomb": {"d_cm": level, "dq_0": 0.0}}
    true = joint_of(folder, SHEET, effects=effects)
    return diagnose(record_of(true), sheet.file, "rigid_gearbox")


def test_friction_within_its_tolerance_is_refined(tmp_path: Path) -> None:
    found = sticking(tmp_path, 2.8)
    assert (found.verdict, found.effects) == ("no_gap", ())
    assert not any(stage.significant for stage in found.stages.values())
    assert found.joint.effects["coulomb"]["d_cm"].number == pytest.approx(2.8, rel=0.02)  # type: ignore[union-attr]


def test_friction_beyond_its_tolerance_is_named(tmp_path: Path) -> None:
    found = sticking(tmp_path, 5.0)
    assert [e.name for e in found.effects] == ["coulomb"]
    assert found.effects[0].parameters["d_cm"].value == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize("width", [0.0, 0.002])
def test_unstated_smoothing_is_what_the_record_shows(tmp_path: Path, width: float) -> None:
    sheet = joint_of(tmp_path, SHEET.rstrip() + "\n" + FRICTION + "[effects.coulomb]\n")
    true = joint_of(tmp_path, SHEET, effects={"coulomb": {"d_cm": 2.5, "dq_0": width}})
    told = with_smoothing(sheet.file, sheet.structure_row, stretches([record_of(true)]))
    sharp = told.effects["coulomb"].get("dq_0")
    assert (sharp is not None and sharp.number == 0.0) == (width == 0.0)  # type: ignore[union-attr]


@given(
    start=st.floats(-3.0, 3.0),
    free=st.floats(-3.0, 3.0),
    reach=st.floats(1e-4, 2.0),
    width=st.floats(1e-4, 0.1),
)
def test_a_step_of_smoothed_friction_solves_its_equation(
    start: float, free: float, reach: float, width: float
) -> None:
    """`reach` is the velocity that friction takes from a sliding body within a sample."""
    v = smooth_speed(start, free, 1.0, reach, width)
    stiff = reach / width
    share = 0.5 if stiff < 1e-3 else 1.0 / (1.0 - math.exp(-stiff)) - 1.0 / stiff
    between = start + share * (v - start)
    assert v == pytest.approx(free - reach * math.tanh(between / width), abs=1e-6)
