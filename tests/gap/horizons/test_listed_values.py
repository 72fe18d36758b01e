"""Friction and weight that a joint file lists with a tolerance, and that are others in truth.

The joint is simulated in plain NumPy, which shares no formula with the project.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.recorded.tolerances import is_left_open, unlisted
from cjt_gym.joint import load_joint_file
from cjt_gym.records import Record

DT, FINE = 2e-3, 10
INERTIA, DAMPING, DRY, WEIGHT = 0.8, 1.5, 1.2, 13.0
ARM = """
name = "arm"
source = "made up"
structure = "rigid"

[parameters]
I_m = {{ value = 0.8, unit = "kg m^2", source = "datasheet", tolerance = 0.05 }}
I_g = {{ value = 0.0, unit = "kg m^2", source = "within I_m" }}
I_l = {{ value = 0.0, unit = "kg m^2", source = "none" }}
d_m = {{ value = 1.5, unit = "N m s/rad", source = "datasheet", tolerance = 0.2 }}
n = {{ value = 50.0, unit = "-", source = "gear" }}
k_t = {{ value = 0.1, unit = "N m/A", source = "datasheet", tolerance = 0.03 }}
d_cm = {{ value = {dry}, unit = "N m", source = "datasheet", tolerance = 0.2 }}

[effects.coulomb]
{more}
"""
LISTED = """
[effects.gravity]
torque = { value = 9.0, unit = "N m", source = "datasheet", tolerance = 0.05 }
angle = { value = 0.0, unit = "rad", source = "datasheet" }
"""


def moved(weight: float, dry: float = DRY, seed: int = 0) -> Record:
    """Return 16 s of an arm that a controller moves about, and that sticks as it should."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(8000)
    w, phase = rng.uniform(1.0, 9.0, 5), rng.uniform(0.0, 2.0 * np.pi, 5)
    wish = 0.5 * np.sin(np.outer(t, w) + phase).sum(axis=1) / np.sqrt(w).sum() * 3.0
    q, v, h, rows = wish[0], 0.0, DT / FINE, []
    for aim in wish:
        torque = 200.0 * (aim - q) - 20.0 * v
        rows.append((q, torque / 5.0))
        for _ in range(FINE):
            free = v + h / INERTIA * (torque - DAMPING * v - weight * np.sin(q))
            v = np.sign(free) * max(abs(free) - h / INERTIA * dry, 0.0)
            q += h * v
    angle, current = np.array(rows).T
    columns = {"t": t, "q_m": np.round(angle / 1e-4) * 1e-4, "i_cmd": current}
    return Record(columns, {"t": "s", "q_m": "rad", "i_cmd": "A"}, structure="rigid")


def diagnosed(folder: Path, record: Record, dry: float = DRY, more: str = "") -> Diagnosis:
    path = folder / "arm.toml"
    path.write_text(ARM.format(dry=dry, more=more))
    return diagnose(record, load_joint_file(path), "rigid")


@pytest.mark.slow
def test_a_payload_is_told_as_the_weight(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, moved(WEIGHT), more=LISTED)
    (told,) = found.effects
    assert (told.name, told.status) == ("gravity", "tentative")
    assert told.parameters["torque"].value == pytest.approx(WEIGHT, rel=0.03)
    assert "torque_constant" in told.confusable_with
    assert found.joint.effects["gravity"]["torque"].number == pytest.approx(WEIGHT, rel=0.03)  # type: ignore[union-attr]


@pytest.mark.slow
def test_the_weight_that_is_listed_is_no_cause(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, moved(9.0), more=LISTED)
    assert (found.verdict, found.effects) == ("no_gap", ())


@pytest.mark.slow
def test_friction_twice_as_large_as_listed_is_told(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, moved(0.0, 4.0 * DRY), dry=2.0 * DRY)
    told = {e.name: e for e in found.effects}
    assert told["coulomb"].parameters["d_cm"].value == pytest.approx(4.0 * DRY, rel=0.05)
    assert found.verdict == "explained"


@pytest.mark.slow
def test_friction_within_its_tolerance_is_not_the_torque_constant_s(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, moved(0.0, 0.87 * 4.0), dry=4.0)
    assert (found.verdict, found.effects) == ("no_gap", ())
    assert found.joint.effects["coulomb"]["d_cm"].number == pytest.approx(0.87 * 4.0, rel=0.03)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("torque", "angle", "open_"), [(9.4, 0.0, True), (13.0, 0.0, False), (9.0, 0.5, False)]
)
def test_a_weight_is_as_listed_within_its_tolerance(
    tmp_path: Path, torque: float, angle: float, open_: bool
) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(ARM.format(dry=DRY, more=LISTED))
    file = load_joint_file(path)
    assert is_left_open(file, "gravity", {"torque": torque, "angle": angle}) == open_


@pytest.mark.slow
def test_friction_as_stated_but_not_listed_is_a_cause(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    text = ARM.format(dry=DRY, more="")
    path.write_text(text[: text.index("[effects")])
    found = diagnose(moved(0.0), load_joint_file(path), "rigid")
    assert [(e.name, e.status) for e in found.effects] == [("coulomb", "confirmed")]
    assert found.effects[0].parameters["d_cm"].value == pytest.approx(DRY, rel=0.05)


@pytest.mark.parametrize("listed", [False, True])
def test_friction_that_a_file_states_and_does_not_list_is_told(
    tmp_path: Path, listed: bool
) -> None:
    stated, has = tmp_path / "arm.toml", tmp_path / "has.toml"
    text = ARM.format(dry=DRY, more='d_cm = { value = 1.3, unit = "N m", source = "found" }')
    has.write_text(text)
    stated.write_text(text if listed else text[: text.index("[effects")])
    sheet, found = load_joint_file(stated), load_joint_file(has)
    said = unlisted(sheet, found, [])
    assert ["d_cm" in one and "[effects.coulomb]" in one for one in said] == [True] * (not listed)
    assert not unlisted(sheet, found, ["coulomb"])
