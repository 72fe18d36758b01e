"""The report of a diagnosis: its numbers, its words, and what a browser makes of it."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.errors import ConfigurationError
from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.candidates.table import all_candidates
from cjt_gym.gap.judged.replay import written
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.gap.report import summary, write_report
from cjt_gym.gap.report.drawing import COLOURS
from cjt_gym.gap.report.figures import worst
from cjt_gym.gap.report.gather import nothing_said
from cjt_gym.gap.report.maps import friction_maps, ripple, spring_loop
from cjt_gym.gap.report.page import page
from cjt_gym.gap.report.words import number, percent
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.fit import Model, Problem
from cjt_gym.joint import get_structure, load_joint, to_toml
from cjt_gym.records import Record, read_record
from tests.gap.browser import browser, look
from tests.gap.simulator import TRUE, nominal, simulate

FIXED = "output_fixed_rigid_gearbox"
LARGEST = 1e6  # [bytes]


# ---- what it rests on
def test_what_is_no_diagnosis_is_not_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="must be a Diagnosis"):
        write_report(None, tmp_path / "report.html")  # type: ignore[arg-type]


def test_the_ladder_leads_from_the_gap_before_to_the_gap_after(explained: Diagnosis) -> None:
    steps = explained.evidence.ladder
    assert [step.name for step in steps] == ["nominal", "tolerances", "coulomb_asym"]
    assert steps[0].error == pytest.approx(explained.gap.before)
    assert steps[-1].error == pytest.approx(explained.gap.after)
    assert all(step.low <= step.error <= step.high for step in steps)


@pytest.mark.filterwarnings("ignore::cjt_gym.errors.OutsideFoundWarning")
def test_what_is_drawn_is_what_the_written_joint_does(explained: Diagnosis, tmp_path: Path) -> None:
    path = tmp_path / "joint.toml"
    path.write_text(to_toml(explained.joint), encoding="utf-8")
    joint, held = load_joint(path, FIXED), simulate(seconds=3.0, seed=1, friction=(2.6, 1.9))
    torque = held["i_cmd"] * joint.parameters.k_t * joint.parameters.n
    run = joint.simulate(torque, dt=held.dt, dt_physics=1e-4)
    drawn = explained.evidence.replays["tau"]["after"]
    assert np.std(run["true_tau"] - drawn) < 0.005 * np.std(drawn)


def test_where_nothing_is_named_no_effect_is_a_step_of_the_ladder(
    clean: Diagnosis, unexplained: Diagnosis
) -> None:
    for found in (clean, unexplained):
        assert not found.effects
        assert {step.name for step in found.evidence.ladder} <= {"nominal", "tolerances"}
    assert unexplained.stages["motor"].after > 1.5


@pytest.mark.parametrize(
    "variable", ["dq_m", "q_m", "tau", "t", "frequency", "cycles_per_rev", "i"]
)
def test_the_shares_of_every_variable_add_up_to_one(explained: Diagnosis, variable: str) -> None:
    before, after = explained.evidence.regimes["motor"]
    shares = [r.share for r in before if r.variable == variable]
    left = [r.share for r in after if r.variable == variable]
    assert sum(shares) == pytest.approx(1.0, abs=1e-9)
    assert sum(left) < 0.1
    assert explained.regimes == before


def test_a_torque_that_repeats_with_the_angle_is_a_line() -> None:
    record = simulate(seconds=4.0, extra=lambda t, q, v: 1.5 * np.cos(4000.0 * q))
    stages, fields = prepared(record)
    residual = stages.residual("motor", fields)
    found = ripple(stages, (fields, residual), (fields, residual))
    assert found is not None
    peak = int(np.argmax(found.before))
    assert found.cycles[peak] == pytest.approx(4000.0, rel=0.03)
    assert found.before[peak] == pytest.approx(1.5, rel=0.25)


def test_the_friction_map_shows_the_friction() -> None:
    record = simulate(seconds=3.0, friction=(2.6, 1.9))
    problem = Problem.of(Stages(make_setting(record, nominal(), get_structure(FIXED))))
    rows = all_candidates(problem.stages.setting, problem.stages.names)
    law = next(row for row in rows if row.name == "coulomb_asym")
    z = np.zeros(len(problem.shared))
    levels = [u.coordinate(x) for u, x in zip(law.unknowns, (2.6, 1.9), strict=True)]
    known = written(problem, Model((law,)), np.append(z, levels))
    (found,) = friction_maps(problem.stages, written(problem, Model(), z), known)
    fast = np.quantile(np.abs(found.speed), 0.7)
    assert np.median(found.before[found.speed > fast]) == pytest.approx(2.6, abs=0.15)
    assert np.median(found.before[found.speed < -fast]) == pytest.approx(-1.9, abs=0.15)
    assert np.median(np.abs(found.after)) < 0.15
    assert found.law[-1] == pytest.approx(2.6)
    assert found.law[0] == pytest.approx(-1.9)


def test_the_loop_of_the_spring_shows_its_play() -> None:
    def loose(x: float) -> float:
        return TRUE["k_b"] * (x - min(max(x, -2e-4), 2e-4))

    stages, fields = prepared(simulate(seconds=2.0, spring=loose))
    fields |= {"q_0": 0.0}
    found = spring_loop(stages, fields, fields | {"play": 4e-4})
    assert found is not None
    assert np.std(found.measured - found.after) < 0.2 * np.std(found.measured - found.before)


def prepared(record: Record) -> tuple[Stages, dict[str, float]]:
    """Return the tuned stages of a record and the fields of its nominal joint."""
    problem = Problem.of(Stages(make_setting(record, nominal(), get_structure(FIXED))))
    return problem.stages, problem.fields(Model(), np.zeros(len(problem.shared)))


# ---- what it leaves out
@pytest.mark.slow
def test_panels_of_a_stage_are_announced_only_where_they_are(explained: Diagnosis) -> None:
    known = explained.evidence.regimes
    assert known
    for regimes, panels, front in (
        (known, True, True),
        ({stage: (before, ()) for stage, (before, _) in known.items()}, True, False),
        ({}, False, False),
    ):
        text = page(
            replace(explained, evidence=replace(explained.evidence, regimes=regimes)), "gap"
        )
        assert ("Inside the" in text) == ("adds up to 100" in text) == panels
        assert ("In front, what is left" in text) == front


def test_a_floor_that_is_not_known_is_no_zero(explained: Diagnosis, tmp_path: Path) -> None:
    unknown = replace(explained, gap=replace(explained.gap, floor=0.0))
    assert "noise floor not known" in summary(unknown)
    path = tmp_path / "report.html"
    write_report(unknown, path)
    assert path.read_text(encoding="utf-8").count("not known") == 2


# ---- charts
def drawn(text: str, kind: str) -> list[list[str]]:
    """Return the texts of each picture in the figures of one class."""
    figures = re.findall(rf"<figure class={kind}>.*?</figure>", text, re.DOTALL)
    pictures = [p for f in figures for p in re.findall(r"<svg .*?</svg>", f, re.DOTALL)]
    return [[unescape(t) for t in re.findall(r"<text[^>]*>([^<]*)", p)] for p in pictures]


def test_the_stretch_that_is_enlarged_is_where_the_datasheet_errs_most() -> None:
    measured = np.zeros(10_000)
    off = measured.copy()
    off[4_000:4_500], off[8_000] = 1.0, 5.0
    assert worst({"measured": measured, "before": off}) == slice(4_000, 4_500)
    assert worst({"measured": measured[:150], "before": off[7_990:8_140]}) == slice(0, 45)


def test_the_steps_of_the_gap_have_their_numbers(explained: Diagnosis, tmp_path: Path) -> None:
    text = write_report(explained, tmp_path / "r.html").read_text("utf-8")
    steps, stages = drawn(text, "bars")
    for step in explained.evidence.ladder:
        assert percent(step.error) in steps
    assert {"Datasheet joint", "+ asymmetric Coulomb friction of the motor"} <= set(steps)
    assert percent(explained.gap.floor) in steps
    motor = explained.stages["motor"]
    assert {"motor: gap", "drive: no gap"} <= set(stages)
    assert f"{number(motor.before, 2)} → {number(motor.after, 2)}" in stages


@pytest.mark.slow
def test_a_model_with_effects_is_drawn_only_where_there_are_any(
    explained: Diagnosis, clean: Diagnosis, tmp_path: Path
) -> None:
    with_effects = drawn(write_report(explained, tmp_path / "a.html").read_text("utf-8"), "chart")
    without = drawn(write_report(clean, tmp_path / "b.html").read_text("utf-8"), "chart")
    assert all("with the effects" in texts for texts in with_effects)
    assert all("datasheet" in texts and "with the effects" not in texts for texts in without)
    assert any("fitted friction" in texts for texts in with_effects)


def test_the_pictures_take_the_colours_of_the_page(explained: Diagnosis, tmp_path: Path) -> None:
    text = write_report(explained, tmp_path / "r.html").read_text("utf-8")
    for name, colour in COLOURS.items():
        assert f"--{name}: {colour};" in text
    pictures = "".join(re.findall(r"<svg .*?</svg>", text, re.DOTALL))
    assert not re.search(r"#[0-9a-f]{6}[;\"]", pictures)


def test_no_two_pictures_share_an_identifier(explained: Diagnosis, tmp_path: Path) -> None:
    text = write_report(explained, tmp_path / "r.html").read_text("utf-8")
    known = re.findall(r'\bid="([^"]+)"', text)
    assert len(known) == len(set(known))
    used = re.findall(r'(?:href="|url\()#([^")]+)', text)
    assert used
    assert set(used) <= set(known)


@pytest.mark.slow
def test_the_same_diagnosis_gives_the_same_file(explained: Diagnosis, tmp_path: Path) -> None:
    first, second = (write_report(explained, tmp_path / f"{k}.html") for k in range(2))
    assert first.read_bytes() == second.read_bytes()


# ---- the file
@pytest.mark.slow
def test_the_report_is_one_file_without_links(explained: Diagnosis, tmp_path: Path) -> None:
    path = write_report(explained, tmp_path / "deep" / "report.html")
    text = path.read_text(encoding="utf-8")
    assert path.stat().st_size < LARGEST
    assert not re.search(r"https?://|\bsrc=|\bhref=(?!\"#)|@import|url\((?!#)|<script", text)
    for heading in (
        "How far",
        "Where",
        "Which effect",
        "Measured against replayed",
        "Maps of the fitted record",
        "How it was computed",
    ):
        assert f"<h2>{heading}</h2>" in text


def test_all_text_is_escaped(explained: Diagnosis, tmp_path: Path) -> None:
    evil = "<script>alert('x')</script> & \"more\""
    effect = replace(explained.effects[0], name=evil, confusable_with=(evil,))
    source = replace(explained.evidence.source, joint=evil, fitted=(evil,))
    forged = replace(
        explained,
        effects=(effect,),
        unexplained=replace(explained.unexplained, stage="motor", text=evil),
        suggestion=replace(explained.suggestion, text=evil),
        evidence=replace(explained.evidence, source=source),
    )
    text = write_report(forged, tmp_path / "r.html", title=evil, notes=[evil]).read_text()
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert" in text


def test_traces_stand_before_histograms_and_every_axis_is_labelled(
    explained: Diagnosis, tmp_path: Path
) -> None:
    text = write_report(explained, tmp_path / "r.html").read_text("utf-8")
    assert text.index("id=signals") < text.index("id=how-far") < text.index("id=where")
    charts, bars = drawn(text, "chart"), drawn(text, "bars")
    assert charts
    for texts in charts:
        assert len([t for t in texts if re.search(r" \[.+\]$|^cycles per", t)]) == 2
    assert "replay error, of the signal" in bars[0]
    assert "residual, 1 = noise" in bars[1]
    assert text.count("<div class=strip>") == text.count("share of the gap, up to")


def test_empty_sections_vanish(clean: Diagnosis, tmp_path: Path) -> None:
    text = write_report(clean, tmp_path / "r.html").read_text(encoding="utf-8")
    for heading in ("Which effect", "confused with", "unexplained</h2>", "Notes on"):
        assert heading not in text


def test_stages_that_could_not_be_judged_are_not_drawn(tmp_path: Path) -> None:
    found = nothing_said(nominal(), get_structure(FIXED), [], [], "too short")
    text = write_report(found, tmp_path / "r.html").read_text(encoding="utf-8")
    assert "<svg" not in text
    assert "too short" in text


def test_a_place_that_cannot_be_written_is_a_clear_error(clean: Diagnosis, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match="cannot be written"):
        write_report(clean, tmp_path / "file" / "report.html")


@pytest.mark.parametrize(
    "case",
    ["explained", "clean", "unexplained", pytest.param("emps", marks=pytest.mark.slow)],
)
def test_a_browser_draws_all_of_it(
    case: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    browser()
    if case == "emps":
        found = diagnose(read_record("emps").slice(0, 5000))
    else:
        found = request.getfixturevalue(case)
    path = write_report(found, tmp_path / "report.html", notes=["tau: 3 repeated rows left out"])
    seen = look(path, (1280, 400), tmp_path)
    assert seen["console"] == []
    for width, view in seen["views"].items():
        assert view["width"] == int(width)
        assert view["scroll"] <= view["width"]
        assert view["errors"] == []
        assert view["overflow"] == []
        assert view["plots"]
        assert all(w > 200 and h > 60 for w, h in view["plots"])
        assert all(w > 0 and h > 0 for w, h in view["curves"])
        assert all(w > 100 and h > 10 for w, h in view["columns"])
        assert min(view["letters"]) > 7.5
        assert view["clashes"] == []
