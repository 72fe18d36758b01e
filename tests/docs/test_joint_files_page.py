"""The page on joint files: its file loads, its examples run, its drawing has the symbols."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from cjt_gym.cli import main
from cjt_gym.joint import load_joint
from cjt_gym.joint.files.quantity import QUANTITY_KEYS
from tests.docs.pages import DOCS, blocks, page

TEXT = page("joint_files")


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(blocks(TEXT, "toml")[0], encoding="utf-8")
    return path


def test_the_file_of_the_page_is_the_joint_of_its_table(
    arm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    joint = load_joint(arm)
    p = joint.parameters
    assert (joint.structure, joint.drive, tuple(joint.effects)) == (
        "rigid_gearbox",
        "current",
        ("coulomb",),
    )
    assert pytest.approx(0.181) == p.I_m
    assert pytest.approx(6016.06, abs=0.01) == p.k_b
    no_load = p.d_cm + p.d_m * 6110 / 100 * 2 * 3.14159265 / 60
    assert no_load == pytest.approx(p.k_t * 0.234 * p.n, rel=0.01)
    assert main(["joints", str(arm)]) == 0
    assert "d_cm      0.6 N m (guess)" in capsys.readouterr().out
    record = joint.simulate([1.0] * 100)
    assert record["true_dq_m"][-1] > 0.0


def test_the_page_names_every_key_of_an_entry() -> None:
    assert all(f"`{key}" in TEXT for key in QUANTITY_KEYS)


def test_the_drawing_has_the_symbols_of_the_joint() -> None:
    drawing = ElementTree.parse(DOCS / "figures" / "joint.svg")
    words = "".join(drawing.getroot().itertext())
    for symbol in ("Im", "kg", "dmg", "kb", "dgl", "dcm", "kt", "ql"):
        assert symbol in words
