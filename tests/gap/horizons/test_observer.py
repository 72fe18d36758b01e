"""States and zeros that a record lacks; the records are of plain masses and springs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from cjt_gym.gap.horizons.prediction.forward import CHANNELS, Forecast
from cjt_gym.gap.horizons.prediction.log import Log, to_log
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.joint import Joint, JointFile, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import Record

DT, SECONDS = 1e-3, 6.0
I_M, I_L, K_B, D_M, D_GL, D_L = 0.3, 1.0, 900.0, 1.5, 0.4, 0.2
FREE, HELD = "rigid_gearbox", "output_fixed_rigid_gearbox"
UNITS = {"t": "s", "i_cmd": "A", "q_m": "rad", "q_l": "rad"}
NOISE = 2e-6


def sheet(**values: float) -> JointFile:
    known = {
        "I_m": I_M, "I_g": 0.0, "I_l": I_L, "k_b": K_B, "d_m": D_M, "d_g": 0.0, "d_l": D_L,
        "d_gl": D_GL, "n": 1.0, "k_t": 1.0,
    }  # fmt: skip
    return JointFile(JointParameters.from_values("masses", known | values))


def log_of(columns: dict[str, np.ndarray], structure: str, file: JointFile | None = None) -> Log:
    units = {name: UNITS[name] for name in columns}
    record = Record(columns, units, structure=structure, allow_nan=True)
    return to_log(record, file or sheet(), get_structure(structure))


def torques(seed: int = 0) -> np.ndarray:
    """Return torques that change every 50 ms [N m]."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-3.0, 3.0, round(SECONDS / 0.05)), round(0.05 / DT))


def two_masses(
    twist: float, twist_rate: float, driven: float = 1.0
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return command and motor angle of two masses on a spring, and all four states."""
    a = np.array(
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-K_B / I_M, K_B / I_M, -(D_M + D_GL) / I_M, D_GL / I_M],
            [K_B / I_L, -K_B / I_L, D_GL / I_L, -(D_L + D_GL) / I_L],
        ]
    )
    full = np.zeros((5, 5))
    full[:4, :4], full[2, 4] = a * DT, DT / I_M
    step, u = expm(full), driven * torques()
    x = np.zeros((len(u), 4))
    x[0] = 0.0, -twist, 0.0, -twist_rate
    for k in range(1, len(u)):
        x[k] = step[:4, :4] @ x[k - 1] + step[:4, 4] * u[k - 1]
    noise = NOISE * np.random.default_rng(1).standard_normal(len(u))
    return {"t": DT * np.arange(len(u)), "i_cmd": u, "q_m": x[:, 0] + noise}, x


def forecast(log: Log, file: JointFile) -> Forecast:
    return Forecast(quiet(Joint(file, FREE, "current", {})), log)


@pytest.mark.parametrize("stiffness", [1.0, 1.2], ids=["as it is", "20 % off"])
def test_the_load_is_found_from_command_and_motor(stiffness: float) -> None:
    """The record begins while the load swings, which no channel shows."""
    columns, x = two_masses(0.02, 0.5)
    file = sheet(k_b=stiffness * K_B)
    found = forecast(log_of(columns, FREE), file).states
    late = slice(round(0.5 / DT), None)
    twist = (x[:, 0] - x[:, 1])[late]
    off = (found[:, 2] - x[:, 1])[late]
    assert np.std(off) < (0.02 if stiffness == 1.0 else 0.3) * np.std(twist)


def test_an_estimate_that_starts_anew_after_a_gap_recovers() -> None:
    columns, x = two_masses(0.0, 0.0)
    gap = slice(2000, 2100)
    columns["q_m"][gap] = np.nan
    log = log_of(columns, FREE)
    assert not log.whole[gap].any()
    late = slice(2600, None)
    off = forecast(log, sheet()).states[late, 2] - x[late, 1]
    assert np.std(off) < 0.02 * np.std((x[:, 0] - x[:, 1])[late])


def test_a_joint_that_nothing_drives_is_estimated_as_well() -> None:
    """The load swings out on its spring after it was let go."""
    columns, x = two_masses(0.02, 0.5, driven=0.0)
    found = forecast(log_of(columns, FREE), sheet()).states
    late = slice(round(0.4 / DT), None)
    assert np.std((found[:, 2] - x[:, 1])[late]) < 0.02 * np.std((x[:, 0] - x[:, 1])[late])


def test_a_right_joint_predicts_what_it_was_not_shown() -> None:
    """From the estimated start the motor's motion over half a second follows."""
    columns, x = two_masses(0.02, 0.5)
    log = log_of(columns, FREE)
    starts = np.arange(600, 5000, 400)
    length = round(0.5 / DT)
    out = forecast(log, sheet()).windows(
        starts, np.full(len(starts), length), np.full(len(starts), 3)
    )
    true = x[starts[:, None] + np.arange(length), 0]
    did = true - true[:, :1] - x[starts, 2][:, None] * DT * np.arange(length)
    assert np.std(out[:, :, 0] - true) < 0.01 * np.std(did)


def one_mass(friction: str) -> np.ndarray:
    """Return the angle of a mass on a held spring, by ten substeps a sample."""
    u, h = torques(2), DT / 10.0
    q = v = 0.0
    out = np.zeros(len(u))
    for k, torque in enumerate(u):
        out[k] = q
        for _ in range(10):
            drag = 3.0 * D_M if friction == "viscous_asym" and v < 0.0 else D_M
            v += h * (torque - K_B * q) / I_M
            v /= 1.0 + h * (drag + D_GL) / I_M
            if friction == "coulomb":
                v -= np.clip(v, -h * 0.4 / I_M, h * 0.4 / I_M)
            q += h * v
    return out


@pytest.mark.parametrize("friction", ["plain", "coulomb", "viscous_asym"])
def test_the_zero_of_a_held_joint_is_that_of_its_spring(friction: str) -> None:
    """Friction that differs with the direction moves the mean of the angle, but not its zero."""
    q, u = one_mass(friction), torques(2)
    log = log_of({"t": DT * np.arange(len(u)), "i_cmd": u, "q_m": q + 0.05}, HELD)
    zero = log.states[0, 2]
    assert zero == pytest.approx(0.05, abs=0.02 * float(np.std(q)))


def test_an_input_that_is_constant_but_for_rounding_has_the_filter_of_a_constant_one() -> None:
    t = 5e-3 * np.arange(847)
    angle = np.round(0.2 * np.maximum(t - 1.0, 0.0) / 1e-5) * 1e-5
    file = sheet(I_m=0.439, I_l=0.0, d_m=15.0, d_l=0.0)
    joint = quiet(Joint(file, "rigid", "current", {}))
    found = []
    for level in (4.0, 4.0 + 4.0 * np.finfo(float).eps):
        command = np.where(np.arange(len(t)) % 2, 4.0, level)
        log = log_of({"t": t, "i_cmd": command, "q_m": angle}, "rigid", file)
        forecast = Forecast(joint, replace(log, filtered=True))
        one = forecast.windows(np.array([220]), np.array([20]), np.array([0]))
        found.append(one[0, :20, CHANNELS["q_m"]])
    assert found[1] == pytest.approx(found[0], rel=1e-9)
