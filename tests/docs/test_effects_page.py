"""The page of effects is what the table says; its snippets work; its figures can be drawn."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cjt_gym.cli import main as cjt_gym
from cjt_gym.joint import EFFECTS, Effect, Joint, load_joint, load_joint_file, to_toml
from cjt_gym.joint.configure import resolve_effects
from tools.effects_page import __main__ as tool
from tools.effects_page import page
from tools.effects_page.bench import JOINT
from tools.effects_page.figures import PLOTS
from tools.effects_page.snippets import python_snippet, toml_snippet
from tools.effects_page.style import save

ROWS = pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda effect: effect.name)
LARGEST = 60_000
"""Bytes of a figure: they are kept in the repository."""
FAST = ("current_saturation", "torque_gain", "eccentricity", "load_coulomb")


def test_every_effect_has_a_figure_with_equation_and_caption() -> None:
    assert set(PLOTS) == set(EFFECTS)
    for plot in PLOTS.values():
        assert plot.equation
        assert plot.caption.endswith(".")


def test_the_check_notices_a_changed_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = tmp_path / "effects.md"
    changed.write_text(page.page_text().replace("Coulomb", "Culomb"), encoding="utf-8")
    monkeypatch.setattr(tool, "PAGE", changed)
    assert tool.main(["--check"]) == 1
    assert "effects.md differs: python -m tools.effects_page" in capsys.readouterr().err


@ROWS
def test_the_page_names_all_parameters_of_an_effect(effect: Effect) -> None:
    section = page.page_text().split(f"\n### {effect.name}\n")[1].split("\n### ")[0]
    for p in effect.parameters:
        assert f"`{p.symbol}`" in section
        assert p.description.replace("*", "\\*").replace("|", "\\|") in section
    assert effect.source in section


@ROWS
def test_both_snippets_give_the_same_joint(effect: Effect, tmp_path: Path) -> None:
    names: dict[str, Joint] = {}
    exec(python_snippet(effect), {"load_joint": load_joint}, names)
    joint = names["joint"]
    assert list(joint.effects) == [effect.name]
    path = tmp_path / "mine.toml"
    path.write_text(f"{to_toml(load_joint_file(JOINT))}\n{toml_snippet(effect)}", encoding="utf-8")
    file = load_joint_file(path)
    assert resolve_effects(None, file, joint.structure_row, joint.drive) == joint.effects


def test_figures_are_those_of_the_effects_small_and_say_no_date() -> None:
    assert {path.name for path in page.FIGURES.iterdir()} == {f"{name}.svg" for name in EFFECTS}
    for path in page.FIGURES.iterdir():
        text = path.read_text(encoding="utf-8")
        assert len(text) <= LARGEST
        assert "date" not in text


@pytest.mark.parametrize("name", FAST)
def test_a_figure_can_be_drawn_with_units_on_every_axis(name: str, tmp_path: Path) -> None:
    figure = PLOTS[name].draw()
    for axes in figure.axes:
        for text in (axes.get_xlabel(), axes.get_ylabel()):
            assert text.endswith("]")
    assert save(figure, tmp_path / f"{name}.svg").stat().st_size > 10_000


def test_a_figure_is_the_same_each_time(tmp_path: Path) -> None:
    draw = PLOTS["spring_hysteresis"].draw
    one, again = (save(draw(), tmp_path / f"{x}.svg").read_text(encoding="utf-8") for x in "ab")
    assert one == again


def test_joints_prints_strict_json_and_narrow_text(capsys: pytest.CaptureFixture[str]) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    assert cjt_gym(["joints", "--json"]) == 0
    tables = json.loads(capsys.readouterr().out, parse_constant=refuse)
    for row, effect in zip(tables["effects"], EFFECTS.values(), strict=True):
        assert row["size"] == list(effect.size)
        assert row["structures"]
        assert row["drives"]
        for said, p in zip(row["parameters"], effect.parameters, strict=True):
            assert (said["minimum"] is None) == p.signed
            for key in ("default", "joint_parameter", "typical_of", "shared", "relative_to"):
                assert said[key] == getattr(p, key)
    assert cjt_gym(["joints"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    assert not any(line != line.rstrip() for line in lines)
