"""What a search does with what it has found: one law for another, and back to the datasheet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import cjt_gym.gap.horizons.selection.judge as judge_of
import cjt_gym.gap.horizons.selection.search as search_of
from cjt_gym.gap.horizons.findings.naming import _strained
from cjt_gym.gap.horizons.fitting.base_terms import base_terms, freed
from cjt_gym.gap.horizons.fitting.fit import Fit, Problem, _updated
from cjt_gym.gap.horizons.fitting.terms import candidates, scales_of
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.model import Model, Term
from cjt_gym.gap.horizons.selection.rivals import rivals_of
from cjt_gym.gap.horizons.selection.search import _is_seen_throughout, pruned, search
from cjt_gym.gap.horizons.selection.search_result import Found, worths_of
from cjt_gym.gap.horizons.selection.starts import _one_by_one
from cjt_gym.gap.horizons.selection.stepwise import added, leaves
from cjt_gym.gap.horizons.selection.worth import Worth
from cjt_gym.joint import get_structure
from cjt_gym.joint.files.quantity import Quantity
from tests.gap.horizons.rotor import DRY, datasheet, record


def nothing(_: Fit) -> float:
    return 0.0


@pytest.fixture(scope="module")
def posed() -> tuple[Problem, Fit, dict[str, Term]]:
    """A rotor with dry friction whose inertia the datasheet has right: windows, base, terms."""
    case = make_case([record()], [], datasheet(1.0, tolerance=0.5), get_structure("rigid"))
    scales = scales_of(case.joint, case.logs)
    problem = Problem(case.fit)
    base = problem.fit(Model(case.joint, base_terms(case.joint, scales)))
    return problem, base, {t.name: t for t in candidates(case.joint, scales, case.logs)}


def with_term(problem: Problem, fit: Fit, term: Term) -> Fit:
    return problem.fit(*added(fit, term, term.starts[0]))


def names(fit: Fit) -> set[str]:
    return {term.name for term in fit.model.terms}


@pytest.mark.slow
def test_a_law_that_explains_more_takes_the_place_of_another(
    posed: tuple[Problem, Fit, dict[str, Term]], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, base, terms = posed
    wrong = with_term(problem, base, terms["viscous_asym"])
    less = leaves(problem, wrong)
    found = Found(wrong, base, worths_of(problem, less, wrong, nothing), (), tuple(less))
    rivals, better = rivals_of(problem, found, list(terms.values()))
    assert "coulomb" in rivals[-1]
    assert better is not None
    assert "coulomb" in names(better)
    assert "viscous_asym" not in names(better)
    assert better.cost < wrong.cost

    monkeypatch.setattr(search_of, "extended", lambda _p, fit, *_: fit)
    monkeypatch.setattr(
        search_of, "pruned", lambda p, first, fit, held: found if fit is wrong
        else pruned(p, first, fit, held),
    )  # fmt: skip
    dear = replace(base, cost=wrong.cost + 50.0)
    monkeypatch.setattr(search_of, "best_start", lambda *_: dear)
    monkeypatch.setattr(search_of, "apart", lambda *_: [wrong])
    monkeypatch.setattr(search_of, "begin", lambda *_: wrong)
    monkeypatch.setattr(search_of, "inverse_starts", lambda *_: [])
    ended = search(problem, base.model, list(terms.values())).fit
    assert "coulomb" in names(ended)
    assert "viscous_asym" not in names(ended)


def test_a_search_that_ends_far_from_the_datasheet_starts_from_it_again(
    posed: tuple[Problem, Fit, dict[str, Term]],
) -> None:
    problem, base, terms = posed
    good = with_term(problem, base, terms["coulomb"])
    inertia = good.model.terms[0].numbers[0]
    z = good.z.copy()
    z[0] = inertia.coordinate(4.0 * good.model.values(good.z)[0][0])
    far = problem.at(good.model, z)
    assert far.cost > good.cost + 10.0
    kept = pruned(problem, base, far, nothing).fit
    assert kept.cost == pytest.approx(good.cost, abs=1.0)
    assert kept.model.values(kept.z)[0][0] == pytest.approx(1.0, rel=0.1)
    pairs = zip(kept.model.terms, kept.model.values(kept.z), strict=True)
    dry = [values[0] for term, values in pairs if term.name == "coulomb"]
    assert dry == pytest.approx([DRY], rel=0.1)


def test_updated_derivatives_explain_the_step_that_was_taken() -> None:
    rng = np.random.default_rng(0)
    before, after = ([rng.standard_normal((5, 3)) for _ in range(2)] for _ in range(2))
    old = [rng.standard_normal((5, 3, 4)) for _ in range(2)]
    move = rng.standard_normal(4)
    across = np.linalg.qr(np.column_stack([move, rng.standard_normal((4, 3))]))[0][:, 1:]
    for j, was, a, b in zip(_updated(old, move, before, after), old, before, after, strict=True):
        assert j @ move == pytest.approx(b - a, rel=1e-9)
        assert j @ across == pytest.approx(was @ across, rel=1e-9), "unchanged across the step"


def test_derivatives_that_are_updated_lead_to_the_same_fit_with_less_work(
    posed: tuple[Problem, Fit, dict[str, Term]], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, base, terms = posed
    start = added(base, terms["coulomb"], terms["coulomb"].starts[0])
    quick, slow = replace(problem, work=0), replace(problem, work=0)
    one = quick.fit(*start)
    monkeypatch.setattr("cjt_gym.gap.horizons.fitting.fit._updated", lambda *_: None)
    other = slow.fit(*start)
    assert one.cost == pytest.approx(other.cost, abs=0.5)
    assert quick.work < slow.work


@pytest.mark.parametrize(("heavier", "kept"), [(20.0, True), (1.0, False)])
def test_a_joint_that_hardly_responds_refutes_no_friction(
    posed: tuple[Problem, Fit, dict[str, Term]],
    monkeypatch: pytest.MonkeyPatch,
    heavier: float,
    kept: bool,
) -> None:
    problem, base, terms = posed
    good = with_term(problem, base, terms["coulomb"])
    less = leaves(problem, good)
    z = less[-1].z.copy()
    z[0] = good.model.terms[0].numbers[0].coordinate(heavier * good.model.values(good.z)[0][0])
    less[-1] = replace(less[-1], z=z)
    found = Found(good, base, worths_of(problem, less, good, nothing), (), tuple(less))

    def held(_: Problem, fit: Fit) -> Fit:
        return replace(fit, cost=-50.0 if fit is less[-1] else 0.0)

    monkeypatch.setattr(Problem, "scored", held)
    ended, _ = judge_of._tested(problem, problem, found)
    assert ("coulomb" in names(ended.fit)) is kept


@pytest.mark.parametrize(("off", "beyond"), [(1.02, False), (2.0, True)])
def test_a_freed_value_is_seen_where_errors_put_it_beyond_its_tolerance(
    off: float, beyond: bool
) -> None:
    file = datasheet(off, tolerance=0.05)
    exact = Quantity(1.0, "N m/A", "test", 0.001)
    file = replace(file, parameters=file.parameters.replace(k_t=exact))
    case = make_case([record()], [], file, get_structure("rigid"))
    scales = scales_of(case.joint, case.logs)
    problem = Problem(case.fit)
    base = problem.fit(Model(case.joint, base_terms(case.joint, scales)))
    dry = {t.name: t for t in candidates(case.joint, scales, case.logs)}["coulomb"]
    base = with_term(problem, base, dry)
    loose = next(t for t in freed(base.model.terms) if t.name == "inertia")
    fit = with_term(problem, base, loose)
    less = tuple(leaves(problem, fit))
    worths = [replace(w, clear=0.0) for w in worths_of(problem, less, fit, nothing)]
    found = Found(fit, base, tuple(worths), (), less)
    shown = judge_of._beyond_tolerance(problem, problem, found)
    own = next(k for k, t in enumerate(fit.model.terms) if t.tight is not None)
    assert not found.worths[own].seen
    assert shown.worths[own].seen == beyond
    others = [k for k in range(len(worths)) if k != own]
    assert [shown.worths[k] for k in others] == [worths[k] for k in others]


@pytest.mark.parametrize(("off", "tolerance", "strained"), [(2.0, 0.05, True), (1.02, 0.05, False)])
def test_nothing_is_confirmed_beside_a_datasheet_value_that_is_strained(
    off: float, tolerance: float, strained: bool
) -> None:
    case = make_case([record()], [], datasheet(off, tolerance), get_structure("rigid"))
    scales = scales_of(case.joint, case.logs)
    problem = Problem(case.fit)
    base = problem.fit(Model(case.joint, base_terms(case.joint, scales)))
    dry = {t.name: t for t in candidates(case.joint, scales, case.logs)}["coulomb"]
    fit = with_term(problem, base, dry)
    judged = judge_of.Judgement(case, "found", case.joint, (), Found(fit, base, (), (), ()))
    assert bool(_strained(judged, fit.model.terms[-1])) == strained
    assert not _strained(judged, fit.model.terms[0]), "it is not strained by itself"


def test_a_grid_of_many_guesses_is_searched_one_by_one() -> None:
    grids = [np.arange(5.0) - k for k in range(6)]
    best = np.array([g[(3 * k) % 5] for k, g in enumerate(grids)])
    tried = []

    def cost(z: np.ndarray) -> float:
        tried.append(z)
        return float(np.sum((z - best) ** 2) + 0.1 * (z[0] - best[0]) * (z[1] - best[1]))

    ends = _one_by_one(cost, np.zeros(6), grids)
    assert ends[0] == pytest.approx(best)
    assert len(tried) <= 2 * sum(map(len, grids))


def test_heat_that_only_the_held_out_record_shows_is_not_added() -> None:
    heat, dry = (Term("any", (), lambda *_: None, family=family) for family in ("warm", "dry"))
    elsewhere = Worth(fall=64.8, clear=3.0, rest=60.0, price=16.0, needed=5.0, held=121.4)
    assert elsewhere.enough
    assert _is_seen_throughout(dry, elsewhere)
    assert not _is_seen_throughout(heat, elsewhere)
    assert _is_seen_throughout(heat, replace(elsewhere, clear=6.0))
