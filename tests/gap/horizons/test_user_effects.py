"""An effect of one's own is a candidate by its row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.fitting.base_terms import base_terms
from cjt_gym.gap.horizons.fitting.fit import Problem
from cjt_gym.gap.horizons.fitting.terms import scales_of
from cjt_gym.gap.horizons.fitting.user_effects import own_terms
from cjt_gym.gap.horizons.prediction.case import Case, make_case
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.horizons.selection.search import search
from cjt_gym.gap.horizons.selection.stepwise import added
from cjt_gym.joint import EFFECTS, get_structure
from cjt_gym.joint.effects import Effect, EffectParameter, register_effect
from tests.gap.horizons.rotor import DAMPING, DRY, datasheet, record

DRAG = EffectParameter("drag", "N m", 0.0, 0.0, 20.0, "Dry drag", ("d_cg", "d_cg_n"), typical=1.0)
GREASE = EffectParameter("grease", "N m s/rad", 0.0, 0.0, 5.0, "Drag", ("d_g",), default=0.0)


@pytest.fixture
def seal() -> Iterator[Effect]:
    row = register_effect(
        Effect("seal", "motor", "A lip seal", "made up", (DRAG, GREASE), ("drag", "grease"))
    )
    yield row
    del EFFECTS["seal"]


@pytest.fixture(scope="module")
def case() -> Case:
    return make_case([record()], [], datasheet(), get_structure("rigid"))


@pytest.mark.usefixtures("seal")
def test_its_numbers_are_found(case: Case) -> None:
    scales = scales_of(case.joint, case.logs)
    base = Model(case.joint, base_terms(case.joint, scales))
    found = search(Problem(case.fit), base, own_terms(case.joint, scales)).fit
    values = dict(
        zip((t.name for t in found.model.terms), found.model.values(found.z), strict=True)
    )
    drag, grease = values["seal"]
    assert drag == pytest.approx(DRY, rel=0.1)
    assert grease + values["damping"][0] == pytest.approx(DAMPING, rel=0.1), "they act together"


@pytest.mark.usefixtures("seal")
def test_a_fit_goes_on_where_a_number_is_at_its_bound(case: Case) -> None:
    scales = scales_of(case.joint, case.logs)
    base = Model(case.joint, base_terms(case.joint, scales))
    (term,) = own_terms(case.joint, scales)
    problem = Problem(case.fit)
    start = problem.fit(base, np.zeros(len(base.numbers)), steps=0)
    model, z = added(start, term, (0.3 * DRY, 4.0 * DAMPING))  # damping is at its bound, zero
    soon, late = (problem.fit(model, z, steps) for steps in (12, 60))
    assert soon.cost < late.cost + 1.0


@pytest.mark.slow
@pytest.mark.usefixtures("seal")
def test_what_fits_as_well_is_not_confirmed_beside_it() -> None:
    found = diagnose(record(noise=0.1), datasheet(), "rigid")
    (dry,) = (e for e in found.effects if e.name in ("coulomb", "coulomb_asym", "seal"))
    assert dry.status == "tentative"
    assert {"seal", "coulomb"} <= {dry.name, *dry.confusable_with}


def test_without_rows_of_ones_own_there_are_none(case: Case) -> None:
    assert own_terms(case.joint, scales_of(case.joint, case.logs)) == []


@pytest.mark.usefixtures("seal")
def test_what_the_joint_lists_is_no_candidate(case: Case) -> None:
    listed = replace(case.joint, effects={"seal": {"drag": DRY, "grease": 0.0}})
    assert own_terms(listed, scales_of(listed, case.logs)) == []
