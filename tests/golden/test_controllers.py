"""PD with feed-forward against the toolbox's PID block, run open loop over 400 samples.

The block has an integral part and a choice of what is added to the PID; both are put around our
law here: u = o + PD(e) + I with I[k+1] = I[k] + Ts Ki e[k] and o = r, tau or nothing.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym.baselines import PdFeedForward
from cjt_gym.plant import Measurement

VECTORS = np.load(Path(__file__).parent / "controllers.npz")
CASES = {
    "pid1": (0.3, 2.0, 0.005, "reference", "error"),
    "pid2": (2.0, 0.0, 0.01, "torque", "error"),
    "pid3": (0.5, 1.0, 0.001, "nothing", "output"),
}
DT = 1e-3


def measurement(tau: NDArray[np.float64]) -> Measurement:
    zero = np.zeros_like(tau)
    return Measurement(zero, zero, zero, zero, zero, zero, zero, zero, tau)


@pytest.mark.parametrize("case", CASES)
def test_the_law_agrees_with_the_toolbox(case: str) -> None:
    kp, ki, kd, forward, derivative = CASES[case]
    r, tau = VECTORS["r"], VECTORS["tau"]
    law = PdFeedForward(kp, kd, DT, derivative=derivative, cutoff_hz=200.0)
    law.act(measurement(np.zeros(1)), np.zeros(1))  # the toolbox's filters start at zero
    u = np.array([law.act(measurement(tau[k : k + 1]), r[k : k + 1])[0] for k in range(len(r))])
    integral = np.concatenate([[0.0], np.cumsum(DT * ki * (r - tau))[:-1]])
    added = {"reference": r, "torque": tau, "nothing": 0.0 * r}[forward]
    expected = VECTORS[case]
    np.testing.assert_allclose(
        u - r + added + integral, expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )
