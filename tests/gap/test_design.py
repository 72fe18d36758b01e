"""The next experiment: within limits, telling where something can be told, silent where not."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.blind import make_bench
from cjt_gym.gap.candidates.separated import NOTHING, advice
from cjt_gym.gap.candidates.table import all_candidates
from cjt_gym.gap.diagnosis import Suggestion
from cjt_gym.gap.judged.replay import replay, written
from cjt_gym.gap.next_record.design import TELLS, bounds, pretended, prospects
from cjt_gym.gap.next_record.menu import MENU, REST
from cjt_gym.gap.next_record.suggest import _needs_more, record_of
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.fit import Fit, Model, Problem
from cjt_gym.joint import get_structure, load_joint_file
from cjt_gym.records import read_record

FIXED = "output_fixed_rigid_gearbox"
EXAMPLE = Path(__file__).parents[2] / "examples" / "cannot_tell.py"
SAMPLES = 3000


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """Return the problem of a locked joint whose current goes up and down at one slope."""
    bench = make_bench(3, FIXED, up_m=3.0, down_m=3.0)
    path = Path(tmp_path_factory.mktemp("bench")) / "nominal.toml"
    path.write_text(bench.datasheet(), encoding="utf-8")
    t = np.arange(SAMPLES) * bench.sheet.dt
    current = 12.0 * np.interp(t, [0.0, 0.3, 0.8, 1.8, 2.8, 3.8], [0.0, 0.0, 1.0, -1.0, 1.0, -1.0])
    record = bench.record(current)
    return Problem.of(Stages(make_setting(record, load_joint_file(path), get_structure(FIXED))))


def explained(problem: Problem, name: str, *values: float) -> Fit:
    """Return a model with one effect of given values, its datasheet nominal."""
    setting = problem.stages.setting
    effect = next(h for h in all_candidates(setting, problem.stages.names) if h.name == name)
    found = [u.coordinate(v) for u, v in zip(effect.unknowns, values, strict=True)]
    z = np.concatenate([np.zeros(len(problem.shared)), found])
    model = Model((effect,))
    residuals = problem.residuals(model, z)
    return Fit(model, z, 0.0, problem.mean_square(residuals), residuals)


def dry_or_viscous(problem: Problem) -> dict[str, Fit]:
    return {
        "damping": explained(problem, "damping", 2800.0),
        "coulomb": explained(problem, "coulomb", 3.0),
    }


@pytest.mark.slow
def test_damping_is_told_from_dry_friction(problem: Problem) -> None:
    fits = dry_or_viscous(problem)
    best, *rest = prospects(problem, fits)
    assert best.tells
    assert best.margin >= max((p.margin for p in rest), default=0.0)
    assert {(c.true, c.rival) for c in best.crosses} == {
        ("damping", "coulomb"),
        ("coulomb", "damping"),
    }
    assert min(c.margin for c in best.crosses) == best.margin
    assert all(c.residual > 1.3 for c in best.crosses)


@pytest.mark.slow
def test_every_experiment_keeps_to_the_limits_whatever_is_true(problem: Problem) -> None:
    fits = dry_or_viscous(problem)
    setting = problem.stages.setting
    within = bounds(setting)
    assert within.current <= 0.8 * setting.joint.parameters.i_p
    for prospect in prospects(problem, fits):
        assert np.abs(prospect.current).max() <= within.current
        for fit in fits.values():
            model = written(problem, fit.model, fit.z)
            out = replay(pretended(setting, model, prospect.current), model)
            assert np.abs(out["tau"]).max() <= 1.01 * within.torque


def test_equal_explanations_are_told_apart_by_nothing(problem: Problem) -> None:
    """With the output locked an offset of the motor and a bias of the sensor are the same."""
    fits = {
        "torque_offset": explained(problem, "torque_offset", 0.5),
        "torque_bias": explained(problem, "torque_bias", -0.5),
    }
    ranked = prospects(problem, fits)
    assert ranked
    assert not any(p.tells for p in ranked)


@pytest.mark.slow
def test_a_law_that_contains_the_other_does_not_hide_what_can_be_told(problem: Problem) -> None:
    """Stribeck's law explains Coulomb's data under any input; the other way round counts."""
    fits = {
        "coulomb": explained(problem, "coulomb", 3.0),
        "stribeck": explained(problem, "stribeck", 2.0, 4.0, 0.02),
    }
    best = prospects(problem, fits)[0]
    margins = {cross.true: cross.margin for cross in best.crosses}
    assert margins["coulomb"] < TELLS
    assert margins["stribeck"] == best.margin > TELLS


@pytest.mark.slow
def test_the_excitation_is_a_record_that_others_can_run(problem: Problem, tmp_path: Path) -> None:
    fits = dry_or_viscous(problem)
    best = prospects(problem, fits)[0]
    suggestion = Suggestion("text", excitation=record_of(problem, best))
    written = suggestion.written(tmp_path / "next.npz")
    assert written.record is not None
    again = read_record(written.record)
    p = problem.stages.setting.joint.parameters
    assert np.array_equal(again["i_cmd"], best.current)
    assert again["tau_cmd"] == pytest.approx(best.current * p.k_t * p.n)
    assert again.structure == FIXED
    assert again.provenance["excitation"] == best.input.name
    assert Suggestion("nothing to run").written(tmp_path / "none.npz").record is None


def test_no_current_is_advised_where_none_tells() -> None:
    said = _needs_more(("torque_offset", "coulomb_asym"), ())
    assert said.startswith("No current within the limits of the joint tells torque_offset from")
    assert "record" not in said
    assert "record a known weight" in _needs_more(("stiffness", "torque_gain"), ())


def test_a_suggestion_asks_for_what_is_open() -> None:
    assert advice("cogging", NOTHING).startswith("To tell whether there is cogging at all, record ")
    assert advice("coulomb", "stribeck").startswith("To tell coulomb from stribeck, record many ")


@pytest.mark.parametrize("name", list(MENU))
@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_inputs_begin_with_a_rest_and_stay_within_their_size(name: str, dt: float) -> None:
    samples = round(6.0 / dt)
    held, floating = (MENU[name].current(samples, dt, free) for free in (False, True))
    assert held.shape == floating.shape == (samples,)
    assert not held[: round(REST / dt)].any()
    assert 0.5 < np.abs(held).max() <= 1.0
    assert np.isfinite(floating).all()
    assert abs(np.mean(floating)) < 0.1


@pytest.mark.slow
def test_the_example_ends_with_the_truth() -> None:
    spec = importlib.util.spec_from_file_location("cannot_tell", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    before, after = example.main()
    assert any(e.confusable_with or e.status == "tentative" for e in before.effects)
    assert before.suggestion.excitation is not None
    assert [e.name for e in after.effects] == ["coulomb"]
    assert after.effects[0].confusable_with == ()
    level = after.effects[0].parameters["d_cm"]
    assert level.low <= 3.0 <= level.high
