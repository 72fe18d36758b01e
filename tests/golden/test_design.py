"""Linear-quadratic and Kalman gains of three joints against figures with seventy digits.

The toolbox's own gains are good to a few digits only where it finds any; these are those of its
problems, solved with extended precision. They belong to continuous designs with the positions of
all bodies among the states. Where the motor torque alone is noisy, they are what our sampled
filters tend to with the sample time; the others test the joints' matrices and their Riccati
equations.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from cjt_gym import load_joint
from cjt_gym.baselines.observers.kalman import noise_model, steady_gain
from cjt_gym.baselines.plant_model import SampledJoint

ROWS: list[dict[str, Any]] = json.loads((Path(__file__).parent / "design.json").read_text())
OUTPUTS = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")


def matrices(row: dict[str, Any]) -> tuple[Any, Any, Any]:
    system = load_joint(row["joint"], row["structure"], effects={}).state_space()
    order = [list(system.output_labels).index(name) for name in OUTPUTS]
    return (np.asarray(system.A), np.asarray(system.B), np.asarray(system.C)[order])


def named(kind: str) -> list[Any]:
    return [
        pytest.param(row, id=f"{row['joint']}-{row['structure']}-{k}")
        for k, row in enumerate(ROWS)
        if row["kind"] == kind
    ]


@pytest.mark.parametrize("row", named("lqr"))
def test_quadratic_gains_agree(row: dict[str, Any]) -> None:
    a, b, _ = matrices(row)
    b, expected = b[:, :1], np.array(row["K"])
    p = solve_continuous_are(a, b, np.diag(row["Q"]), np.array([[row["R"]]]))
    found = (b.T @ p / row["R"])[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def filter_gain(row: dict[str, Any], dt: float) -> Any:
    """Return the gain of our filter per second, for the states of the continuous design."""
    joint = load_joint(row["joint"], row["structure"], effects={})
    model, outputs = SampledJoint(joint, dt), np.atleast_1d(row["outputs"]) - 1
    names, noise = tuple(OUTPUTS[k] for k in outputs), float(np.sqrt(row["var_u"] / dt))
    design, q, _ = noise_model(model, noise, 0.0, names)
    gain = steady_gain(design, q, np.diag(np.atleast_1d(row["var_y"]) / dt)) / dt
    bodies = "mgl" if row["structure"] == "full_dynamics" else "ml"
    states = [f"{kind}_{body}" for kind in ("q", "dq") for body in bodies]
    return np.array([model.placed.row(name) for name in states]) @ gain


MOTOR_ALONE = [p for p in named("kalman") if p.values[0]["inputs"] == 1]


@pytest.mark.parametrize("row", MOTOR_ALONE)
def test_the_kalman_filter_tends_to_the_continuous_one(row: dict[str, Any]) -> None:
    expected = np.array(row["L"]).reshape(-1, np.atleast_1d(row["outputs"]).size)
    one, half = filter_gain(row, 1e-7), filter_gain(row, 0.5e-7)
    scale = np.abs(expected).max(axis=0)
    found = 2.0 * half - one  # what is left for dt -> 0 is of second order
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=5e-5)


@pytest.mark.parametrize("row", named("kalman"))
def test_kalman_gains_agree(row: dict[str, Any]) -> None:
    a, b, c = matrices(row)
    inputs, outputs = (np.atleast_1d(row[name]) - 1 for name in ("inputs", "outputs"))
    b, c, expected = b[:, inputs], c[outputs], np.array(row["L"])
    q, r = (np.diag(np.atleast_1d(row[name])) for name in ("var_u", "var_y"))
    p = solve_continuous_are(a.T, c.T, b @ q @ b.T, r)
    found = p @ c.T @ np.linalg.inv(r)
    scale = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=1e-4)
