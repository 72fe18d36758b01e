"""Where the fitted record and the held-out one disagree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap.horizons.findings.as_diagnosis import _beside
from cjt_gym.gap.horizons.findings.by_torque import NOT_HELD, NOT_PREDICTED, told_by_torque
from cjt_gym.gap.horizons.fitting.base_terms import base_terms
from cjt_gym.gap.horizons.fitting.fit import Problem
from cjt_gym.gap.horizons.fitting.terms import candidates, scales_of
from cjt_gym.gap.horizons.prediction.case import Case, make_case
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.horizons.selection.choice import best_of, is_no_worse
from cjt_gym.gap.horizons.selection.judgement import NEAR, Judgement, Row
from cjt_gym.gap.horizons.selection.search import search
from cjt_gym.gap.horizons.selection.search_result import Found
from cjt_gym.gap.horizons.torque.inverse import seen_in_torque
from cjt_gym.joint import get_structure
from cjt_gym.joint.joint import Joint
from tests.gap.horizons.rotor import DRY, datasheet, record

RIGID = get_structure("rigid")


@pytest.fixture(scope="module")
def case() -> Case:
    return make_case([record()], [], datasheet(), RIGID)


@pytest.fixture(scope="module")
def searched(case: Case) -> Found:
    """A search whose held-out data refute dry friction."""
    scales = scales_of(case.joint, case.logs)
    base = Model(case.joint, base_terms(case.joint, scales))
    dry = [t for t in candidates(case.joint, scales, case.logs) if t.name == "coulomb"]
    problem = Problem(case.fit)

    def refuting(found: Found) -> Found:
        names = [t.name for t in found.fit.model.terms]
        if "coulomb" not in names:
            return found
        return found.dropped(problem, names.index("coulomb"), lambda _: 0.0)

    return search(problem, base, dry, tested=refuting)


def test_what_held_out_data_refute_is_kept_with_its_size(searched: Found) -> None:
    assert not {"coulomb"} & {t.name for t in searched.fit.model.terms}
    assert searched.refuted["coulomb"] == pytest.approx((DRY,), rel=0.2)


def test_it_is_told_in_doubt_where_the_torque_shows_it_as_large(
    case: Case, searched: Found
) -> None:
    seen = seen_in_torque(case.joint, case.logs)
    near = Row(0.5, "q_m", 1.0, None, 0.5 * NEAR, None, None)
    judged = Judgement(case, "base", case.joint, (near,), found=searched)
    told = _beside(judged, seen)
    assert "coulomb" in told
    (effect,) = told_by_torque(judged, {"coulomb": told["coulomb"]}, (), alone=False)
    assert effect.status == "tentative"
    assert effect.doubt == NOT_HELD
    other = replace(searched, refuted={"coulomb": (4.0 * DRY,)})
    assert "coulomb" not in _beside(replace(judged, found=other), seen), "of another size"
    never = replace(searched, refuted={})
    assert "coulomb" not in _beside(replace(judged, found=never), seen)
    (effect,) = told_by_torque(replace(judged, found=never), seen, (), alone=True)[:1]
    assert effect.doubt == NOT_PREDICTED


def test_the_better_of_datasheet_and_regression_stands_where_all_else_fails(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A third is worse at once and better later; the cost, which is robust, may err."""
    bad, worse = (Joint(datasheet(x), "rigid", "current", {}) for x in (0.5, 0.1))
    dry = {"coulomb": {"d_cm": 4.0 * DRY, "d_cg": 0.0, "d_cl": 0.0, "dq_0": 0.0}}
    third = Joint(datasheet(0.4), "rigid", "current", dry)
    test = Problem(case.test)
    monkeypatch.setattr(test, "cost", lambda _, __, errors: -float(np.mean(errors[0] ** 2)))
    for given in (("datasheet", "least squares"), ("least squares", "datasheet")):
        joints = {**dict(zip(given, (bad, worse), strict=True)), "base": third}
        assert not any(is_no_worse(case, joints, name) for name in joints)
        assert best_of(case, test, joints, NEAR) == given[0]
