"""Joint files as most are written: no noise is stated, neither damping nor friction.

The records are those of a simulation by the classical Runge-Kutta method, written here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym.blind import draw_case, write_case
from cjt_gym.blind.mix import recipe
from cjt_gym.gap import diagnose
from cjt_gym.gap.blind_case import diagnose_files
from cjt_gym.gap.recorded.noise import channel_noise
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.joint import JointFile, get_structure, load_joint_file
from cjt_gym.records import Record, default_units

SHEET = """
name = "bare"
source = "datasheets of motor and spring"

[parameters]
n = { value = 50, unit = "-" }
k_t = { value = 0.06, unit = "N m/A" }
I_m = { value = 0.12, unit = "kg m^2" }
I_g = { value = 0.001, unit = "kg m^2", guess = true }
I_l = { value = 0.4, unit = "kg m^2", guess = true }
k_b = { value = 300, unit = "N m/rad" }
"""
INERTIA, LOAD, STIFFNESS, DAMPING = 0.121, 0.5, 300.0, 0.4
D_M, D_L, DRY = 0.6, 0.05, 0.8
FREE, FIXED = "rigid_gearbox", "output_fixed_rigid_gearbox"
DT, SAMPLES, SUBSTEPS, LAG, STEP = 1e-3, 8000, 5, 1e-3, 2e-5
NOISE = {"i": 0.02, "tau": 0.03}


def sheet(folder: Path) -> JointFile:
    path = folder / "bare.toml"
    path.write_text(SHEET)
    return load_joint_file(str(path))


def log(structure: str) -> Record:
    """Return command, current, angles and torque of a joint with friction and a lagging drive."""
    free, rng, t = structure == FREE, np.random.default_rng(0), DT * np.arange(SAMPLES)
    command = sum(
        3.0 / (1.0 + 0.2 * f) * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.28))
        for f in (0.3, 0.7, 1.3, 2.1, 3.7, 5.3, 8.0)
    )

    def slope(x: tuple[float, ...], wanted: float) -> tuple[float, ...]:
        q, v, q_l, v_l, i = x
        bar = STIFFNESS * (q - q_l) + DAMPING * (v - v_l)
        own = (3.0 * i - bar - D_M * v - DRY * np.tanh(v / 0.003)) / INERTIA
        return v, own, v_l, (bar - D_L * v_l) / LOAD if free else 0.0, (wanted - i) / LAG

    def moved(x: tuple[float, ...], k: tuple[float, ...], h: float) -> tuple[float, ...]:
        return tuple(a + h * b for a, b in zip(x, k, strict=True))

    states, x, h = np.zeros((SAMPLES, 5)), (0.0,) * 5, DT / SUBSTEPS
    for n, wanted in enumerate(command):
        states[n] = x
        for _ in range(SUBSTEPS):
            k1 = slope(x, wanted)
            k2 = slope(moved(x, k1, 0.5 * h), wanted)
            k3 = slope(moved(x, k2, 0.5 * h), wanted)
            k4 = slope(moved(x, k3, h), wanted)
            x = tuple(
                a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e)
                for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)
            )
    q, v, q_l, v_l, i = states.T
    columns = {"t": t, "i_cmd": command, "i": i, "q_m": STEP * np.round(q / STEP)}
    if free:
        columns["q_l"] = STEP * np.round(q_l / STEP)
    columns["tau"] = STIFFNESS * (q - q_l) + DAMPING * (v - v_l)
    for name, deviation in NOISE.items():
        columns[name] = columns[name] + deviation * rng.standard_normal(SAMPLES)
    return Record(columns, default_units(tuple(columns)), structure=structure)


@pytest.mark.parametrize("structure", [FREE, FIXED])
def test_all_friction_is_found_where_no_noise_is_stated(tmp_path: Path, structure: str) -> None:
    """Held, damping alone was confirmed, of 0.98 N m s/rad: dry friction lay below the noise that
    a drive is allowed. Free, the noise of angles was taken for that of a 13 bit converter."""
    found = diagnose(log(structure), sheet(tmp_path))
    assert found.verdict == "explained"
    known = {s: one for e in found.effects for s, one in e.parameters.items()}
    true = {"d_m": D_M, "d_cm": DRY} | ({"d_l": D_L} if structure == FREE else {})
    assert known.keys() == true.keys()
    for symbol, value in true.items():
        assert known[symbol].low < value < known[symbol].high, symbol
        assert known[symbol].value == pytest.approx(value, rel=0.02), symbol
    assert found.joint.parameters.d_gl == pytest.approx(DAMPING, rel=0.1)


def test_noise_that_shows_counts_however_far_a_joint_turns(tmp_path: Path) -> None:
    made, file = log(FREE), sheet(tmp_path)
    drifting = made.with_columns({n: made[n] + 5.0 * made["t"] for n in ("q_m", "q_l")})
    for record in (made, drifting):
        noise = make_setting(record, file, get_structure(FREE)).noise
        for name in ("q_m", "q_l"):
            assert noise[name].std < 2.0 * STEP
        assert noise["tau"].std == pytest.approx(NOISE["tau"], rel=0.1)
    smooth = made.with_columns({"q_m": np.sin(made["t"])})
    series = make_setting(smooth, file, get_structure(FREE)).series
    assert channel_noise(series, file, "q_m", 0.0).std == pytest.approx(7e-5, rel=0.1)


@pytest.mark.slow
def test_a_finer_law_is_chosen_below_the_noise(tmp_path: Path) -> None:
    """Plain dry friction of 0.17 N m was confirmed in the place of bristles that slip at 0.19."""
    made = recipe(501, 8, logs="bare")
    assert made.effects == ("presliding",)
    case = draw_case(
        made.seed, effects=made.effects, structure=made.structure, defects=made.defects
    )
    told = diagnose_files(write_case(case, tmp_path / "case"))
    (bristles,) = told["effects"]
    assert (bristles["name"], bristles["status"]) == ("presliding", "confirmed")
    true = case.label["parameters"]["presliding"]["d_cm"]
    assert bristles["parameters"]["d_cm"]["low"] < true < bristles["parameters"]["d_cm"]["high"]
