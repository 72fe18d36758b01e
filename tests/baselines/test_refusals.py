"""What theory does not allow is refused with the reason; see also the tests of the observers."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from cjt_gym import load_joint
from cjt_gym.baselines import default_gains, make_controller
from cjt_gym.baselines.linear_law import assemble
from cjt_gym.baselines.pbh import check_stabilisable
from cjt_gym.baselines.pid import pid
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.rational import Rational, inverse_times, low_pass
from cjt_gym.baselines.robust import best_gains
from cjt_gym.errors import ConfigurationError

DT = 1e-3


def test_a_mode_that_the_motor_does_not_move_is_named() -> None:
    a, b = np.diag([-1.0, 0.0, -3.0]), np.array([[1.0], [0.0], [2.0]])
    with pytest.raises(
        ConfigurationError, match=r"load is not stabilisable: .* not move the mode 0 1/s"
    ):
        check_stabilisable(a, b, "load")
    check_stabilisable(np.diag([-1.0, -2.0, 0.0]), np.array([[1.0], [0.0], [2.0]]), "load")


def test_what_has_no_stable_inverse_is_not_inverted() -> None:
    poles = np.array([-10.0, -20.0, -30.0], complex)
    ahead = Rational(np.array([5.0 + 0j]), poles, 1.0)
    with pytest.raises(
        ConfigurationError, match=r"x cannot be inverted: it has zeros, 5 1/s, that"
    ):
        inverse_times(ahead, low_pass(2, 10.0), "x")
    with pytest.raises(ConfigurationError, match="must have at least order 3, got 2"):
        inverse_times(Rational(np.zeros(0, complex), poles, 1.0), low_pass(2, 10.0), "x")


def test_gains_of_which_none_is_robust_are_refused() -> None:
    model = SampledJoint(load_joint("orange_80_6000", "output_fixed", effects={}), DT)
    with pytest.raises(ConfigurationError, match="No default gains keep the loop of orange_80"):
        best_gains(
            model, lambda g: assemble(DT, pid(g["kp"], 0.0, 0.0, DT, 0.0, 1.0)), [{"kp": 9.0}]
        )


def test_a_library_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects={})
    with pytest.raises(ConfigurationError, match=r'mpc needs osqp: pip install "cjt-gym\[control'):
        make_controller("mpc", joint, DT, {"effort": 1.0, "drift": 1.0})


@pytest.mark.parametrize("name", ["disturbance_rejection", "extended_dob+reference"])
def test_gains_for_which_no_law_can_be_made_are_no_candidates(name: str) -> None:
    """Slow observers of a joint with modes that die within a sample cannot be placed."""
    joint = load_joint("lime_50_21000", "output_fixed", effects={})
    with pytest.raises(ConfigurationError, match="Poles of the Luenberger observer"):
        make_controller(name, joint, DT, default_gains(name, joint, DT) | {"observer_hz": 0.2})
