"""What happens between two samples: rising torques, teeth that part, ripple, rounded commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cjt_gym.gap.recorded.fields import NEUTRAL
from cjt_gym.gap.recorded.missing import same_here, undecided
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.gap.recorded.signals import MEAN, _rising, periodic_torque, within
from cjt_gym.gap.stages.chain import MOTOR, build_chain
from cjt_gym.gap.stages.cut import Stages, passed_on
from cjt_gym.gap.stages.kernel import pushing
from cjt_gym.gap.stages.periodic import command_steps
from cjt_gym.joint import get_structure
from tests.gap.simulator import nominal, simulate

FIXED, DT = "output_fixed_rigid_gearbox", 1e-3


def test_a_rising_torque_moves_a_body_as_its_integral_does() -> None:
    chain = build_chain((0, 0, -1), (0.03, 0.01, 0.0), (0.4, 0.0, 0.0), (), DT)
    t = np.arange(60) * DT
    torque = 3.0 * np.sin(2.0 * np.pi * 40.0 * t)
    x = np.zeros(2)
    for added in passed_on(chain, MOTOR, torque)[5:55]:  # the first and last have no neighbours
        x = chain.a @ x + added

    def flow(time: float, y: np.ndarray) -> list[float]:
        push = 3.0 * np.sin(2.0 * np.pi * 40.0 * time)
        return [y[1], (push - 0.4 * y[1]) / 0.04]

    exact = solve_ivp(flow, (5 * DT, 55 * DT), [0.0, 0.0], rtol=1e-10, atol=1e-14).y[:, -1]
    assert x == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("lag", [0.05, 0.2, 1.0])
def test_a_lagging_current_rises_like_its_first_moment(lag: float) -> None:
    s = np.linspace(0.0, 1.0, 200_001)
    current = 1.0 - np.exp(-s / lag)
    moment = np.trapezoid((s - 0.5) * current, s)
    assert _rising(lag) == pytest.approx(12.0 * moment / current[-1], rel=1e-6)


def test_a_current_that_follows_at_once_does_not_rise() -> None:
    assert _rising(0.0) == 0.0
    assert _rising(1e3) == 1.0


def test_ripple_that_is_passed_within_few_samples_has_its_true_mean() -> None:
    t = np.arange(400) * DT
    speed, f = 2.0, 1200.0  # 2.4 rad of the wave per sample
    fields = dict(NEUTRAL) | {"cog_f": f, "cog_a": 1.0}
    mean = MEAN @ periodic_torque(fields, within(speed * t), np.zeros(1))
    exact = (np.sin(f * speed * (t + DT)) - np.sin(f * speed * t)) / (f * speed * DT)
    assert mean[5:-5] == pytest.approx(exact[5:-5], abs=2e-3)


def test_teeth_push_as_long_as_spring_and_damper_do() -> None:
    half = 1e-3
    assert pushing(2e-3, 1.5e-3, 5.0, 1.0, half) == 1.0
    # A damper that holds the parting teeth would pull: they part where the torque is zero.
    assert pushing(2e-3, 1.5e-3, 3.0, -1.0, half) == pytest.approx(0.75)
    assert pushing(2e-3, 1.9e-3, -1.0, -2.0, half) == 0.0
    # They meet where the gap closes.
    assert pushing(0.0, 2e-3, 0.0, 0.0, half) == pytest.approx(0.5)
    assert pushing(0.0, 0.5e-3, 0.0, 0.0, half) == 0.0


def test_the_resolution_of_a_command_is_read_off_the_drives_error() -> None:
    record = simulate(drive=lambda wanted: 0.13 * np.round(wanted / 0.13))
    setting = make_setting(record, nominal(), get_structure(FIXED))
    found = [step for (step,) in command_steps(Stages(setting), setting.nominal)]
    assert found[0] == pytest.approx(0.13, rel=2e-3)


def test_a_locked_output_that_does_not_move_has_no_noise() -> None:
    record = simulate()
    rng = np.random.default_rng(2)
    noise = make_setting(record, nominal(), get_structure(FIXED)).noise["q_l"].specified
    still = noise * rng.standard_normal(len(record))
    yielding = still + 0.1 * noise * record["tau"]
    settings = [
        make_setting(
            replace(record, columns={**record.columns, "q_l": angle}),
            nominal(),
            get_structure(FIXED),
        )
        for angle in (still, yielding)
    ]
    assert np.ptp(settings[0].series["q_l"]) == 0.0
    assert np.ptp(settings[1].series["q_l"]) > 0.0


def test_an_offset_of_torque_or_sensor_is_undecided_with_a_locked_output() -> None:
    setting = make_setting(simulate(), nominal(), get_structure(FIXED))
    assert same_here(setting, "torque_bias") == ("torque_offset",)
    assert undecided(setting, "torque_offset")
    assert not undecided(setting, "coulomb")
