"""What of an error could be predicted, from what, and what then is named."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.prediction.case import Case, make_case
from cjt_gym.gap.horizons.prediction.forward import Forecast
from cjt_gym.gap.horizons.prediction.predictable import left, predictable, torques
from cjt_gym.joint import JointFile, get_structure
from tests.gap.horizons.rotor import datasheet, record, right_datasheet

KEY = ("q_m", 0.1)
SHAKEN = 0.1


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> JointFile:
    return right_datasheet(tmp_path_factory.mktemp("right") / "rotor.toml")


def case_of(noise: float) -> Case:
    return make_case([record(noise=noise)], [], datasheet(), get_structure("rigid"))


def test_a_predictable_error_is_told_from_noise() -> None:
    case = case_of(0.0)
    errors = case.all.errors(case.joint)
    nominal = predictable(case.all, errors, KEY)
    assert nominal.share > 0.6, "friction that is not modelled can be predicted"
    noise = np.random.default_rng(1).standard_normal(errors[1].shape)
    assert predictable(case.all, [noise] * len(case.all.keys), KEY).share < 0.2


def test_an_error_that_depends_on_how_the_motion_has_changed_is_predictable() -> None:
    case = case_of(0.1)
    log, group = case.all.logs[0], case.all.groups[0]
    near = round(0.01 / log.dt)
    ago = [np.clip(group.starts - k * near, 0, None) for k in (1, 2)]
    change = log.acceleration[ago[0]] - log.acceleration[ago[1]]
    errors = [np.tile(change[:, None] / np.std(change), (1, 8))] * len(case.all.keys)
    share = predictable(case.all, errors, KEY).share
    assert share > 0.75


def test_an_error_by_a_torque_that_bends_with_the_input_is_predictable() -> None:
    """A motor that saturates lacks torque in proportion to the cube of its current."""
    case = case_of(0.1)
    log, group = case.all.logs[0], case.all.groups_of(KEY)[0]
    last = int(group.points(KEY[1], log.dt)[-1])
    inside = log.command[group.starts[:, None] + np.arange(last + 1)]
    lacking = np.mean(inside**3 * np.linspace(1.0, 0.0, last + 1), axis=1)
    error = np.tile((lacking / np.std(lacking))[:, None], (1, 8))
    errors = [error + np.random.default_rng(0).normal(0.0, 0.1, error.shape)] * len(case.all.keys)
    shapes = torques(case.all, {0: Forecast(case.joint, log)}, KEY)
    assert predictable(case.all, errors, KEY, shapes=shapes).share > 0.8
    noise = [np.random.default_rng(1).standard_normal(error.shape)] * len(case.all.keys)
    assert predictable(case.all, noise, KEY, shapes=shapes).share < 0.2


@pytest.mark.parametrize(("shaken", "noise"), [(SHAKEN, 0.0), (0.0, 0.1)])
def test_errors_tell_a_torque_that_lasts_from_noise_of_the_input(
    right: JointFile, shaken: float, noise: float
) -> None:
    case = make_case([record(shaken=shaken, noise=noise)], [], right, get_structure("rigid"))
    one = left(case.all, case.joint, past=True)[KEY]
    assert (one.share > 0.7 and one.lasting) == bool(shaken)
    assert (one.share < 0.3) == bool(noise)
    assert left(case.all, case.joint)[KEY].share < 0.3, "state and input do not show it"


@pytest.mark.slow
@pytest.mark.parametrize("shaken", [0.0, SHAKEN])
def test_a_right_datasheet_has_a_gap_where_something_else_moves_the_joint(
    right: JointFile, shaken: float
) -> None:
    found = diagnose(record(shaken=shaken), right, "rigid")
    assert (found.verdict == "no_gap") == (not shaken)
    assert ("external torque" in found.unexplained.text) == bool(shaken)
    causes = [e.name for e in found.effects if e.stage != "sensing"]
    assert not causes


@pytest.mark.slow
def test_a_wave_over_the_angle_is_confirmed_with_its_height(right: JointFile) -> None:
    found = diagnose(record(cogged=0.06), right, "rigid")
    (wave,) = (e for e in found.effects if e.stage != "sensing")
    assert (wave.name, wave.status) == ("cogging", "confirmed")
    f, a, b = (wave.parameters[s].value for s in "fab")
    assert f == pytest.approx(14.0, rel=0.01)
    assert np.hypot(a, b) == pytest.approx(0.06, rel=0.1)
    assert wave.gap_removed > 0.5
