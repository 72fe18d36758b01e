"""Causes outside the effect table: recognised, described, and not blamed on the table's effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.candidates.table import all_candidates
from cjt_gym.gap.diagnosis import Interval
from cjt_gym.gap.judged.confidence import confidence
from cjt_gym.gap.judged.gap_size import harms
from cjt_gym.gap.judged.replay import written
from cjt_gym.gap.recorded.setting import Setting, make_setting
from cjt_gym.gap.stages.explain import Explanation, explain
from cjt_gym.gap.stages.fit import Model
from cjt_gym.gap.stages.heldout import Trial, on_held_out, worth
from cjt_gym.gap.stages.intervals import may_be_nothing
from cjt_gym.gap.stages.leftover import Leftover, status
from cjt_gym.joint import get_structure
from cjt_gym.records import Record
from tests.gap.simulator import TRUE, nominal, simulate

FIXED = "output_fixed_rigid_gearbox"


def drifting(record: Record) -> Record:
    """Return a record whose torque sensor drifts by 6 N m."""
    columns = {name: np.array(record[name]) for name in record.columns}
    columns["tau"] = columns["tau"] + 6.0 * (1.0 - np.exp(-record.t / 2.0))
    return Record(columns, record.units, dt=record.dt, structure=FIXED)


def confirmed(diagnosis: Diagnosis) -> list[str]:
    return [effect.name for effect in diagnosis.effects if effect.status == "confirmed"]


def setting_of(record: Record) -> Setting:
    return make_setting(record, nominal(), get_structure(FIXED))


@pytest.mark.slow
def test_a_drifting_torque_sensor_is_recognised_and_described() -> None:
    found = diagnose(drifting(simulate()), nominal(), validate=drifting(simulate(seed=1)))
    assert found.verdict == "unexplained"
    assert not found.effects
    assert "torque sensor that drifts" in found.unexplained.text
    assert found.unexplained.share == 1.0, "as the replay shows, without any effect"


@pytest.mark.slow
def test_a_known_effect_beside_an_unknown_one_is_named_and_confirmed() -> None:
    def shaken(t: float, q: float, v: float) -> float:
        del q, v
        return 2.0 * float(np.sin(2.0 * np.pi * 17.0 * t))

    first, second = (simulate(seed=k, friction=(2.0, 2.0), extra=shaken) for k in (0, 1))
    found = diagnose(first, nominal(), validate=second)
    assert found.verdict == "partly_explained"
    assert confirmed(found) == ["coulomb"]
    level = found.effects[0].parameters["d_cm"]
    assert level.value == pytest.approx(2.0, rel=0.1)
    assert "vibration" in found.unexplained.text


@pytest.mark.slow
def test_what_is_outside_the_table_is_no_rival_that_is_named() -> None:
    found = diagnose(simulate(friction=(2.0, 1.2)), nominal())
    table = {"coulomb", "coulomb_asym", "stribeck", "presliding", "load_friction", "viscous_asym"}
    for effect in found.effects:
        assert set(effect.confusable_with) <= table | {"torque_offset", "torque_bias", "damping"}


@pytest.fixture(scope="module")
def explanation() -> Explanation:
    first, second = (simulate(seed=k, friction=(2.0, 2.0)) for k in (0, 1))
    return explain(setting_of(first), [setting_of(second)])


def test_a_true_effect_is_worth_on_held_out_data_what_it_changes(explanation: Explanation) -> None:
    trial = worth(explanation.held, 0)
    assert trial is not None
    assert trial.change > 1.0
    assert trial.worth == pytest.approx(1.0, abs=0.1)


def test_an_effect_that_another_record_contradicts_is_worth_less_than_nothing(
    explanation: Explanation,
) -> None:
    without = setting_of(simulate(seed=1))
    held = on_held_out(without, explanation.problem, explanation.fit)
    trial = worth([held], 0)
    assert trial is not None
    assert trial.worth < 0.0


@pytest.mark.slow
def test_an_effect_that_held_out_data_refute_is_not_named() -> None:
    found = diagnose(simulate(friction=(2.0, 2.0)), nominal(), validate=simulate(seed=1))
    assert not confirmed(found)
    assert found.verdict in ("unexplained", "partly_explained")


def test_confidence_rises_with_the_lead_and_falls_with_doubt() -> None:
    good, bad = Trial(5.0, 1.0), Trial(5.0, 0.6)
    assert confidence(30.0, good, False) > confidence(3.0, good, False)
    assert confidence(30.0, good, False) > confidence(30.0, bad, False)
    assert confidence(30.0, good, False) > confidence(30.0, None, False)
    assert confidence(30.0, good, False) > confidence(30.0, good, True)
    assert 0.0 < confidence(-5.0, bad, True) < 0.5


@pytest.mark.parametrize(
    ("change", "expected"), [(1.02, "confirmed"), (0.5, None), (0.75, "tentative")]
)
def test_beside_something_left_an_effect_must_be_worth_what_it_says(
    explanation: Explanation, change: float, expected: str | None
) -> None:
    need = explanation.needs[0]
    weak = replace(need, log_share=0.6 if expected else 0.1)
    left = (Leftover("motor", 0.5),)
    assert status(weak, ("motor",), left, Trial(1.0, change)) == expected


@pytest.mark.parametrize(
    ("name", "ends", "expected"),
    [
        ("coulomb", {"d_cm": (0.0, 2.0)}, True),
        ("coulomb", {"d_cm": (0.1, 2.0)}, False),
        ("coulomb_asym", {"d_cm": (0.0, 2.0), "d_cm_n": (0.1, 2.0)}, False),
        ("torque_constant", {"k_t": (0.9 * TRUE["k_t"], 1.1 * TRUE["k_t"])}, True),
        ("torque_constant", {"k_t": (1.05 * TRUE["k_t"], 1.1 * TRUE["k_t"])}, False),
        ("torque_gain", {"gain": (0.98, 1.04)}, True),
        ("backlash", {"b": (0.0, 1e-4), "centre": (1e-5, 2e-5)}, True),
        ("cogging", {"f": (6.9, 7.1), "a": (-1.0, 1.0), "b": (-0.1, 2.0)}, True),
        ("cogging", {"f": (6.9, 7.1), "a": (-1.0, 1.0), "b": (0.1, 2.0)}, False),
        ("current_lag", {"bandwidth": (30.0, 400.0)}, False),
    ],
)
def test_an_effect_may_be_nothing_where_all_its_sizes_may(
    name: str, ends: dict[str, tuple[float, float]], expected: bool
) -> None:
    rows = all_candidates(setting_of(simulate(seconds=1.0)), ("drive", "motor", "transmission"))
    row = next(h for h in rows if h.name == name and {u.symbol for u in h.unknowns} == set(ends))
    known = {s: Interval(0.5 * (low + high), low, high, "-") for s, (low, high) in ends.items()}
    assert may_be_nothing(row, known) is expected


def test_an_effect_with_which_the_replay_is_worse_does_harm(explanation: Explanation) -> None:
    problem, fit = explanation.problem, explanation.fit
    assert {effect.name for effect in fit.model.effects} == {"coulomb"}
    two = written(problem, fit.model, fit.z)
    one = written(problem, Model(), fit.z[: len(problem.shared)])
    with_friction, without = (setting_of(simulate(seed=2, friction=(f, f))) for f in (2.0, 0.0))
    assert not harms([with_friction], one, two)
    assert harms([without], one, two)
