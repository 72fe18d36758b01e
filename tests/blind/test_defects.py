"""Defects of the logs: in the files as they are in the key, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym.blind import draw_case, write_case
from cjt_gym.blind.defects import GUESS, LOST, NOISE, Defects, draw_defects, not_counted
from cjt_gym.blind.joints import draw_joint
from cjt_gym.blind.plant import CHANNELS, STRUCTURES
from cjt_gym.errors import UnknownNameError
from cjt_gym.joint.files.joint_file import load_joint_file
from cjt_gym.records import read_record
from tests.blind.joints import LOCKED, short

DT = 1e-3
WORLD, SHEET = draw_joint(STRUCTURES[LOCKED], np.random.default_rng(4))
TOGETHER = ("noise", "jitter", "gaps", "missing", "guess")


def drawn(kind: str, seeds: int = 20, structure: str = LOCKED) -> list[Defects]:
    """Return many defects of one kind."""
    form = STRUCTURES[structure]
    return [draw_defects((kind,), form, SHEET, np.random.default_rng(k)) for k in range(seeds)]


def test_without_defects_all_is_as_stated() -> None:
    clean = short()
    assert clean.label["defects"] == {}
    assert clean.label["not_counted"] == []
    assert clean.sheet.noise == clean.world.noise
    assert clean.sheet.guesses == ()
    assert Defects().stated(SHEET) == SHEET
    assert Defects().applied(WORLD) == WORLD


def test_stated_noise_is_wrong_by_a_half_to_three() -> None:
    found = [(flaws, flaws.stated(SHEET)) for flaws in drawn("noise")]
    factors = np.array([[flaws.noise[name] for name in SHEET.channels] for flaws, _ in found])
    assert factors.shape == (20, len(SHEET.channels))
    assert np.all((factors >= NOISE[0]) & (factors <= NOISE[1]))
    assert factors.min() < 0.6
    assert factors.max() > 2.5
    for flaws, told in found:
        for name, factor in flaws.noise.items():
            j = CHANNELS.index(name)
            assert told.noise[j] == pytest.approx(factor * SHEET.noise[j])
        assert replace(told, noise=SHEET.noise) == SHEET
        assert flaws.applied(WORLD) == WORLD


def test_lost_stretches() -> None:
    """Of 20 to 200 ms, as rows that are gone or that have no measured values."""
    rows = {"t": np.arange(10_000) * DT, "i_cmd": np.ones(10_000), "tau": np.ones(10_000)}
    flaws = drawn("gaps")
    assert {f.empty for f in flaws} == {False, True}
    for k, flaw in enumerate(flaws):
        left = flaw.lost(rows, DT, np.random.default_rng(k))
        assert (len(left["t"]) == 10_000) == flaw.empty
        assert np.all(left["i_cmd"] == 1.0)
        steps = np.diff(left["t"][~np.isnan(left["tau"])])
        holes = steps[steps > 1.5 * DT] - DT
        assert 1 <= len(holes) <= 4
        assert holes.min() >= LOST[0] - 0.6 * DT
        assert holes.sum() <= 4.0 * (LOST[1] + 0.6 * DT)


def test_one_channel_is_missing_or_all_but_the_motor_angle() -> None:
    gone = {flaws.missing for flaws in drawn("missing")}
    assert gone == {("i",), ("tau",), ("q_l",)}
    left = {flaws.stated(SHEET).channels for flaws in drawn("command_only")}
    assert left == {("q_m",)}


@pytest.mark.parametrize(
    ("structure", "names"),
    [
        (LOCKED, {("inertia",)}),
        ("rigid_gearbox", {("inertia",), ("load_inertia",), ("inertia", "load_inertia")}),
        ("rigid", {("inertia", "load_inertia")}),
    ],
)
def test_guessed_inertias_are_not_counted(structure: str, names: set[tuple[str, ...]]) -> None:
    seen = set()
    for flaws in drawn("guess", structure=structure):
        told = flaws.stated(SHEET)
        assert set(told.guesses) in ({"I_m", "I_g"}, {"I_l"}, {"I_m", "I_g", "I_l"})
        for symbol, value in told.values.items():
            factor = value / SHEET.values[symbol]
            assert (factor == 1.0) == (symbol not in told.guesses)
            assert GUESS[0] <= factor <= GUESS[1]
        seen.add(tuple(not_counted(STRUCTURES[structure], told, WORLD, [])))
    assert seen == names


def test_noise_above_what_is_stated_is_not_counted() -> None:
    """Where the joint file promises too little, `noise` is no wrong name; hidden, it counts."""
    form = STRUCTURES[LOCKED]
    for share, names in ((0.5, ["noise:i", "noise:tau"]), (0.9, []), (3.0, [])):
        told = Defects(("noise",), noise={"tau": share, "i": share}).stated(SHEET)
        assert not_counted(form, told, WORLD, []) == names
        assert not_counted(form, told, WORLD, ["noise:tau"]) == names[:1]
        unseen = replace(told, channels=("q_m",))
        assert not_counted(form, unseen, WORLD, []) == []


@pytest.mark.parametrize("kinds", [TOGETHER, ("command_only",)])
def test_files_tell_of_the_defects_what_a_user_would_know(
    kinds: tuple[str, ...], tmp_path: Path
) -> None:
    """The joint file has the stated noise and marks guesses; the log lacks what is lost."""
    rough = short(defects=kinds)
    folder = write_case(rough, tmp_path / "case")
    told: dict[str, Any] = rough.label["defects"]
    assert tuple(told) == kinds
    joint = load_joint_file(folder / "nominal.toml")
    marked = {name for name, q in joint.parameters.quantities.items() if q.guess}
    assert marked == set(told.get("guess", {}).get("guessed_over_stated", {}))
    missing = {name for kind in kinds for name in told[kind].get("channels", [])}
    assert missing
    for name in ("diagnose", "validate"):
        record = read_record(folder / f"{name}.npz", allow_nan=True)
        assert set(record.columns) == {"t", "i_cmd", "i", "q_m", "q_l", "tau"} - missing
        whole = not any(np.isnan(values).any() for values in record.columns.values())
        assert (len(record) == 2000 and whole) == ("gaps" not in kinds)


def test_a_bare_datasheet_states_values_and_nothing_of_how_well_they_are_known(
    tmp_path: Path,
) -> None:
    plain, bare = (
        write_case(short(defects=kinds), tmp_path / f"case_{len(kinds)}")
        for kinds in ((), ("bare",))
    )
    full, told = (load_joint_file(folder / "nominal.toml") for folder in (plain, bare))
    assert full.sensors
    assert full.sampling
    assert not told.sensors
    assert not told.sampling
    known, left = full.parameters.quantities, told.parameters.quantities
    assert known.keys() - left.keys() == {"d_gl"}
    assert not any(q.tolerance or q.guess for q in left.values())
    assert all(q.value == known[symbol].value for symbol, q in left.items())


def test_jitter_is_that_of_the_instants() -> None:
    stds = [flaws.jitter for flaws in drawn("jitter")]
    assert all(std is not None and 0.02 * DT <= std <= 0.14 * DT for std in stds)
    for seed in (4, 5):
        rough = short(seed, defects=TOGETHER)
        told = rough.label["defects"]["jitter"]
        assert rough.world.jitter == told["std"] > rough.sheet.jitter
        t = rough.diagnose.columns["t"]
        late = t - DT * np.rint(t / DT)
        expected = told["std"] if told["stamped"] else 0.0
        assert late.std() == pytest.approx(expected, rel=0.1, abs=1e-9)


def test_defects_leave_joint_and_effects_alone() -> None:
    plain, rough = short(), short(defects=("command_only",))
    for name, values in rough.diagnose.columns.items():
        np.testing.assert_array_equal(values, plain.diagnose.columns[name])
    assert rough.label["parameters"] == plain.label["parameters"]


@pytest.mark.slow
def test_what_is_not_recorded_or_only_guessed_is_harder_to_see() -> None:
    def seen(effect: str, *defects: str) -> float:
        label = short(5, effect, defects=defects).label
        return float(label["signature"][effect.split(":")[0]])

    assert seen("torque_bias", "command_only") < 0.1
    assert seen("inertia", "guess") < 0.5 * seen("inertia")
    assert seen("noise:q_m", "noise") < seen("noise:q_m")


def test_wrong_name_of_a_defect() -> None:
    with pytest.raises(UnknownNameError, match="gaps"):
        draw_case(0, defects=["gap"])
