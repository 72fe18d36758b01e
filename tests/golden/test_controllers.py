"""Laws and observers against the toolbox's blocks, run open loop over 400 samples.

Where the toolbox is right: the PID block with its three choices of what is added to it, integral
control with feed-forward, the passivity-based law, the momentum observer, the filter that inverts
the joint in a disturbance observer, and the closed loop that an outer one inverts.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym import load_joint
from cjt_gym.baselines import PdFeedForward, make_controller
from cjt_gym.baselines.linear_law import LinearController, LinearLaw, assemble, static
from cjt_gym.baselines.observers import momentum_observer
from cjt_gym.baselines.pid import pid
from cjt_gym.baselines.pid_outer_dob import closed_plant
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.rational import inverse_times, low_pass, tustin
from cjt_gym.baselines.robust import is_stable
from cjt_gym.plant import Measurement

Floats = NDArray[np.float64]
VECTORS = np.load(Path(__file__).parent / "controllers.npz")
DT = 1e-3
MODEL = SampledJoint(load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects={}), DT)
PIDS = {
    "pid1": (0.3, 2.0, 0.005, "reference", True),
    "pid2": (2.0, 0.0, 0.01, "tau", True),
    "pid3": (0.5, 1.0, 0.001, None, False),
}


def measurement(k: int | None) -> Measurement:
    """Sample k of the test vectors, or a joint at rest before them."""
    names = ("t", "i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
    source = {"tau": "tau", "dq_m": "dq_g", "dq_g": "dq_g", "dq_l": "dq_l"}
    values = {name: np.zeros(1) for name in names}
    if k is not None:
        values |= {name: VECTORS[key][k : k + 1] for name, key in source.items()}
    return Measurement(**values)


def run(law: LinearLaw) -> Floats:
    controller = LinearController(law)
    controller.act(measurement(None), np.zeros(1))  # the toolbox's filters start at zero
    r = VECTORS["r"]
    return np.array([controller.act(measurement(k), r[k : k + 1])[0] for k in range(len(r))])


def linear(name: str, **gains: float) -> LinearLaw:
    law = make_controller(name, MODEL.joint, DT, gains).linear
    assert law is not None
    return law


def same(found: Floats, expected: Floats) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("case", PIDS)
def test_pid_agrees_with_the_toolbox(case: str) -> None:
    kp, ki, kd, added, lead = PIDS[case]
    more = [static(**{added: 1.0})] if added else []
    same(run(assemble(DT, pid(kp, ki, kd, DT, lead), *more)), VECTORS[case])


def test_pd_with_feedforward_agrees_with_the_toolbox() -> None:
    kp, ki, kd, _, _ = PIDS["pid1"]
    r, tau = VECTORS["r"], VECTORS["tau"]
    law = PdFeedForward(kp, kd, DT, cutoff_hz=200.0)
    law.act(measurement(None), np.zeros(1))
    u = np.array([law.act(measurement(k), r[k : k + 1])[0] for k in range(len(r))])
    integral = np.concatenate([[0.0], np.cumsum(DT * ki * (r - tau))[:-1]])
    same(u + integral, VECTORS["pid1"])


def test_integral_with_feedforward_agrees_with_the_toolbox() -> None:
    same(run(linear("integral_feedforward", ki=10.0)), VECTORS["iff"])


def test_passivity_based_control_agrees_with_the_toolbox() -> None:
    """B / B_d = 4 and D_s = 25 N m s/rad; this joint has no damper beside its spring."""
    same(run(linear("passivity", shaping=4.0, damping=25.0)), VECTORS["passivity"])


def test_the_momentum_observer_agrees_with_the_toolbox() -> None:
    """The toolbox's forward Euler with L = 2 pi 25 has the pole of a slightly faster observer."""
    gain = 2.0 * math.pi * 25.0
    bandwidth = -math.log(1.0 - gain * DT) / (2.0 * math.pi * DT)
    observer = momentum_observer(MODEL, bandwidth)
    observer.step(measurement(None), np.zeros(1), np.ones(1, dtype=np.bool_))
    nobody, found, sent = np.zeros(1, dtype=np.bool_), [], np.zeros(1)
    for k in range(len(VECTORS["gm"])):
        found.append(observer.step(measurement(k), sent, nobody)["disturbance"][0])
        sent = VECTORS["gm_u"][k : k + 1]
    same(np.array(found), VECTORS["gm"])


def test_two_of_the_toolboxs_examples_are_unstable_without_dry_friction() -> None:
    """Example 3 integrates with 10 1/s, Example 10 observes with 25 Hz; less is stable."""
    laws = [linear("integral_feedforward", ki=ki) for ki in (10.0, 5.0)]
    laws += [linear("momentum_dob", bandwidth_hz=hz) for hz in (25.0, 5.0)]
    found = [is_stable(MODEL.loop, law) for law in laws]
    assert found == [False, True, False, True]


def test_the_inverse_of_the_joint_agrees_with_the_toolbox() -> None:
    """P^-1 Q at 80 Hz by the bilinear rule; the toolbox's own Q has another gain at rest."""
    a, b, c, d = tustin(inverse_times(MODEL.torque, low_pass(2, 80.0), "joint"), DT)
    z = np.exp(2j * math.pi * DT * np.geomspace(0.1, 490.0, 60))
    found = [c @ np.linalg.solve(one * np.eye(len(b)) - a, b) + d for one in z]
    expected = np.polyval(VECTORS["dob_num"], z) / np.polyval(VECTORS["dob_den"], z)
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_the_loop_inside_an_outer_observer_agrees_with_the_toolbox() -> None:
    loop = closed_plant(MODEL, 0.1, 0.001)
    s = 2j * math.pi * np.geomspace(0.1, 500.0, 60)
    found = [loop.gain * np.prod(one - loop.zeros) / np.prod(one - loop.poles) for one in s]
    expected = np.polyval(VECTORS["loop_num"], s) / np.polyval(VECTORS["loop_den"], s)
    np.testing.assert_allclose(found, expected, rtol=1e-8)
