"""A joint that rings on its spring, of which command and motor angle alone are recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from cjt_gym.gap import diagnose
from cjt_gym.gap.diagnosis import Diagnosis
from cjt_gym.joint import JointFile
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record

INERTIA, STIFFNESS, DAMPING, GAIN = 0.2, 3e4, 1.0, 3.0  # 62 Hz
LAG = 1.6e-4
NOISE, STEP, DT = 3e-7, 1e-6, 1e-3


def record(seconds: float, seed: int) -> Record:
    """Return a record of the joint, exact between the samples: command, lag, rotor and spring."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds / DT)) * DT
    chirp = 10.0 * np.sin(2.0 * np.pi * (2.0 + 0.5 * 100.0 / seconds * t) * t)
    command = np.where(
        t < 0.6 * seconds, chirp, rng.uniform(-8.0, 8.0, len(t))[(20 * t).astype(int)]
    )
    a = np.zeros((4, 4))  # angle, speed, current, command
    a[0, 1] = 1.0
    a[1] = [-STIFFNESS / INERTIA, -DAMPING / INERTIA, GAIN / INERTIA, 0.0]
    a[2, 2:] = -1.0 / LAG, 1.0 / LAG
    step, state, q_m = expm(a * DT), np.zeros(4), np.zeros(len(t))
    for k, wanted in enumerate(command):
        state[3] = wanted
        q_m[k] = state[0]
        state = step @ state
    q_m = STEP * np.round((q_m + NOISE * rng.standard_normal(len(t))) / STEP)
    return Record(
        {"i_cmd": command, "q_m": q_m},
        {"i_cmd": "A", "q_m": "rad"},
        dt=DT, structure="output_fixed_rigid_gearbox",
    )  # fmt: skip


def datasheet(guessed: float = 1.0) -> JointFile:
    """Return the joint's file, with an inertia that is guessed if it is not the true one."""
    values = {"I_m": INERTIA, "d_m": DAMPING, "k_b": STIFFNESS, "k_t": GAIN / 100.0, "n": 100.0}
    parameters = JointParameters.from_values("ringing", values)
    if guessed != 1.0:
        wrong = Quantity(guessed * INERTIA, "kg m^2", "guess", guess=True)
        parameters = parameters.replace(I_m=wrong)
    sensor = {"noise": Quantity(NOISE, "rad"), "resolution": Quantity(STEP, "rad")}
    lag = {"bandwidth": Quantity(1.0 / (2.0 * np.pi * LAG), "Hz")}
    return JointFile(parameters, effects={"current_lag": lag}, sensors={"q_m": sensor})


def told(file: JointFile) -> Diagnosis:
    """Return what is told of the joint."""
    seen, unseen = (replace(record(3.0, seed), joint=file) for seed in (0, 1))
    return diagnose([seen], validate=[unseen])


@pytest.fixture(scope="module")
def exact() -> Diagnosis:
    """Return what is told of the joint where its file is right."""
    return told(datasheet())


def test_its_motion_between_samples_is_no_gap(exact: Diagnosis) -> None:
    """A lag of a sixth of a sample acts, and a slope over four samples is not the speed."""
    assert exact.verdict == "no_gap"
    assert exact.gap.before < 2.0 * exact.gap.floor
    assert exact.stages["motor"].before < 1.5


@pytest.mark.slow
def test_a_guess_of_its_inertia_does_not_blur_the_states_that_it_starts_from(
    exact: Diagnosis,
) -> None:
    seen = told(datasheet(guessed=0.36))
    assert seen.effects == ()
    (first, wanted) = (
        next(row for row in one.horizons if row.seconds == 0.02) for one in (seen, exact)
    )
    assert first.datasheet > 5.0 * first.found
    assert first.found < 1.2 * wanted.found
