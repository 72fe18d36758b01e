"""What drives a joint between the rows of a log."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.findings.found_joint import found_at
from cjt_gym.gap.horizons.fitting.base_terms import base_terms
from cjt_gym.gap.horizons.fitting.fit import Problem
from cjt_gym.gap.horizons.fitting.input_instants import lateness
from cjt_gym.gap.horizons.fitting.terms import scales_of
from cjt_gym.gap.horizons.prediction.case import by_angle, late, make_case
from cjt_gym.gap.horizons.prediction.forward import CHANNELS, Forecast
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.horizons.prediction.windows import relative
from cjt_gym.gap.horizons.selection.judgement import Judgement
from cjt_gym.joint import get_structure
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.joint import Joint
from cjt_gym.records import Record
from tests.gap.horizons.rotor import DRY, DT, INERTIA, datasheet, record

SWAY = 2.0 * np.pi * 2.0


@pytest.mark.parametrize(("dt", "limit"), [(0.02, 0.02), (5e-4, 1e-3)])  # these are thinned
@pytest.mark.parametrize("driving", ["i", "tau_l"])
def test_what_was_measured_rises_from_row_to_row(dt: float, limit: float, driving: str) -> None:
    t = dt * np.arange(round(4.0 / dt))
    torque = np.sin(SWAY * t)
    speed = (1.0 - np.cos(SWAY * t)) / (INERTIA * SWAY)
    angle = (t - np.sin(SWAY * t) / SWAY) / (INERTIA * SWAY)
    columns = {"t": t, "q_m": angle, "dq_m": speed, "i": np.zeros(len(t)), driving: torque}
    units = {"t": "s", "q_m": "rad", "dq_m": "rad/s", "i": "A"}
    units |= {"tau_l": "N m"} if driving == "tau_l" else {}
    case = make_case(
        [Record(columns, units, structure="rigid")], [], datasheet(1.0), get_structure("rigid")
    )
    (log,) = case.logs
    starts = np.arange(20, len(log) - round(0.4 / log.dt), 7)
    count = round(0.4 / log.dt)
    lengths, leads = np.full(len(starts), count), np.zeros(len(starts), dtype=np.int64)
    found = Forecast(case.joint, log).windows(starts, lengths, leads)[..., CHANNELS["q_m"]]
    rows = starts[:, None] + np.arange(count)
    true, first = log.measured["q_m"][rows], starts[:, None]
    straight = log.states[first, 0] + log.speed[first] * log.dt * np.arange(count)
    error = np.std(found - true) / np.std(true - straight)
    assert error < limit


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_the_motion_tells_which_current_a_log_writes(share: float) -> None:
    """The current of a row is the one from then on, or the mean of two rows."""
    made = record(dry=0.0)
    before = np.concatenate([made["i"][:1], made["i"][:-1]])
    told = made.with_columns({"i": (1.0 - share) * made["i"] + share * before})
    case = make_case([told], [], datasheet(), get_structure("rigid"))
    scales = scales_of(case.joint, case.logs)
    fit = Problem(case.fit).fit(Model(case.joint, base_terms(case.joint, scales)))
    assert lateness(case, fit) == 0.5 - share


def test_a_current_that_reaches_the_log_late_is_no_delay_of_the_drive() -> None:
    made = record()
    late = np.concatenate([np.full(2, made["i"][0]), made["i"][:-2]])
    columns = {"t": made.t, "q_m": made["q_m"], "i_cmd": made["i"], "i": late}
    units = {"t": "s", "q_m": "rad", "i_cmd": "A", "i": "A"}
    found = diagnose(Record(columns, units), datasheet(1.0, 0.05), "rigid")
    named = {e.name: e for e in found.effects}
    assert "command_delay" not in named
    dry = named["coulomb"].parameters["d_cm"]
    assert dry.low < DRY < dry.high
    assert "samples_late = 2" in found.unexplained.text


def test_a_joint_says_how_the_current_was_taken_that_it_was_found_from() -> None:
    case = make_case([record()], [], datasheet(), get_structure("rigid"))
    for rows, share in ((0.0, 0.5), (-1.5, 2.0)):
        found = found_at(Judgement(late(case, rows), "found", case.joint, ()))
        assert found["input"] == {"share": share, "load_share": 0.0, "dt": DT}
    assert "input" not in found_at(Judgement(late(case, 0.5), "found", case.joint, ()))


def test_bristles_predict_less_where_nobody_knows_how_they_were_bent() -> None:
    bent = {"presliding": {"d_cm": 0.2, "sigma_m": 10.0}}
    file, shape = datasheet(1.0), get_structure("rigid")
    joint = Joint(file, "rigid", "current", resolve_effects(bent, file, shape, "current"))
    t = 2e-3 * np.arange(4000)
    made = joint.simulate(0.3 * np.sin(6.0 * t) + 0.15 * np.sin(16.0 * t), dt=2e-3)
    units = {"t": "s", "q_m": "rad", "i": "A"}
    told = Record({name: made[name] for name in units}, units, structure="rigid")
    case = make_case([told], [], file, shape)
    both = case.test, case.test.alone()
    known, unknown = (relative(w, w.errors(joint))["q_m", 0.1] for w in both)
    assert 2.0 * known < unknown


def test_predictions_can_start_from_the_slope_of_the_angle() -> None:
    """Regressions keep the measured speed; errors are relative to motion at the slope's speed."""
    made = record()
    speed = np.gradient(made["q_m"], made.t)
    noisy = made["q_m"] + 1e-3 * np.random.default_rng(1).standard_normal(len(speed))
    told = Record(
        {**{c: made[c] for c in made.columns}, "q_m": noisy, "dq_m": speed},
        {**made.units, "dq_m": "rad/s"},
        structure="rigid",
    )
    case = make_case([told], [], datasheet(), get_structure("rigid"))
    (before,) = case.logs
    assert before.with_speed
    sloped = by_angle(case)
    (after,) = sloped.logs
    assert after.speed == pytest.approx(before.speed)
    assert np.std(after.first[:, 3] - before.first[:, 3]) > 0.02
    moved = dict(zip(sloped.test.keys, sloped.test.scales / case.test.scales, strict=True))
    assert moved["q_m", 0.02] > 1.02


def test_a_velocity_that_a_filter_makes_late_is_put_in_time() -> None:
    made, late = record(dry=0.0), 6
    speed = np.gradient(made["q_m"], made.dt)
    mean = np.convolve(speed, np.full(2 * late + 1, 1.0 / (2 * late + 1)))[: len(speed)]
    told = Record(
        {**made.columns, "dq_m": mean}, {**made.units, "dq_m": "rad/s"}, structure="rigid"
    )
    (log,) = make_case([told], [], datasheet(), get_structure("rigid")).logs
    inside = slice(50, -50)
    assert np.std(log.speed[inside] - speed[inside]) < 0.3 * np.std((mean - speed)[inside])
