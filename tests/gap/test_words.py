"""What a diagnosis says in words: its sentences, its summary and the notes of its joint file."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from cjt_gym.commands.diagnose import joint_text
from cjt_gym.gap import Diagnosis
from cjt_gym.gap.check.faults import UNITS
from cjt_gym.gap.diagnose import remarked
from cjt_gym.gap.diagnosis import Horizon, Interval, NamedEffect, StageGap
from cjt_gym.gap.recorded.series import stretches
from cjt_gym.gap.report import summary
from cjt_gym.gap.report.page import page
from cjt_gym.gap.report.words import (
    effect_sizes,
    in_words,
    interval,
    number,
    percent,
    verdict_sentence,
)
from cjt_gym.joint import get_structure, load_joint_file
from tests.gap.simulator import simulate


def test_numbers_are_short_and_honest() -> None:
    assert number(0.00123456) == "0.00123"
    assert number(-31.4159, 2) == "\N{MINUS SIGN}31"
    assert number(0.0) == "0"
    assert number(4.2e-7, 2) == "4.2·10⁻⁷"
    assert percent(0.3141) == "31\N{NO-BREAK SPACE}%"
    assert percent(0.0046) == "0.46\N{NO-BREAK SPACE}%"
    assert interval(Interval(2.6123, 2.51, 2.72, "-")) == "2.61 (2.51 … 2.72)"
    at_an_end = Interval(20.0 - 4e-15, 1.0, 20.0, "-")
    assert interval(at_an_end) == "20 (1 … 20)"
    assert interval(Interval(18.3, 1.95, 12170.0, "-")) == "18 (2 … 12000)"  # a scale over decades
    assert interval(Interval(0.77, 0.77, 91584.0, "-")) == "0.77 (0.77 … 90000)"
    assert interval(Interval(0.31, 0.0004, 1.02, "-")) == "0.31 (0.00040 … 1.0)"


@pytest.mark.parametrize(("unit", "over"), [("N m", "revolution"), ("N", "2π m")])
def test_a_wave_repeats_over_a_revolution_or_over_metres(unit: str, over: str) -> None:
    sizes = {
        "f": Interval(14.0, 13.9, 14.1, "1/rev"),
        "a": Interval(0.3, 0.2, 0.4, unit),
        "b": Interval(0.4, 0.3, 0.5, unit),
    }
    wave = NamedEffect("cogging", "motor", "motor", None, sizes, "tentative", 0.5, 0.1)
    said = effect_sizes(wave).replace("\N{NO-BREAK SPACE}", " ")
    assert said.startswith(f"14.0 per {over}, 0.5")


def test_numbers_of_several_units_have_their_symbols() -> None:
    sizes = {"d_sm": Interval(0.02, 0.01, 0.03, "N m"), "v_s": Interval(11.0, 9.0, 12.0, "rad/s")}
    falling = NamedEffect("stribeck", "motor", "motor", None, sizes, "tentative", 0.5, 0.1)
    assert effect_sizes(falling).replace("\N{NO-BREAK SPACE}", " ") == (
        "d_sm = 0.020 N m, v_s = 11 rad/s"
    )


def test_noise_is_told_beside_a_gap_and_not_as_its_cause(explained: Diagnosis) -> None:
    size = {"noise": Interval(0.03, 0.02, 0.04, "A")}
    noise = NamedEffect("noise", "sensing", None, "i", size, "confirmed", 0.9, 0.1)
    noisy = replace(explained, effects=(noise,))
    assert "apart from that only sensors differ: noise above" in verdict_sentence(noisy)
    open_ = replace(explained.unexplained, stage="load")
    text = verdict_sentence(replace(noisy, verdict="partly_explained", unexplained=open_))
    assert "no effect of the table explains it; sensors differ as well: noise above" in text
    assert "part of it" not in text


@pytest.mark.parametrize(("found", "said"), [(0.023, True), (0.007, False)])
def test_no_gap_is_said_with_a_reserve_where_a_regression_predicts_the_rest(
    explained: Diagnosis, found: float, said: bool
) -> None:
    row = Horizon(0.5, "q_m", 0.023, None, found, 0.0064)
    text = verdict_sentence(replace(explained.without_gap(), horizons=(row,)))
    assert ("is hardly a gap" in text) == said
    assert ("no effect of the table explains the rest" in text) == said


@pytest.mark.parametrize(("cubic", "said"), [(9e3, "stiffens"), (-9e3, "softens")])
def test_a_spring_that_softens_is_not_said_to_stiffen(cubic: float, said: str) -> None:
    size = {"k_3": Interval(cubic, cubic, cubic, "N m/rad^3")}
    spring = NamedEffect("hardening", "transmission", None, None, size, "tentative", 0.5, 0.1)
    assert f"a spring that {said} with deflection" in in_words(spring)


def test_the_verdict_is_one_sentence(explained: Diagnosis) -> None:
    text = verdict_sentence(explained).replace("\N{NO-BREAK SPACE}", " ")
    assert re.match(r"The gap of [\d.]+ % lies in the motor stage", text)
    assert "asymmetric Coulomb friction of the motor (2.6 / 1.9 N m) explains" in text
    assert text.count(".  ") == 0
    assert text.endswith(" % of it.")


def test_the_verdict_tells_tentative_names_apart(explained: Diagnosis) -> None:
    (sure,) = explained.effects
    doubtful = replace(sure, name="stribeck", status="tentative")
    both = verdict_sentence(replace(explained, effects=(doubtful, sure)))
    assert re.search(r"; asymmetric Coulomb .*\), and tentatively Stribeck .*\), explain ", both)
    alone = verdict_sentence(replace(explained, effects=(doubtful,)))
    assert "; tentatively Stribeck friction" in alone


@pytest.mark.slow
def test_what_keeps_a_name_from_being_confirmed_is_told_once(explained: Diagnosis) -> None:
    (sure,) = explained.effects
    two = [replace(sure, name=name).doubted("nothing shows it") for name in ("stribeck", "damping")]
    other = replace(sure, name="gravity").doubted("it is small")
    told = replace(explained, effects=(sure, *two, other.doubted("not this")))
    lines = [line for line in summary(told).splitlines() if ": tentative, as" in line]
    assert lines == [
        "stribeck and damping: tentative, as nothing shows it",
        "gravity: tentative, as it is small",
    ]
    assert page(told, "gap").count("nothing shows it") == 2


def test_a_wrong_unit_is_said_before_all_else(explained: Diagnosis) -> None:
    exam = explained.examination
    assert exam is not None
    log = [simulate(seconds=2.0)]
    known = log, stretches(log), get_structure("output_fixed_rigid_gearbox"), ()
    text = remarked(explained, *known).unexplained.text
    assert text == explained.unexplained.text, "nothing is wrong with its units"
    wrong = replace(explained, examination=replace(exam, advice=(UNITS,)))
    assert remarked(wrong, *known).unexplained.text.startswith("Channels contradict each other")
    said = "i repeats i_cmd in every row, and was not used."
    copied = remarked(explained, *known[:3], [said]).unexplained.text
    assert copied.startswith(said)
    loose = {**explained.stages, "drive": StageGap(25.0, 25.0, False)}
    told = remarked(replace(explained, stages=loose), *known).unexplained.text
    assert told.startswith("The current follows its command less closely than noise allows")
    astray = {**explained.stages, "drive": StageGap(900.0, 800.0, False)}
    found = remarked(replace(explained, stages=astray), *known)
    assert (explained.verdict, found.verdict) == ("explained", "partly_explained")
    assert "Look at the columns of i and i_cmd" in found.unexplained.text
    assert "the rest is small" not in found.unexplained.text


def test_the_joint_file_says_which_names_it_does_without(explained: Diagnosis) -> None:
    (sure,) = explained.effects
    late = replace(sure, name="command_delay", stage="drive")
    told = replace(explained, effects=(sure, late, replace(sure, name="noise", stage="sensing")))
    head = joint_text(told, "run").partition("\nname = ")[0]
    assert "the named effects, 1 here." in head
    assert head.endswith("# Named, but not in here: noise.")
    assert "ot in here" not in joint_text(explained, "run")


def test_what_a_measured_current_has_passed_waits_in_the_joint_file(
    explained: Diagnosis, tmp_path: Path
) -> None:
    (sure,) = explained.effects
    delay = {"delay": Interval(0.004, 0.003, 0.005, "s")}
    late = replace(sure, name="command_delay", stage="drive", parameters=delay)
    path = tmp_path / "joint.toml"
    path.write_text(joint_text(replace(explained, effects=(sure, late)), "run"), encoding="utf-8")
    assert "command_delay" not in load_joint_file(path).effects
    text = path.read_text(encoding="utf-8")
    path.write_text(re.sub(r"^# (\[effects|delay)", r"\1", text, flags=re.M), encoding="utf-8")
    found = load_joint_file(path).effects["command_delay"]["delay"]
    assert (found.number, found.low, found.high) == (0.004, 0.003, 0.005)
    assert "uncomment" not in joint_text(explained, "run")


def test_no_gap_and_an_unknown_effect_have_their_sentences(
    clean: Diagnosis, unexplained: Diagnosis
) -> None:
    assert "no gap" in verdict_sentence(clean)
    assert "motor stage" in verdict_sentence(unexplained)


def test_a_partly_explained_gap_says_what_is_left(
    explained: Diagnosis, unexplained: Diagnosis
) -> None:
    partly = replace(explained, verdict="partly_explained", unexplained=unexplained.unexplained)
    sentence = verdict_sentence(partly)
    assert sentence.endswith("something in the motor stage stays unexplained.")
    assert sentence.count("%") <= 4  # no share of one measure beside the rest of another
    assert "of it," not in sentence.replace("part of it,", "")


def test_the_summary_fits_a_terminal(
    explained: Diagnosis, clean: Diagnosis, unexplained: Diagnosis
) -> None:
    for found in (explained, clean, unexplained):
        lines = summary(found).splitlines()
        assert len(lines) <= 25
        assert max(len(line) for line in lines) <= 120
    assert "coulomb_asym" in summary(explained)


def test_a_diagnosis_is_printed_as_a_sentence_and_a_table(explained: Diagnosis) -> None:
    text = str(explained)
    assert text == summary(explained)
    assert repr(explained) == "<Diagnosis: explained, coulomb_asym>"
    assert "<b>Explained.</b>" in explained._repr_html_()
    assert "<table>" in explained._repr_html_()


def test_effects_that_only_the_torque_shows_explain_no_part_of_the_gap(
    explained: Diagnosis,
) -> None:
    (effect,) = explained.effects
    said = verdict_sentence(explained)
    assert "explains" in said
    shown = replace(effect, status="tentative", gap_removed=0.0)
    told = verdict_sentence(replace(explained, effects=(shown,)))
    assert "refined values explain" in told
    assert "the torque shows tentatively" in told
