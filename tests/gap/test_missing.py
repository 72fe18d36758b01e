"""Records as joints really give them: channels missing, slow, in motion from the start, several."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym.errors import RecordError
from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.candidates.separated import separating
from cjt_gym.gap.candidates.table import all_candidates
from cjt_gym.gap.diagnosis import Interval
from cjt_gym.gap.horizons.findings.not_confirmed import allowed_by
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.fit import Model, Problem
from cjt_gym.joint import get_structure
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.joint import Joint
from cjt_gym.records import Record
from tests.gap.bench import joint_of, record_of
from tests.gap.check.moved import DAMPING, columns
from tests.gap.check.moved import joint as mass
from tests.gap.check.moved import record as log
from tests.gap.simulator import TRUE, nominal, only, simulate

FIXED = "output_fixed_rigid_gearbox"
RUBBING = (3.0, 3.0)
DRIVEN = ("current_lag", "hum")


def named(found: Diagnosis) -> list[str]:
    return [effect.name for effect in found.effects]


def level(found: Diagnosis) -> float:
    return found.effects[0].parameters["d_cm"].value


@pytest.mark.slow
def test_a_torque_command_in_place_of_the_current_shows_friction() -> None:
    record = only(simulate(4.0, friction=RUBBING), "q_m", "q_l", "tau", "i_cmd")
    torque: NDArray[np.float64] = record["i_cmd"] * TRUE["n"] * TRUE["k_t"]
    columns = {name: record[name] for name in ("q_m", "q_l", "tau")} | {"tau_cmd": torque}
    units = {"q_m": "rad", "q_l": "rad", "tau": "N m", "tau_cmd": "N m"}
    found = diagnose(Record(columns, units, dt=record.dt, structure=FIXED), nominal())
    assert named(found) == ["coulomb"]
    assert level(found) == pytest.approx(3.0, rel=0.05)
    assert "Without the measured current" in found.unexplained.text


@pytest.mark.parametrize("channels", [("q_m", "q_l", "tau", "i_cmd"), ("q_m", "q_l", "i", "i_cmd")])
def test_a_perfect_joint_has_no_gap_whatever_is_missing(channels: tuple[str, ...]) -> None:
    found = diagnose(only(simulate(4.0), *channels), nominal())
    assert (found.verdict, named(found)) == ("no_gap", [])


@pytest.mark.slow
def test_without_position_the_torque_constant_is_judged_and_its_rival_said() -> None:
    found = diagnose(only(simulate(4.0), "i", "i_cmd", "tau"), nominal(k_t=1.18))
    assert named(found) == ["torque_constant"]
    assert found.effects[0].parameters["k_t"].value == pytest.approx(TRUE["k_t"], rel=0.03)
    assert "torque_gain" in found.effects[0].confusable_with
    assert "neither the spring" in found.unexplained.text


@pytest.mark.slow
@pytest.mark.parametrize(("rise", "name"), [(0.0, "coulomb"), (0.6, "stribeck"), (1.5, "stribeck")])
def test_friction_that_falls_below_the_stated_noise_is_not_confirmed_as_plain(
    rise: float, name: str
) -> None:
    """Without the current its noise is stated, but not there: a residual far below is no floor."""
    record = simulate(4.0, friction=(1.5, 1.5), breakaway=(rise, 0.15))
    (effect,) = diagnose(only(record, "q_m", "tau", "i_cmd"), nominal()).effects
    assert (effect.name, effect.status) == (name, "confirmed")
    falls = {} if name == "coulomb" else {"d_sm": rise, "v_s": 0.15}
    for symbol, true in ({"d_cm": 1.5} | falls).items():
        assert effect.parameters[symbol].low < true < effect.parameters[symbol].high


def test_a_record_without_the_command_is_not_asked_what_the_drive_does() -> None:
    record = simulate(2.0)
    whole = Stages(make_setting(record, nominal(), get_structure(FIXED)))
    rows = (*all_candidates(whole.setting, whole.names), *whole.outside.rows)
    drive = tuple(next(r for r in rows if name in (r.name, r.outside)) for name in DRIVEN)
    assert all("drive" in row.touches for row in drive)
    bare = make_setting(only(record, "i", "q_m", "tau"), nominal(), get_structure(FIXED))
    problem, model = Problem.of(Stages(bare)), Model(drive)
    start = [u.coordinate(x) for r in drive for u, x in zip(r.unknowns, r.starts[0], strict=True)]
    z = np.array([0.0] * len(problem.shared) + start)
    slopes = problem.jacobian(model, z, problem.residuals(model, z))
    assert set(slopes) == set(problem.stages.names)
    assert "drive" not in slopes


@pytest.mark.slow
def test_a_held_out_record_may_lack_the_command_beside_which_a_cause_was_found() -> None:
    t = 1e-3 * np.arange(4000)
    hum = 0.4 * np.sin(2.0 * np.pi * 50.0 * t)
    record, other = (simulate(4.0, seed, RUBBING, drive=lambda i: i + hum) for seed in (0, 1))
    found = diagnose(record, nominal(), validate=only(other, "i", "q_m", "q_l", "tau"))
    assert "coulomb" in named(found)
    assert found.stages["drive"].before > 3.0, "something is in the current that no command asks"


def test_without_position_and_torque_nothing_is_judged() -> None:
    with pytest.raises(RecordError, match="q_m"):
        diagnose(only(simulate(1.0), "i", "i_cmd"), nominal())


@pytest.mark.slow
def test_a_slow_log_shows_friction_and_says_what_it_blurs() -> None:
    record = simulate(16.0, friction=RUBBING)
    columns = {name: record[name][::10] for name in record.columns if name != "t"}
    units = {name: record.units[name] for name in columns}
    found = diagnose(Record(columns, units, dt=10 * record.dt, structure=FIXED), nominal())
    assert named(found) == ["coulomb"]
    assert level(found) == pytest.approx(3.0, rel=0.1)
    assert "Record at 1 kHz" in found.unexplained.text


@pytest.mark.slow
def test_a_record_may_begin_in_motion() -> None:
    found = diagnose(simulate(6.0, friction=RUBBING).slice(2200, None), nominal())
    assert named(found) == ["coulomb"]
    assert level(found) == pytest.approx(3.0, rel=0.02)


@pytest.mark.slow
def test_records_of_which_some_lack_the_current_are_explained_together(tmp_path: Path) -> None:
    """Their drive repeats its command, which is no measurement, in some of them only."""
    true = joint_of(tmp_path, effects={"coulomb": {"d_cm": 4.0}})
    whole = record_of(true, 6000)
    kept = {name: x for name, x in whole.columns.items() if name != "i"}
    bare = Record(kept, {name: whole.units[name] for name in kept}, structure=whole.structure)
    sheet = joint_of(tmp_path).file
    found = diagnose([whole.slice(0, 3000), bare.slice(3000, None)], sheet, whole.structure)
    assert [e.name for e in found.effects] == ["coulomb"]
    assert found.effects[0].parameters["d_cm"].value == pytest.approx(4.0, rel=0.1)


def test_records_with_zeros_of_their_own_are_explained_together() -> None:
    first, second = (simulate(3.0, seed, (2.0, 2.0)) for seed in (0, 1))
    moved = second.with_columns({"tau": second["tau"] + 0.1})
    found = diagnose([first, moved], nominal())
    assert named(found) == ["coulomb"]
    assert level(found) == pytest.approx(2.0, rel=0.02)
    assert found.gap.held_out


@pytest.mark.slow
def test_friction_that_is_smooth_near_rest_shows_its_width() -> None:
    record = simulate(4.0, extra=lambda t, q, v: -3.0 * float(np.tanh(v / 0.05)))
    found = diagnose(record, nominal())
    assert named(found) == ["coulomb"]
    assert level(found) == pytest.approx(3.0, rel=0.02)
    assert found.effects[0].parameters["dq_0"].value == pytest.approx(0.05, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("heavier", "verdict"), [(1.6, "explained"), (1.0, "no_gap")])
def test_a_load_that_only_the_motor_and_the_torque_show_is_found(
    heavier: float, verdict: str
) -> None:
    """Without q_l the stages judge neither spring nor load, but predictions tell its inertia."""
    load = {"I_g": Quantity(0.0, "kg m^2"), "I_l": Quantity(0.5, "kg m^2")}
    load["d_l"] = Quantity(0.5, "N m s/rad")
    sheet = replace(nominal(), parameters=nominal().parameters.replace(**load))
    true = sheet.parameters.replace(I_l=Quantity(0.5 * heavier, "kg m^2"))
    joint = quiet(Joint(replace(sheet, parameters=true), "rigid_gearbox", "current", {}))
    t, rng = 1e-3 * np.arange(6000), np.random.default_rng(0)
    amps = 2.0 * np.sin(2.0 * np.pi * 1.3 * t) + 1.5 * np.sin(2.0 * np.pi * 9.0 * t)
    made = joint.simulate(amps * TRUE["k_t"] * TRUE["n"], dt=1e-3)
    columns = {"i_cmd": amps, "q_m": made["true_q_m"] + rng.normal(0.0, 2e-6, 6000)}
    columns["tau"] = made["true_tau"] + rng.normal(0.0, 0.04, 6000)
    units = {"i_cmd": "A", "q_m": "rad", "tau": "N m"}
    found = diagnose(Record(columns, units, dt=1e-3, structure="rigid_gearbox"), sheet)
    assert found.verdict == verdict
    assert ("q_l" in found.suggestion.text) == (verdict == "explained")
    loads = [e.parameters["I_l"].value for e in found.effects]
    assert loads == pytest.approx([0.8] if verdict == "explained" else [], rel=0.01)
    assert all(e.status == "tentative" for e in found.effects)


@pytest.mark.slow
def test_a_wave_whose_frequency_stays_open_is_not_confirmed() -> None:
    found = diagnose([log(columns(seconds=4.0))], mass(d_m=DAMPING), structure="rigid")
    wave = replace(found.effects[0], name="cogging", status="confirmed", doubt="")
    for half, status in ((0.02, "confirmed"), (0.09, "tentative")):
        f = Interval(7.0, 7.0 * (1.0 - half), 7.0 * (1.0 + half), "1/rev")
        (told,) = allowed_by(
            replace(found, effects=(replace(wave, parameters={"f": f}),)), {}
        ).effects
        assert told.status == status
        assert ("frequency" in told.doubt) == (status == "tentative")


def test_dry_friction_is_not_confirmed_where_motion_in_one_direction_hides_an_offset() -> None:
    table = columns(seconds=4.0)
    del table["i_cmd"]
    found = diagnose([log(table)], mass(d_m=DAMPING), structure="rigid")
    assert [(e.name, e.status) for e in found.effects] == [("coulomb", "confirmed")]
    hidden = dict.fromkeys(("torque_offset", "coulomb_asym"), "motion in one direction")
    beside_a_weight = allowed_by(found, {"torque_offset": ""})
    assert beside_a_weight.effects == found.effects
    (doubtful,) = allowed_by(found, hidden).effects
    assert (doubtful.status, doubtful.confidence) == ("tentative", 0.5)
    assert "does not tell it from an offset" in doubtful.doubt


def test_a_delay_shorter_than_the_record_shows_is_not_confirmed() -> None:
    table = columns(seconds=4.0)
    del table["i_cmd"]
    found = diagnose([log(table)], mass(d_m=DAMPING), structure="rigid")
    assert found.examination is not None
    exam = replace(found.examination, smallest={"torque_delay": (2.5e-4, "s")})
    for delay, status in ((1e-4, "tentative"), (3e-4, "confirmed")):
        value = {"delay": Interval(delay, 0.9 * delay, 1.1 * delay, "s")}
        late = replace(found.effects[0], name="torque_delay", parameters=value)
        (told,) = allowed_by(replace(found, effects=(late,), examination=exam), {}).effects
        assert told.status == status
        assert ("longer delays" in told.doubt) == (status == "tentative")


def test_pairs_that_one_experiment_tells_apart_are_told_together() -> None:
    text = separating({"viscous_asym": ["coulomb_asym", "torque_offset"]})
    assert text.count("record") == 1
    assert "viscous_asym from coulomb_asym and viscous_asym from torque_offset" in text
