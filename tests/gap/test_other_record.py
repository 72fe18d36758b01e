"""A gap that only the validation record shows, values settled by the replay, a weak record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.blind import make_bench
from cjt_gym.gap import diagnose
from cjt_gym.joint import load_joint_file
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record
from tests.gap.simulator import TRUE, nominal, simulate

FIXED = "output_fixed_rigid_gearbox"


def slowly(wanted: np.ndarray) -> np.ndarray:
    """Return the current of a slow ramp, whatever is wanted [A], shape (N,)."""
    return 3.0 * np.sin(2.0 * np.pi * np.arange(len(wanted)) / len(wanted))


def small_and_large() -> tuple[Record, Record, str]:
    """Return records of a spring whose stiffening only the larger motion shows, and its sheet."""
    plain = make_bench(3, FIXED)
    sheet = plain.sheet
    stated = sheet.values
    bend = 0.3 * sheet.i_p * stated["k_t"] * stated["n"] / stated["k_b"]
    bench = make_bench(3, FIXED, k_3=0.5 * stated["k_b"] / bend**2)
    t = np.arange(0.0, 8.0, sheet.dt)
    wave = sum(np.sin(2.0 * np.pi * f * t + f) for f in (0.3, 0.7, 1.9, 4.1, 8.3)) / 5.0
    one = bench.record(0.01 * sheet.i_p * wave, seed=1)
    two = bench.record(0.3 * sheet.i_p * wave, seed=2)
    return one, two, bench.datasheet()


@pytest.mark.slow
def test_a_gap_that_only_the_validation_record_shows_is_explained(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    one, two, text = small_and_large()
    path = tmp_path_factory.mktemp("sheet") / "nominal.toml"
    path.write_text(text, encoding="utf-8")
    joint = load_joint_file(path)
    found = diagnose(one, joint, FIXED, validate=two)
    assert [effect.name for effect in found.effects] == ["hardening"]
    assert f"{len(two)} samples" in found.evidence.source.fitted[0]


def test_a_guess_that_only_the_validation_record_refutes_is_corrected_by_it() -> None:
    """Slow motion tells nothing of an inertia."""
    quick = simulate(seconds=3.0)
    slow = simulate(seconds=3.0, drive=slowly)
    slow = slow.with_columns({"i_cmd": slowly(slow["i_cmd"])})
    guess = Quantity(0.7 * TRUE["I_m"], "kg m^2", "guess", guess=True)
    sheet = nominal()
    sheet = replace(sheet, parameters=sheet.parameters.replace(I_m=guess))
    found = diagnose(slow, sheet, validate=quick)
    assert found.verdict == "no_gap"
    assert found.effects == ()
    assert found.joint.parameters.I_m == pytest.approx(TRUE["I_m"], rel=0.02)


@pytest.mark.slow
def test_values_within_their_tolerance_are_refined_by_the_replay() -> None:
    found = diagnose(simulate(), nominal(I_m=1.02, k_b=0.985), validate=simulate(seed=1))
    assert found.verdict == "no_gap"
    assert found.gap.after < 0.2 * found.gap.before
    assert found.joint.parameters.I_m == pytest.approx(0.3, rel=0.005)
    assert found.joint.parameters.k_b == pytest.approx(6000.0, rel=0.005)


@pytest.mark.slow
def test_a_short_record_is_followed_by_a_request_for_a_better_one() -> None:
    found = diagnose(simulate(seconds=3.0, friction=(1.5, 1.5)), nominal())
    assert [effect.name for effect in found.effects] == ["coulomb"]
    assert "record 10 s" in found.suggestion.text
