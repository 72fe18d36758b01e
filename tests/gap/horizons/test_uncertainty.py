"""How sure the numbers of a fit are where windows of the record jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.horizons.fitting.base_terms import base_terms
from cjt_gym.gap.horizons.fitting.fit import Fit, Problem
from cjt_gym.gap.horizons.fitting.terms import candidates, scales_of
from cjt_gym.gap.horizons.fitting.uncertainty import (
    BENT,
    KEPT,
    Spread,
    _of_scale,
    counted,
    spread_of,
)
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.model import Model, Term
from cjt_gym.gap.horizons.selection.stepwise import added
from cjt_gym.joint import Joint, get_structure
from cjt_gym.joint.files.quantity import Quantity
from tests.gap.horizons.rotor import DRY, datasheet, record

TOLERANCE = 0.1


def test_the_motion_of_a_joint_that_sticks_does_not_tell_its_torque_constant() -> None:
    """All torques may be larger in one ratio: only tolerances, of 10 % here, speak against it.

    Near a stop the least change of one value alone decides whether the joint breaks away.
    """
    sheet = datasheet(1.0, tolerance=TOLERANCE)
    constant = Quantity(1.0, "N m/A", "test", TOLERANCE)
    sheet = replace(sheet, parameters=sheet.parameters.replace(k_t=constant))
    case = make_case([record()], [], sheet, get_structure("rigid"))
    scales = scales_of(case.joint, case.logs)
    problem = Problem(case.fit)
    base = problem.fit(Model(case.joint, base_terms(case.joint, scales)))
    dry = next(t for t in candidates(case.joint, scales, case.logs) if t.name == "coulomb")
    fit = problem.fit(*added(base, dry, (DRY,)))
    found = spread_of(problem, fit)
    names = [term.name for term in fit.model.terms]
    ends = {name: found.intervals(names.index(name)) for name in ("torque_constant", "coulomb")}
    constant_half, dry_half = (
        0.5 * (x.high - x.low) / x.value for one in ends.values() for x in one.values()
    )
    # two tolerances, of inertia and torque constant, on one ratio: 10 % / sqrt(2) is a deviation
    expected = found.factor * TOLERANCE / np.sqrt(2.0)
    assert 0.5 * expected < constant_half < 1.5 * expected
    assert 0.5 * expected < dry_half < 1.5 * expected


def test_the_tolerance_of_a_listed_weight_is_one_of_all_torques() -> None:
    """A fit takes the weight as given, and with it the torque constant."""
    sheet = datasheet(1.0)
    sizes = []
    for weight in (None, 0.05, 0.2):
        entry = Quantity(0.3, "N m", "test", weight)
        file = sheet if weight is None else replace(sheet, effects={"gravity": {"torque": entry}})
        joint = Joint(file, "rigid", "current", {"gravity": {"torque": 0.3, "angle": 0.0}})
        joint = joint if weight else Joint(file, "rigid", "current", {})
        constant = Number("k_t", "N m/A", 1.0, 0.1, True)
        term = Term("torque_constant", (constant,), lambda draft, values: None, nominal=(1.0,))
        fit = Fit(Model(joint, (term,)), np.zeros(1), 0.0, [])
        sizes.append(0.1 * float(np.sqrt(_of_scale(fit, voltage=False)[0, 0])))
    both = [1.0 / np.sqrt(w**-2 + 0.1**-2) for w in (0.05, 0.2)]  # that of the constant, too
    assert sizes == pytest.approx([0.0, *both])


def test_values_are_not_exact_where_every_window_jumps() -> None:
    """Without any slope the covariance would be zero, and look like certainty."""
    smooth, bent = np.full(40, 0.002), BENT * np.linspace(1.1, 9.0, 60)
    assert list(counted(np.concatenate([bent, smooth]))) == [False] * 60 + [True] * 40
    all_bent = counted(bent)
    assert all_bent.sum() == round(KEPT * len(bent))
    assert bent[all_bent].max() < bent[~all_bent].min()


def test_what_the_datasheet_tells_stays_as_sure_where_a_model_errs() -> None:
    case = make_case([record()], [], datasheet(1.0, tolerance=TOLERANCE), get_structure("rigid"))
    inertia = base_terms(case.joint, scales_of(case.joint, case.logs))[0]
    damping = base_terms(case.joint, scales_of(case.joint, case.logs))[1]
    fit = Fit(Model(case.joint, (inertia, damping)), np.zeros(2), 0.0, [])
    assert [n.prior for n in fit.model.numbers] == [True, False]
    by_sheet, by_record = np.diag([1.0, 0.04]), np.diag([1e-4, 0.04])
    untold = Spread(fit, by_sheet, 2.0, by_sheet).wider(3.0).matrix
    assert untold == pytest.approx(np.diag([1.0, 0.36])), "the tolerance holds"
    told = Spread(fit, by_record, 2.0, by_record).wider(3.0).matrix
    assert told == pytest.approx(np.diag([9e-4, 0.36]), rel=2e-3), "the record's share widens"
