"""The diagnosis from end to end, on a simulator that shares nothing with it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cjt_gym.errors import CjtGymError, ConfigurationError, RecordError
from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.stages.lateness import OPEN
from cjt_gym.records import Record
from tests.gap.simulator import TRUE, nominal, simulate

FIXED = "output_fixed_rigid_gearbox"
KEYS = {"horizons", "record"} | {
    "schema",
    "verdict",
    "where",
    "effects",
    "gap",
    "unexplained",
    "suggestion",
    "seconds",
    "joint",
    "structure",
    "fitted",
    "held_out",
}


def names(diagnosis: Diagnosis) -> list[str]:
    return [effect.name for effect in diagnosis.effects]


@pytest.fixture(scope="module")
def clean() -> Diagnosis:
    return diagnose(simulate(), nominal(I_m=1.02, k_b=0.985))


def test_a_joint_within_its_tolerance_has_no_gap(clean: Diagnosis) -> None:
    assert clean.verdict == "no_gap"
    assert clean.effects == ()


def test_a_perfect_model_leaves_only_noise(clean: Diagnosis) -> None:
    for name in ("drive", "motor", "transmission"):
        assert clean.stages[name].after == pytest.approx(1.0, abs=0.12)


def test_the_dictionary_is_the_contracts_and_json(clean: Diagnosis) -> None:
    content = clean.to_dict()
    assert set(content) == KEYS
    assert set(content["where"]["stages"]) == {  # type: ignore[index]
        "drive",
        "motor",
        "transmission",
        "sensing",
        "load",
    }
    assert json.loads(json.dumps(content, allow_nan=False)) == content


def test_coulomb_friction_is_found_where_it_is_and_as_large_as_it_is() -> None:
    second = simulate(seed=1, friction=(1.5, 1.5))
    found = diagnose(simulate(friction=(1.5, 1.5)), nominal(), validate=second)
    assert names(found) == ["coulomb"]
    level = found.effects[0].parameters["d_cm"]
    assert level.low <= 1.5 <= level.high
    assert level.high - level.low < 0.5
    assert found.verdict == "explained"
    assert found.effects[0].status == "confirmed"


@pytest.mark.slow
def test_a_breakaway_that_holds_the_joint_for_most_of_the_time_is_found() -> None:
    held = [simulate(seed=seed, friction=(6.0, 6.0), breakaway=(5.0, 0.1)) for seed in (0, 1)]
    found = diagnose(held[0], nominal(), validate=held[1])
    assert names(found) == ["stribeck"]
    assert found.verdict == "explained"
    numbers = found.effects[0].parameters
    assert numbers["d_cm"].value == pytest.approx(6.0, rel=0.03)
    assert numbers["d_sm"].value == pytest.approx(5.0, rel=0.06)
    assert numbers["d_sm"].low <= 5.0 <= numbers["d_sm"].high


@pytest.mark.slow
def test_the_direction_of_unequal_friction_is_right() -> None:
    found = diagnose(simulate(friction=(2.5, 1.0)), nominal())
    assert names(found)[0] == "coulomb_asym"
    assert found.effects[0].parameters["d_cm"].value == pytest.approx(2.5, rel=0.1)
    assert found.effects[0].parameters["d_cm_n"].value == pytest.approx(1.0, rel=0.15)


@pytest.mark.slow
def test_a_torque_constant_outside_its_tolerance_is_named() -> None:
    found = diagnose(simulate(), nominal(k_t=1.2))
    assert names(found) == ["torque_constant"]
    assert found.effects[0].parameters["k_t"].value == pytest.approx(TRUE["k_t"], rel=0.01)


def test_a_stiffness_outside_its_tolerance_is_named() -> None:
    found = diagnose(simulate(), nominal(k_b=0.8))
    assert names(found) == ["stiffness"]


@pytest.mark.slow
def test_a_stage_that_stays_unexplained_hides_no_effect_of_another() -> None:
    rough = np.random.default_rng(5).standard_normal(4000)
    push = 2.0 * np.convolve(rough, np.ones(40) / np.sqrt(40.0), "same")
    record = simulate(extra=lambda t, q, v: push[min(round(t / 1e-3), 3999)])
    found = diagnose(record, nominal(k_b=1.12))
    assert names(found) == ["stiffness"]
    assert found.stages["motor"].after > 5.0
    assert found.verdict == "partly_explained"


def test_a_gain_of_the_torque_sensor_is_one_cause_not_three() -> None:
    found = diagnose(simulate(sensed=lambda tau: 1.15 * tau), nominal())
    assert names(found) == ["torque_gain"]


@pytest.mark.slow
def test_a_play_in_the_spring_is_named() -> None:
    def loose(x: float) -> float:
        return TRUE["k_b"] * (x - min(max(x, -2e-4), 2e-4))

    found = diagnose(simulate(spring=loose), nominal())
    assert names(found)[0] == "backlash"
    assert found.effects[0].parameters["gap"].value == pytest.approx(4e-4, rel=0.05)


def test_a_late_command_is_named() -> None:
    def late(command: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros(4), command[:-4]])

    found = diagnose(simulate(drive=late), nominal())
    assert names(found) == ["command_delay"]
    assert found.effects[0].parameters["delay"].value == pytest.approx(4e-3, rel=0.02)


@pytest.mark.slow
def test_a_command_that_is_late_by_a_sample_is_named_and_its_cause_left_open() -> None:
    def late(command: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros(1), command[:-1]])

    records = [simulate(seed=seed, friction=(1.5, 1.5), drive=late) for seed in (0, 1)]
    found = diagnose(records[0], nominal(), validate=records[1])
    assert sorted(names(found)) == ["command_delay", "coulomb"]
    delay = next(effect for effect in found.effects if effect.name == "command_delay")
    assert delay.parameters["delay"].value == pytest.approx(1e-3, rel=0.05)
    assert delay.status == "tentative"
    assert delay.worth == pytest.approx(1.0, abs=0.05)
    assert OPEN in found.unexplained.text
    assert found.joint.effects["command_delay"]["delay"].number == pytest.approx(1e-3, rel=0.05)  # type: ignore[union-attr]


@pytest.mark.slow
def test_a_delay_that_the_other_record_has_not_is_not_the_joints() -> None:
    def late(command: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros(1), command[:-1]])

    found = diagnose(simulate(drive=late), nominal(), validate=simulate(seed=1))
    assert names(found) == []


@pytest.mark.slow
def test_an_effect_outside_the_table_gets_no_confirmed_name() -> None:
    found = diagnose(simulate(extra=lambda t, q, v: 2.0 * np.sin(2 * np.pi * 23.0 * t)), nominal())
    assert found.verdict in ("unexplained", "partly_explained")
    assert not [effect for effect in found.effects if effect.status == "confirmed"]
    assert found.unexplained.stage == "motor"


@pytest.mark.slow
def test_the_gap_shrinks_to_the_noise_on_a_second_record() -> None:
    found = diagnose(
        simulate(friction=(2.0, 2.0)), nominal(), validate=simulate(seed=5, friction=(2.0, 2.0))
    )
    assert found.gap.held_out
    assert found.gap.after < 0.3 * found.gap.before
    assert found.gap.low <= found.gap.removed <= found.gap.high


@pytest.mark.slow
def test_shares_over_a_variable_add_up_to_one() -> None:
    found = diagnose(simulate(friction=(1.5, 1.5)), nominal())
    shares: dict[str, float] = {}
    for regime in found.regimes:
        shares[regime.variable] = shares.get(regime.variable, 0.0) + regime.share
    assert all(total == pytest.approx(1.0, abs=1e-6) for total in shares.values())


@pytest.mark.slow
def test_missing_samples_change_nothing() -> None:
    record = simulate(friction=(1.5, 1.5))
    columns = {name: np.array(record[name]) for name in record.columns}
    for name in ("q_m", "tau", "i"):
        columns[name][1000:1003] = np.nan
    holes = Record(columns, record.units, dt=record.dt, structure=FIXED, allow_nan=True)
    assert names(diagnose(holes, nominal()))[:1] == ["coulomb"]


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["i", "tau", "q_l", "i_cmd"])
def test_a_missing_channel_degrades_but_does_not_fail(missing: str) -> None:
    record = simulate(seconds=2.0, friction=(2.0, 2.0))
    kept = {name: record[name] for name in record.columns if name != missing}
    units = {name: record.units[name] for name in kept}
    found = diagnose(Record(kept, units, dt=record.dt, structure=FIXED), nominal())
    assert found.to_dict()["schema"] == 1


@pytest.mark.parametrize(
    ("keep", "error"), [(slice(0, 50), RecordError), (slice(0, 0), CjtGymError)]
)
def test_too_short_a_record_is_refused(keep: slice, error: type[Exception]) -> None:
    record = simulate(seconds=1.0)
    with pytest.raises(error):
        diagnose(record.slice(keep.start, keep.stop), nominal())


def test_a_record_in_milliseconds_is_refused_with_what_to_map() -> None:
    record = simulate(seconds=1.0)
    columns = {name: record[name] for name in ("q_m", "i_cmd", "tau")}
    slow = Record(columns, {"q_m": "rad", "i_cmd": "A", "tau": "N m"}, dt=1.0, structure=FIXED)
    with pytest.raises(RecordError, match="one every 1 s. If its times are milliseconds, map t"):
        diagnose(slow, nominal())


def test_a_record_without_motor_angle_is_refused() -> None:
    record = simulate(seconds=1.0)
    kept = {"i": record["i"]}
    with pytest.raises(RecordError, match="q_m"):
        diagnose(Record(kept, {"i": "A"}, dt=1e-3, structure=FIXED), nominal())


def test_a_record_that_names_no_joint_needs_one() -> None:
    with pytest.raises(ConfigurationError, match="names no joint"):
        diagnose(simulate(seconds=1.0))
