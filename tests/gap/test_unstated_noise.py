"""Joint files as most are written: no noise is stated, neither damping nor friction.

The records are those of a simulation that shares no code with the package.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym.blind import draw_case, write_case
from cjt_gym.blind.mix import recipe
from cjt_gym.gap import diagnose
from cjt_gym.gap.blind_case import diagnose_files
from cjt_gym.gap.recorded.noise import channel_noise
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.joint import get_structure
from tests.gap.series_elastic import FIXED, FREE, NOISE, STEP, Arm, log, sheet

ARM = Arm()


@pytest.mark.parametrize("structure", [FREE, FIXED])
def test_all_friction_is_found_where_no_noise_is_stated(tmp_path: Path, structure: str) -> None:
    """Held, damping alone was confirmed, of 0.98 N m s/rad: dry friction lay below the noise that
    a drive is allowed. Free, the noise of angles was taken for that of a 13 bit converter."""
    found = diagnose(log(structure), sheet(tmp_path))
    assert found.verdict == "explained"
    known = {s: one for e in found.effects for s, one in e.parameters.items()}
    true = {"d_m": ARM.d_m, "d_cm": ARM.dry} | ({"d_l": ARM.d_l} if structure == FREE else {})
    assert known.keys() == true.keys()
    for symbol, value in true.items():
        assert known[symbol].low < value < known[symbol].high, symbol
        assert known[symbol].value == pytest.approx(value, rel=0.02), symbol
    assert found.joint.parameters.d_gl == pytest.approx(ARM.damping, rel=0.1)


def test_noise_that_shows_counts_however_far_a_joint_turns(tmp_path: Path) -> None:
    made, file = log(FREE), sheet(tmp_path)
    drifting = made.with_columns({n: made[n] + 5.0 * made["t"] for n in ("q_m", "q_l")})
    for record in (made, drifting):
        noise = make_setting(record, file, get_structure(FREE)).noise
        for name in ("q_m", "q_l"):
            assert noise[name].std < 2.0 * STEP
        assert noise["tau"].std == pytest.approx(NOISE["tau"], rel=0.1)
    smooth = made.with_columns({"q_m": np.sin(made["t"])})
    series = make_setting(smooth, file, get_structure(FREE)).series
    assert channel_noise(series, file, "q_m", 0.0).std == pytest.approx(7e-5, rel=0.1)


@pytest.mark.slow
def test_a_finer_law_is_chosen_below_the_noise(tmp_path: Path) -> None:
    """Plain dry friction of 0.17 N m was confirmed in the place of bristles that slip at 0.19."""
    made = recipe(501, 8, logs="bare")
    assert made.effects == ("presliding",)
    case = draw_case(
        made.seed, effects=made.effects, structure=made.structure, defects=made.defects
    )
    told = diagnose_files(write_case(case, tmp_path / "case"))
    (bristles,) = told["effects"]
    assert (bristles["name"], bristles["status"]) == ("presliding", "confirmed")
    true = case.label["parameters"]["presliding"]["d_cm"]
    assert bristles["parameters"]["d_cm"]["low"] < true < bristles["parameters"]["d_cm"]["high"]
