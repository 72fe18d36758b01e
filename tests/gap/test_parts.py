"""The parts of the diagnosis: friction in the predictor, noise, memory, frames, matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from cjt_gym.errors import RecordError
from cjt_gym.gap.candidates.table import all_candidates
from cjt_gym.gap.diagnosis import Interval
from cjt_gym.gap.judged.naming import _sensor_row
from cjt_gym.gap.judged.replay import Written, replay
from cjt_gym.gap.recorded.fields import LAW_SIZE, NEUTRAL, friction_law
from cjt_gym.gap.recorded.noise import high_frequency_std, lattice_step, observed_jitter
from cjt_gym.gap.recorded.series import to_series
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.gap.recorded.signals import shifted, smooth_mean
from cjt_gym.gap.stages import prune
from cjt_gym.gap.stages.chain import GEAR, LOAD, MOTOR, Link, build_chain, kalman_gain
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.fit import Model, Problem
from cjt_gym.gap.stages.intervals import is_open
from cjt_gym.gap.stages.kernel import friction_torque
from cjt_gym.gap.stages.periodic import periodic_starts
from cjt_gym.gap.stages.predictor import start_shapes
from cjt_gym.gap.stages.sensing import SensorFinding, sensor_findings
from cjt_gym.gap.stages.spring import slip, spring_torque
from cjt_gym.joint import get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import Record
from tests.gap.simulator import TRUE, nominal, simulate

FIXED = "output_fixed_rigid_gearbox"
GAIN, STEP = 1e-3 / 0.3, 1e-3


def law(**values: float) -> np.ndarray:
    fields = dict(NEUTRAL) | {f"{name}_m": value for name, value in values.items()}
    return friction_law(fields, "m")


def step(rule: np.ndarray, start: float, free: float, bristle: float = 0.0) -> float:
    torque, _, _ = friction_torque(rule, start, free, GAIN, 0.0, STEP, bristle)
    return free + GAIN * torque


def problem_of(record: Record) -> Problem:
    return Problem.of(Stages(make_setting(record, nominal(), get_structure(FIXED))))


def test_a_law_has_a_column_for_every_field() -> None:
    assert law().shape == (LAW_SIZE,)


def test_sharp_friction_holds_a_body_exactly_at_rest() -> None:
    assert step(law(c_p=1.0, c_n=1.0), 0.0, 0.9 * GAIN) == 0.0
    assert step(law(c_p=1.0, c_n=1.0), 0.0, -0.9 * GAIN) == 0.0


def test_sharp_friction_slows_a_moving_body_by_its_level() -> None:
    assert step(law(c_p=1.0, c_n=2.0), 1.0, 1.0) == pytest.approx(1.0 - GAIN)
    assert step(law(c_p=1.0, c_n=2.0), -1.0, -1.0) == pytest.approx(-1.0 + 2.0 * GAIN)


def test_friction_turns_round_with_the_body_within_a_sample() -> None:
    start, push = 2e-3, -8e-3  # without friction it would end at -6e-3
    level = 0.5 * GAIN
    share = start / (-push + level)
    expected = -(-push - level) * (1.0 - share)
    assert step(law(c_p=0.5, c_n=0.5), start, start + push) == pytest.approx(expected, rel=1e-9)


def test_breakaway_lies_above_the_level_in_motion() -> None:
    rule = law(c_p=1.0, c_n=1.0, s_p=0.5, s_n=0.5, v_s=0.01)
    assert step(rule, 0.0, 1.4 * GAIN) == 0.0
    assert step(rule, 1.0, 1.0) == pytest.approx(1.0 - GAIN, rel=1e-6)


def test_presliding_springs_back_and_ends_at_coulombs_level() -> None:
    rule, bristle, v = law(c_p=1.0, c_n=1.0, z_s=1e-4), 0.0, 0.1
    for _ in range(200):
        torque, bristle, _ = friction_torque(rule, v, v, GAIN, 0.0, STEP, bristle)
    assert -torque == pytest.approx(1.0, rel=0.02)
    assert step(rule, 0.0, 0.0, bristle) < 0.0


def test_smooth_friction_creeps_where_sharp_friction_holds() -> None:
    held = step(law(c_p=1.0, c_n=1.0, dq_0=0.002), 0.0, 0.5 * GAIN)
    assert 0.0 < held < 0.5 * GAIN


@pytest.mark.parametrize(
    ("factor", "jitter", "named"), [(12.0, 0.0, True), (3.0, 0.0, False), (12.0, 0.1, False)]
)
def test_loud_white_noise_needs_no_stage_that_shows_it(
    factor: float, jitter: float, named: bool
) -> None:
    setting = make_setting(simulate(), nominal(), get_structure(FIXED))
    known, dt = setting.noise["q_m"], setting.series.dt
    noise = {
        name: replace(one, observed=one.specified, white=True)
        for name, one in setting.noise.items()
    }
    loud = replace(
        known, stated=True, white=True, observed=factor * known.specified, jitter=jitter * dt
    )
    found = sensor_findings(replace(setting, noise={**noise, "q_m": loud}), {})
    assert [(one.name, one.channel) for one in found] == [("noise", "q_m")] * named


def test_a_chain_matches_the_matrix_exponential_of_a_hand_written_one() -> None:
    chain = build_chain(
        (0, 1, -1), (0.2, 0.1, 0.0), (0.5, 1.0, 0.0), (Link(0, 1, 9e3, 50.0),), 1e-3
    )
    a = np.array(
        [
            [0, 0, 1, 0],
            [0, 0, 0, 1],
            [-9e3 / 0.2, 9e3 / 0.2, -50.5 / 0.2, 50 / 0.2],
            [9e3 / 0.1, -9e3 / 0.1, 50 / 0.1, -51 / 0.1],
        ]
    )
    assert chain.a == pytest.approx(expm(a * 1e-3), rel=1e-9, abs=1e-12)
    assert not chain.torque[:, LOAD].any()
    assert chain.torque[chain.velocity(MOTOR), MOTOR] > chain.torque[chain.velocity(GEAR), MOTOR]


def test_the_gain_makes_the_predictor_stable() -> None:
    chain = build_chain((0, 0, -1), (0.2, 0.1, 0.0), (0.5, 1.0, 0.0), (), 1e-3)
    k = kalman_gain(chain, (0,), (0.1, 0.1, 0.0), (2e-6,))
    closed = chain.a @ (np.eye(2) - k @ np.array([[1.0, 0.0]]))
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0


def test_a_wrong_first_state_leaves_no_residual() -> None:
    """Here the predictor needs 100 samples to forget it; one sample in ten was not measured."""
    chain = build_chain((0, 0, -1), (0.2, 0.1, 0.0), (0.5, 1.0, 0.0), (), 1e-3)
    k = kalman_gain(chain, (0,), (0.01, 0.0, 0.0), (2e-6,)).ravel()
    valid, scatter = np.arange(4000) % 10 != 3, np.linspace(1e-6, 3e-6, 4000)
    start = start_shapes(chain, k, scatter, valid)
    x, residual = np.array([1e-5, 2e-3]), np.zeros(4000)
    for row in range(4000):
        residual[row] = x[0] / scatter[row] * valid[row]
        x = chain.a @ (x - k * x[0] * valid[row])
    first = residual[: len(start)]
    left = first - start @ (start.T @ first)
    assert np.abs(first).max() > 10.0
    assert np.abs(left).max() < 1e-6
    assert np.abs(residual[len(start) :]).max() < 1e-3


def test_noise_is_read_under_a_moving_signal() -> None:
    t = np.arange(8000) * 1e-3
    x = 5.0 * np.sin(2 * np.pi * 3.0 * t) + 0.02 * np.random.default_rng(0).standard_normal(8000)
    good = np.ones(8000, dtype=bool)
    assert high_frequency_std(x, good, 1e-6 * np.abs(np.gradient(x, t))) == pytest.approx(
        0.02, rel=0.15
    )


def test_jitter_is_read_off_the_slope() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(20000) * 1e-3
    clean = np.sin(2 * np.pi * 2.0 * t)
    speed = 2 * np.pi * 2.0 * np.cos(2 * np.pi * 2.0 * t)
    x = clean + speed * 1e-5 * rng.standard_normal(len(t)) + 1e-6 * rng.standard_normal(len(t))
    good = np.ones(len(t), dtype=bool)
    assert observed_jitter(x, good, speed, 1e-3) == pytest.approx(1e-5, rel=0.2)


def test_the_lattice_of_a_coarse_channel_is_found() -> None:
    x = np.cumsum(np.random.default_rng(0).standard_normal(4000)) * 1e-3
    assert lattice_step(2.5e-3 * np.round(x / 2.5e-3)) == pytest.approx(2.5e-3, rel=1e-6)
    assert lattice_step(x) == 0.0


def test_the_lattice_of_a_fast_joint_is_found_where_few_values_are_a_step_apart() -> None:
    """Nearly all distances are long, and every long distance is nearly a multiple of anything."""
    t = np.arange(8000) * 1e-3
    x = 2.0 * np.sin(2.0 * np.pi * 0.8 * t) + 1.5 * np.sin(2.0 * np.pi * 1.37 * t)
    for step in (1e-5, 4e-5):
        counts = np.diff(np.unique(np.round(x / step)))
        assert np.mean(counts == 1.0) < 0.5
        assert lattice_step(step * np.round(x / step)) == pytest.approx(step, rel=1e-6)
    assert lattice_step(x + 1e-7 * np.random.default_rng(1).standard_normal(len(x))) == 0.0


def test_a_shaft_that_turns_at_one_speed_shows_no_lattice() -> None:
    rng = np.random.default_rng(0)
    speed = 338.0 * (1.0 + 0.005 * rng.standard_normal(4000))
    assert lattice_step(np.cumsum(speed) * 1e-3) == 0.0
    assert lattice_step(0.01 * np.arange(4000) // 3 * 0.5) == pytest.approx(0.5), (
        "counts that repeat"
    )


def test_noise_in_the_path_does_not_wear_the_memory_of_a_spring_down() -> None:
    t = np.arange(4000) * 1e-3
    path = 2e-3 * np.sin(2 * np.pi * 1.5 * t)
    noisy = path + 7e-6 * np.random.default_rng(0).standard_normal(len(t))
    fields = dict(NEUTRAL) | {"k_b": 0.0, "d_gl": 0.0, "hyst": 1.0, "hyst_z": 5e-4}
    expected = slip(path, 5e-4, 2.0)
    assert np.std(spring_torque(fields, noisy, 1e-3) - expected) < 0.03


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0])
def test_a_hysteresis_stays_within_its_limits_and_encloses_an_area(exponent: float) -> None:
    x = 3e-3 * np.sin(np.linspace(0, 4 * np.pi, 4000))
    z = slip(x, 5e-4, exponent)
    assert np.abs(z).max() <= 1.0 + 1e-9
    assert np.trapezoid(z[2000:], x[2000:]) > 0.0


def test_a_shift_by_whole_samples_is_exact_and_by_parts_nearly() -> None:
    x = np.sin(np.arange(300) * 0.05)
    assert shifted(x, 3.0)[:250] == pytest.approx(x[3:253])
    assert shifted(x, 0.5)[5:250] == pytest.approx(
        np.sin((np.arange(5, 250) + 0.5) * 0.05), abs=1e-6
    )


def test_the_mean_over_an_interval_of_a_sine_is_its_integral() -> None:
    t = np.arange(200) * 1e-3
    w = 2 * np.pi * 40.0
    exact = (np.cos(w * t) - np.cos(w * (t + 1e-3))) / (w * 1e-3)
    assert smooth_mean(np.sin(w * t))[2:190] == pytest.approx(exact[2:190], abs=1e-4)


def test_angles_of_a_second_record_count_from_the_zeros_of_the_first() -> None:
    record = simulate(seconds=1.0)
    moved = record.with_columns({"q_m": record["q_m"] + 0.7})
    first = to_series(record, nominal(), get_structure(FIXED))
    second = to_series(moved, nominal(), get_structure(FIXED), first.zero)
    assert second["q_m"][0] - first["q_m"][0] == pytest.approx(0.7)


def test_uneven_times_are_put_on_an_even_grid() -> None:
    record = simulate(seconds=1.0)
    keep = np.ones(len(record), dtype=bool)
    keep[400:420] = False
    columns = {name: record[name][keep] for name in record.columns}
    t = (np.arange(len(record)) * 1e-3)[keep]
    uneven = Record(columns | {"t": t}, dict(record.units) | {"t": "s"}, dt=1e-3)
    series = to_series(uneven, nominal(), get_structure(FIXED))
    assert len(series) == len(record)
    assert not series.valid["q_m"][405:415].any()


def test_a_speed_with_missing_samples_stands_for_the_angle() -> None:
    record = simulate(seconds=1.0)
    speed = np.gradient(record["q_m"], 1e-3)
    speed[[300, 301, 700]] = np.nan
    columns = {"i": record["i"], "dq_m": speed}
    alone = Record(columns, {"i": "A", "dq_m": "rad/s"}, dt=1e-3, allow_nan=True)
    series = to_series(alone, nominal(), get_structure(FIXED))
    assert np.flatnonzero(~series.valid["q_m"]).tolist() == [300, 301, 700]
    travelled = record["q_m"] - record["q_m"][0]
    assert series["q_m"] == pytest.approx(travelled, abs=0.02 * np.ptp(travelled))


def test_a_record_driven_by_nothing_is_refused() -> None:
    record = simulate(seconds=1.0)
    bare = Record({"q_m": record["q_m"]}, {"q_m": "rad"}, dt=1e-3)
    with pytest.raises(RecordError, match="drives the joint"):
        to_series(bare, nominal(), get_structure(FIXED))


def test_derivatives_only_fill_the_stages_that_a_number_touches() -> None:
    problem = problem_of(simulate(seconds=1.0))
    z = np.zeros(len(problem.shared))
    residuals = problem.residuals(Model(), z)
    jacobian = problem.jacobian(Model(), z, residuals)
    for column, nuisance in enumerate(problem.shared):
        for stage in problem.stages.names:
            if stage not in nuisance.stages:
                assert not jacobian[stage][:, column].any()


@pytest.mark.parametrize(("high", "expected"), [(9.9, True), (5.0, False)])
def test_a_bandwidth_known_to_a_factor_of_ten_is_open(high: float, expected: bool) -> None:
    stages = problem_of(simulate(seconds=1.0)).stages
    rows = all_candidates(stages.setting, stages.names)
    lag = next(row for row in rows if row.name == "current_lag")
    assert is_open(lag, {"bandwidth": Interval(2.4, 0.6, high, "Hz")}) is expected


def test_a_fit_that_begins_where_a_model_runs_away_ends_there() -> None:
    problem = problem_of(simulate(seconds=1.0))
    rows = all_candidates(problem.stages.setting, problem.stages.names)
    damping = next(row for row in rows if row.name == "damping")
    free = replace(damping.unknowns[0], low=-np.inf)
    model = Model((replace(damping, unknowns=(free,)),))
    z = np.append(np.zeros(len(problem.shared)), free.coordinate(-1e6))
    with np.errstate(all="ignore"):  # as in a diagnosis
        found = problem.fit(model, z)
    assert found.cost == np.inf
    assert found.z.tolist() == z.tolist()


def waves(made: Record, kind: str) -> tuple[tuple[float, float, float], ...]:
    """Return the waves over the angle that the datasheet's joint leaves in a record."""
    problem = problem_of(made)
    base = problem.fit(Model(), np.zeros(len(problem.shared)))
    fields = problem.fields(base.model, base.z)
    residual = problem.stages.first(base.residuals)["motor"]
    return periodic_starts(problem.stages, fields, residual, kind)


def test_a_wave_of_few_periods_is_found() -> None:
    """Ripple that repeats with the angle two and a half times over the travel of a held joint."""
    still = simulate(seconds=4.0)
    f = 2.0 * np.pi * 2.4 / np.ptp(still["q_m"])
    made = simulate(seconds=4.0, extra=lambda _, q, __: -0.06 * np.cos(f * q) * TRUE["k_b"] * q)
    starts = waves(made, "rip")
    assert min(abs(start[0] / f - 1.0) for start in starts) < 0.1


def test_the_lattice_of_an_encoder_is_no_wave() -> None:
    made, step = simulate(seconds=4.0), 2e-4
    made = made.with_columns({"q_m": step * np.round(made["q_m"] / step)})
    starts = waves(made, "cog")
    assert starts
    assert max(f for f, _, _ in starts) < np.pi / step


def test_a_replay_follows_an_independent_simulation() -> None:
    record = simulate(seconds=2.0)
    setting = make_setting(record, nominal(), get_structure(FIXED))
    model = Written(dict(setting.nominal), setting.joint)
    error = replay(setting, model)["tau"] - record["tau"]
    assert np.std(error) < 0.02 * np.std(record["tau"])


def test_a_replay_begins_in_motion() -> None:
    """Two masses on a spring, cut while they move: few noisy samples tell the speeds badly."""
    rng, dt, i_m, i_l, k = np.random.default_rng(3), 1e-3, 0.3, 0.5, 6000.0
    a = np.zeros((5, 5))  # motor, load, their speeds, and the motor's torque, which is held
    a[0, 2] = a[1, 3] = 1.0
    a[2] = np.array([-k, k, -2.0, 0.0, 1.0]) / i_m
    a[3] = np.array([k, -k, 0.0, -0.5, 0.0]) / i_l
    step, x = expm(a * dt), np.zeros(5)
    turn = 2.0 * np.pi * np.arange(3000) * dt
    current = 3.0 * np.sin(1.3 * turn) + 2.0 * np.sin(7.0 * turn)
    states = np.empty((3000, 5))
    for n, amps in enumerate(current):
        x[4] = 6.4 * amps
        states[n], x = x, step @ x
    q_m, q_l = states[:, 0], states[:, 1]
    noisy = {
        "q_m": q_m + rng.normal(0.0, 5e-6, 3000),
        "q_l": q_l + rng.normal(0.0, 5e-6, 3000),
        "tau": k * (q_m - q_l) + rng.normal(0.0, 0.04, 3000),
    }
    units = {"q_m": "rad", "q_l": "rad", "tau": "N m", "i_cmd": "A"}
    record = Record({**noisy, "i_cmd": current}, units, dt=dt, structure="rigid_gearbox")
    values = {**TRUE, "I_g": 0.0, "I_l": i_l, "d_l": 0.5}
    joint = replace(nominal(), parameters=JointParameters.from_values("tested", values))
    cut = make_setting(record.slice(1230, None), joint, get_structure("rigid_gearbox"))
    relaxed = cut.series.zero["q_l"] - cut.series.zero["q_m"]
    model = Written({**cut.nominal, "q_0": relaxed}, cut.joint)
    error = replay(cut, model)["tau"] - record["tau"][1230:]
    assert np.std(error) < 0.01 * np.std(record["tau"])


def test_a_plainer_law_is_tried_from_what_the_refined_one_had_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A fit without any friction may move damping and datasheet too far to come back."""
    problem = problem_of(simulate(friction=(3.0, 3.0)))
    rows = all_candidates(problem.stages.setting, problem.stages.names)
    falling, damping = (
        next(r for r in rows if r.name == n and r.body == "motor") for n in ("stribeck", "damping")
    )
    start = [
        u.coordinate(x)
        for row, values in ((falling, (2.6, 0.4, 0.5)), (damping, (TRUE["d_m"],)))
        for u, x in zip(row.unknowns, values, strict=True)
    ]
    fit = problem.fit(Model((falling, damping)), np.array([0.0] * len(problem.shared) + start))
    lost = problem.fit(fit.model, fit.z + 5.0, moves=0)
    monkeypatch.setattr(prune, "_swapped", lambda *_: lost)
    plain = prune.simplify(problem, fit, rows)
    assert [e.name for e in plain.model.effects] == ["coulomb", "damping"]
    at = len(problem.shared)
    assert plain.model.effects[0].unknowns[0].value(plain.z[at]) == pytest.approx(3.0, rel=0.05)


@pytest.mark.parametrize(
    ("name", "samples", "size", "status"),
    [
        ("noise", 0.01, 0.1, "confirmed"),
        ("noise", 0.1, 0.1, "tentative"),
        ("noise", 0.1, 1.0, "confirmed"),
        ("quantization", 0.1, 0.1, "confirmed"),
    ],
)
def test_noise_that_the_clock_may_scatter_is_not_confirmed(
    name: str, samples: float, size: float, status: str
) -> None:
    setting = make_setting(simulate(seconds=1.0), nominal(), get_structure(FIXED))
    jittered = replace(setting.noise["tau"], jitter=samples * setting.series.dt)
    setting = replace(setting, noise={**setting.noise, "tau": jittered})
    row = _sensor_row(SensorFinding(name, "tau", size, 0.9 * size, 1.1 * size, 2.0), setting)
    assert row.status == status
