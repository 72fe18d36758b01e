"""Predictions at several horizons: the kernel's own, true on data of another integrator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import cjt_gym.gap.horizons.selection.search as search_of
from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.horizons.findings.naming import _levelled
from cjt_gym.gap.horizons.findings.stages_kept import _doubted
from cjt_gym.gap.horizons.fitting.base_terms import base_terms, freed
from cjt_gym.gap.horizons.fitting.fit import Fit, Problem
from cjt_gym.gap.horizons.fitting.terms import candidates, scales_of
from cjt_gym.gap.horizons.prediction.case import Case, late, make_case
from cjt_gym.gap.horizons.prediction.log import to_log
from cjt_gym.gap.horizons.prediction.model import Draft, Model, drafted
from cjt_gym.gap.horizons.prediction.predictable import Predictable
from cjt_gym.gap.horizons.prediction.windows import relative, worse
from cjt_gym.gap.horizons.selection.judgement import Judgement, Row
from cjt_gym.gap.horizons.selection.search import search
from cjt_gym.gap.horizons.selection.search_result import Found
from cjt_gym.gap.horizons.selection.stepwise import added, allowed, is_needed
from cjt_gym.gap.horizons.torque.baseline import least_squares
from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.files.diagnosed import covariance_of
from cjt_gym.joint.joint import Joint
from cjt_gym.records import Record
from tests.gap.horizons.rotor import DAMPING, DRY, DT, INERTIA, datasheet, record

RIGID = get_structure("rigid")


def case_of(file: JointFile | None = None, **changes: float) -> Case:
    made = record(**changes)  # type: ignore[arg-type]
    case = make_case([made], [], datasheet() if file is None else file, RIGID)
    return late(case, 0.5)  # each current of the record acts from its row on


def found_in(case: Case) -> Found:
    scales = scales_of(case.joint, case.logs)
    base = Model(case.joint, base_terms(case.joint, scales))
    terms = [*candidates(case.joint, scales, case.logs), *freed(base.terms)]
    return search(Problem(case.fit), base, terms)


@pytest.fixture(scope="module")
def plain() -> tuple[Case, Found]:
    case = case_of()
    return case, found_in(case)


def values_of(found: Found) -> dict[str, float]:
    model = found.fit.model
    pairs = zip(model.terms, model.values(found.fit.z), strict=True)
    return {term.name: values[0] for term, values in pairs}


def test_a_window_is_predicted_as_the_joint_simulates_it() -> None:
    case = case_of()
    log, group = case.fit.logs[0], case.fit.groups[0]
    joint = Joint(case.joint.file, "rigid", "current", {})
    start = int(group.starts[3])
    stop = start + group.length
    simulated = joint.simulate(log.acting[start:stop], dt=log.dt, x0=log.states[start])
    errors = case.fit.errors(joint)
    row = case.fit.keys.index(("q_m", 0.5))
    points = group.points(0.5, log.dt)
    expected = simulated["true_q_m"][points] - log.measured["q_m"][start + points]
    measured = errors[row][3] * np.sqrt(case.fit.scales[row])
    assert measured == pytest.approx(expected, abs=1e-5 * np.ptp(log.measured["q_m"]))


def test_inertia_damping_and_friction_come_out_of_a_guess(plain: tuple[Case, Found]) -> None:
    numbers = values_of(plain[1])
    assert set(numbers) == {"inertia", "damping", "torque_constant", "coulomb"}
    assert 2.0 * numbers["inertia"] == pytest.approx(1.0, rel=0.1), "half of what was guessed"
    assert numbers["coulomb"] == pytest.approx(DRY, rel=0.1)
    assert numbers["damping"] == pytest.approx(DAMPING, rel=0.25)


def test_what_was_found_beats_datasheet_and_least_squares(plain: tuple[Case, Found]) -> None:
    case, found = plain
    regression = least_squares(case.joint, case.logs)
    assert regression is not None
    mine = relative(case.test, case.test.errors(found.fit.model.at(found.fit.z)))
    for other in (case.joint, regression):
        theirs = relative(case.test, case.test.errors(other))
        assert all(mine[key] <= 1.02 * theirs[key] for key in mine if key[1] > 0.02)
    assert mine["q_m", 0.5] < 0.1


@pytest.mark.slow
def test_friction_that_differs_backward_in_level_and_slope_is_found() -> None:
    steep, low = 0.15, 0.04
    case = late(make_case([record(back=(steep, low))], [], datasheet(), RIGID), 0.5)
    found = found_in(case)
    numbers, joint = values_of(found), found.fit.model.at(found.fit.z)
    assert numbers["viscous_asym"] == pytest.approx(steep - DAMPING, rel=0.1)
    offset = numbers.get("torque_offset", 0.0)
    asymmetric = joint.effects.get("coulomb_asym")
    ways = (asymmetric["d_cm"], asymmetric["d_cm_n"]) if asymmetric else 2 * (numbers["coulomb"],)
    assert [ways[0] - offset, ways[1] + offset] == pytest.approx([DRY, low], rel=0.1)


def test_an_offset_that_was_added_first_does_not_keep_out_damping_that_differs_backward() -> None:
    case = case_of()
    terms = {t.name: t for t in candidates(case.joint, scales_of(case.joint, case.logs), case.logs)}
    scales = scales_of(case.joint, case.logs)
    model = Model(case.joint, (*base_terms(case.joint, scales), terms["torque_offset"]))
    assert allowed(Problem(case.fit).at(model, np.zeros(len(model.numbers))), terms["viscous_asym"])


def test_a_delay_of_two_and_a_half_rows_is_predicted_as_such() -> None:
    case = late(make_case([record(late=2.5 * DT)], [], datasheet(), RIGID), 0.5)

    def error(delay: float) -> float:
        draft = Draft(case.joint.file, {})
        draft.row("inertia").update(I_m=INERTIA, I_g=0.0)
        draft.row("damping").update(d_m=DAMPING, d_g=0.0, d_l=0.0)
        draft.row("coulomb")["d_cm"] = DRY
        draft.row("command_delay")["delay"] = delay
        draft.smooth(0.0)
        return relative(case.test, case.test.errors(drafted(case.joint, draft)))["q_m", 0.5]

    assert error(2.5 * DT) < 0.5 * min(error(2.0 * DT), error(3.0 * DT))


def test_least_squares_learns_from_records_of_either_direction_together() -> None:
    made = record(seconds=8.0)
    forward = np.gradient(made["q_m"], DT) > 0.0
    ways = []
    for way in (forward, ~forward):
        columns = {n: made[n][way] for n in ("q_m", "i")}
        ways.append(Record({"t": made.t[way], **columns}, made.units, structure="rigid"))
    regressed = least_squares(case_of().joint, [to_log(one, datasheet(), RIGID) for one in ways])
    assert regressed is not None
    assert regressed.effects["coulomb"]["d_cm"] == pytest.approx(DRY, rel=0.1)
    assert abs(regressed.effects["torque_offset"]["torque"]) < 0.1 * DRY


@pytest.mark.slow
def test_noise_of_the_current_that_nobody_specified_does_not_hide_friction() -> None:
    numbers = values_of(found_in(case_of(noise=0.3)))
    assert numbers["coulomb"] == pytest.approx(DRY, rel=0.25)
    assert 0.6 < 2.0 * numbers["inertia"] < 1.6, "a deaf joint would be several times too heavy"


@pytest.mark.slow
def test_a_joint_that_is_pushed_without_current_tells_its_friction() -> None:
    """Nothing is looked for in shares of the motor's torque, and its constant cannot be told."""
    told = diagnose(record(pushed=True), datasheet(), "rigid")
    named = {effect.name: effect for effect in told.effects}
    assert {"coulomb", "damping"} <= named.keys()
    assert named["coulomb"].parameters["d_cm"].value == pytest.approx(DRY, rel=0.1)
    known = covariance_of(told.joint)
    assert known is not None
    assert not [name for name in known.names if name.startswith("torque_constant")]


@pytest.mark.slow
def test_effects_of_a_joint_that_is_given_are_a_part_of_what_is_known() -> None:
    dry = {"coulomb": {"d_cm": DRY, "d_cg": 0.0, "d_cl": 0.0, "dq_0": 0.0}}
    known = Joint(datasheet(1.0), "rigid", "current", dry)
    assert "coulomb" in {effect.name for effect in diagnose(record(), known.file, "rigid").effects}
    assert "coulomb" not in {effect.name for effect in diagnose(record(), known).effects}


def test_no_friction_is_found_where_there_is_none() -> None:
    assert "coulomb" not in values_of(found_in(case_of(dry=0.0)))


@pytest.mark.parametrize(
    ("factor", "late", "noise", "used"),
    [(1.0, 0, 0.0, True), (0.4, 0, 0.0, False), (1.0, 60, 0.0, False), (1.0, 0, 3.0, False)],
)
def test_a_speed_that_tells_less_than_the_angle_is_not_used(
    factor: float, late: int, noise: float, used: bool
) -> None:
    plain = record()
    speed = factor * np.roll(np.gradient(plain["q_m"], DT), late)
    speed = speed + np.random.default_rng(4).normal(0.0, noise, len(speed))
    with_speed = plain.with_columns({"dq_m": speed}, {"dq_m": "rad/s"})
    started = to_log(with_speed, datasheet(), RIGID).speed
    assert np.allclose(started, speed, atol=1e-9) == used
    assert np.allclose(started, to_log(plain, datasheet(), RIGID).speed, atol=1e-9) != used


def test_one_piece_of_a_record_decides_nothing(plain: tuple[Case, Found]) -> None:
    windows = plain[0].fit
    other = [np.full((len(windows.pieces(key)), 4), 0.5) for key in windows.keys]
    better, slack = [0.8 * e for e in other], dict.fromkeys(windows.keys, 1.02)
    assert worse(windows, better, other, slack) == []
    assert worse(windows, other, better, slack) == list(windows.keys)
    once, both = [e.copy() for e in better], [e.copy() for e in other]
    for key, a, b in zip(windows.keys, once, both, strict=True):
        piece = windows.pieces(key) == windows.pieces(key)[0]
        a[piece], b[piece] = 50.0, 30.0
    assert worse(windows, once, both, slack) == [], "nothing predicts a brake"
    assert worse(windows, once, other, slack) == list(windows.keys), "the other predicts the stop"
    first = [e.copy() for e in other]  # what is worse there alone does not make others better
    first[0][0] = 50.0
    assert worse(windows, first, better, slack) == list(windows.keys)


# ---- the whole diagnosis
@pytest.fixture(scope="module")
def told() -> Diagnosis:
    return diagnose(record(noise=0.1), datasheet(), "rigid")


def test_a_diagnosis_states_its_horizons_and_what_the_record_tells(told: Diagnosis) -> None:
    plain = told.to_dict()
    rows = plain["horizons"]
    assert [row["seconds"] for row in rows] == [0.02, 0.1, 0.5]  # type: ignore[index,union-attr]
    for row in rows:  # type: ignore[union-attr]
        assert {"channel", "datasheet", "least_squares", "found", "floor"} < set(row)  # type: ignore[arg-type]
    assert "coulomb" in plain["record"]["can_tell"]  # type: ignore[index,call-overload]
    assert "predictable" in plain["unexplained"]  # type: ignore[operator]


def test_its_joint_predicts_no_worse_than_datasheet_and_regression(told: Diagnosis) -> None:
    for row in told.horizons:
        if row.seconds > 0.02:
            assert row.found <= 1.02 * row.datasheet
            assert row.least_squares is None or row.found <= 1.02 * row.least_squares


def test_its_pictures_show_the_joint_that_is_the_answer(told: Diagnosis) -> None:
    drawn = told.evidence.replays["q_m"]
    before, after = (drawn[key] - drawn["measured"] for key in ("before", "after"))
    assert told.evidence.restarted == pytest.approx(0.5, abs=0.01)
    ratio = np.std(after) / np.std(before)
    (row,) = (h for h in told.horizons if h.seconds == 0.5 and h.channel == "q_m")
    assert ratio == pytest.approx(row.found / row.datasheet, rel=0.5)


def test_it_names_the_friction_and_not_the_guess(told: Diagnosis) -> None:
    named = {effect.name for effect in told.effects}
    assert named & {"coulomb", "coulomb_asym"}
    assert "inertia" not in named
    own = told.joint.effects.get("inertia", {}).get("I_m")
    found = told.joint.parameters.I_m if own is None else own.number  # type: ignore[union-attr]
    assert found == pytest.approx(INERTIA, rel=0.3)


@pytest.mark.slow
def test_a_guess_that_is_far_off_is_corrected_and_not_named() -> None:
    found = diagnose(record(), datasheet(12.0), "rigid")
    assert {effect.name for effect in found.effects} == {"coulomb", "damping"}
    assert found.joint.parameters.I_m == pytest.approx(0.02, rel=0.1)


@pytest.mark.slow
def test_a_value_that_is_further_off_than_its_datasheet_says_is_freed_of_it() -> None:
    found = found_in(case_of(datasheet(1.5, tolerance=0.02)))
    numbers = values_of(found)
    freed_of_it = [k for k, t in enumerate(found.fit.model.terms) if t.tight is not None]
    assert len(freed_of_it) == 1, "motion tells inertia over torque constant, not both"
    ratio = 1.5 * numbers["inertia"] / numbers["torque_constant"]
    assert ratio == pytest.approx(1.0, rel=0.05)
    kept, _ = found.fit.model.without(freed_of_it[0], found.fit.z)
    own = found.fit.model.terms[freed_of_it[0]]
    assert own.tight in kept.terms, "left out it is what the datasheet says"


def test_friction_that_falls_with_speed_falls_to_a_level(plain: tuple[Case, Found]) -> None:
    case, found = plain
    terms = candidates(case.joint, scales_of(case.joint, case.logs), case.logs)
    falling = next(term for term in terms if term.name == "stribeck")
    dry = next(k for k, term in enumerate(found.fit.model.terms) if term.name == "coulomb")
    assert not allowed(found.base, falling)
    assert allowed(found.fit, falling)
    assert not is_needed(found.fit, dry)
    both = Fit(*added(found.fit, falling, falling.starts[0]), np.inf, [])
    assert is_needed(both, dry), "it may not be left out beside the falling one"
    assert _levelled(both, both.model.terms.index(falling))
    of_load = replace(falling, body="load")
    apart = Fit(*added(found.fit, of_load, falling.starts[0]), np.inf, [])
    assert not _levelled(apart, apart.model.terms.index(of_load)), "the motor's is no level of it"


@pytest.mark.slow
def test_the_best_model_that_is_left_wins_not_the_best_before_pruning(
    plain: tuple[Case, Found], monkeypatch: pytest.MonkeyPatch
) -> None:
    case, whole = plain
    terms = candidates(case.joint, scales_of(case.joint, case.logs), case.logs)
    base, problem = whole.base.model, Problem(case.fit)
    best = replace(whole.fit, cost=whole.fit.cost - 100.0)
    ends = iter([best])
    monkeypatch.setattr(search_of, "extended", lambda *_: next(ends, whole.fit))
    monkeypatch.setattr(
        search_of, "pruned", lambda _p, first, fit, *_: replace(
            whole, fit=first if fit is best else fit
        ),
    )  # fmt: skip
    monkeypatch.setattr(search_of, "rivals_of", lambda *_: ((), None))
    found = search(problem, base, terms)
    assert "coulomb" in {t.name for t in found.fit.model.terms}
    assert found.fit.cost < whole.base.cost


def test_a_delay_at_the_edge_of_what_may_be_is_none(plain: tuple[Case, Found]) -> None:
    case, found = plain
    scales = scales_of(case.joint, case.logs)
    late = {t.name: t for t in candidates(case.joint, scales, case.logs) if t.family == "late"}
    assert late.keys() == {"command_delay", "current_lag"}
    for term in late.values():
        number = term.numbers[0]
        edge = number.low if number.log else number.high
        for value, is_there in ((edge, True), (number.start or 0.5 * edge, False)):
            fit = Fit(*added(found.fit, term, (value,)), 0.0, [])
            assert (
                search_of._at_an_edge(Problem(case.fit), fit, len(fit.model.terms) - 1) is is_there
            )


def test_damping_is_no_more_than_the_torque_allows(plain: tuple[Case, Found]) -> None:
    case, _ = plain
    scales = scales_of(case.joint, case.logs)
    damping = next(t for t in base_terms(case.joint, scales) if t.name == "damping")
    assert DAMPING < damping.numbers[0].high < 3.0 * scales.peak / scales.fast


def test_a_joint_that_coasts_has_the_torques_of_its_inertia() -> None:
    coasting = replace(record(), columns={**record().columns, "i": np.zeros(len(record()))})
    case = make_case([coasting], [], datasheet(1.0), get_structure("rigid"))
    scales = scales_of(case.joint, case.logs)
    assert scales.peak > 0.3, "not of the current, which is none"
    assert "torque_constant" not in {t.name for t in base_terms(case.joint, scales)}


@pytest.mark.parametrize(
    ("before", "share", "firm", "explained"),
    [(0.9, 0.3, True, True), (0.9, 0.8, False, False), (5.0, 0.8, True, False)],
)
def test_stages_do_not_explain_where_most_of_an_error_is_predictable(
    before: float, share: float, firm: bool, explained: bool,
    plain: tuple[Case, Found], told: Diagnosis,
) -> None:  # fmt: skip
    case = plain[0]
    left = Predictable(share, 0.4)
    rows = (Row(0.1, "q_m", before, None, 0.5, 0.5 * (1.0 - share) ** 0.5, left),)
    found = Judgement(case, "stages", case.joint, rows)
    sure = tuple(replace(effect, status="confirmed") for effect in told.effects)
    first = replace(told, verdict="explained", effects=sure, gap=replace(told.gap, after=0.1))
    ended = _doubted(first, found)
    assert ended.verdict == ("explained" if explained else "partly_explained")
    assert {effect.status for effect in ended.effects} == {"confirmed" if firm else "tentative"}
    assert ("could be predicted" in ended.unexplained.text) != explained


@pytest.mark.parametrize(("status", "after", "explained"), [
    ("tentative", 0.8, False), ("confirmed", 0.8, True), ("tentative", 0.3, True),
])  # fmt: skip
def test_what_tentative_names_hardly_explain_is_not_explained(
    status: str, after: float, explained: bool, plain: tuple[Case, Found], told: Diagnosis
) -> None:
    rows = (Row(0.5, "q_m", 0.2, None, 0.15, 0.12, Predictable(0.1, 0.3)),)
    found = Judgement(plain[0], "stages", plain[0].joint, rows)
    gap = replace(told.gap, before=1.0, after=after, floor=0.05)
    effects = tuple(replace(effect, status=status) for effect in told.effects)
    first = replace(told, verdict="explained", effects=effects, gap=gap)
    ended = _doubted(first, found)
    assert ended.verdict == ("explained" if explained else "partly_explained")
    assert ("80% of it" in ended.unexplained.text) != explained
