"""Data sheets: what they say, both formats, the commands."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("typst")

from cjt_gym.analysis.open_loop import frequency_response
from cjt_gym.characteristics import CHARACTERISTICS, characteristics
from cjt_gym.cli import main
from cjt_gym.datasheet import make_sheet, quantities, write_sheet
from cjt_gym.datasheet.blocks import Facts, Figure, Heading, Paragraph, Sheet, Table
from cjt_gym.datasheet.notation import number, render, unit, with_tolerance
from cjt_gym.joint import JointFile, load_joint, load_joint_file
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity


@pytest.fixture(scope="module")
def orange() -> JointFile:
    file = load_joint_file("orange_80_6000")
    k_t = replace(file.parameters.quantities["k_t"], tolerance=0.03)
    return replace(file, parameters=file.parameters.replace(k_t=k_t))


@pytest.fixture(scope="module")
def sheet(orange: JointFile) -> Sheet:
    return make_sheet([orange])


def rows(sheet: Sheet) -> list[str]:
    tables = [block for block in sheet.blocks if isinstance(block, Table)]
    return [" | ".join(cells) for table in tables for cells in table.rows]


def test_a_sheet_has_every_quantity_with_unit_tolerance_and_source(sheet: Sheet) -> None:
    lines = rows(sheet)
    for row in CHARACTERISTICS.values():
        assert any(line.startswith(f"${row.symbol}$ |") and row.text in line for line in lines)
    assert any(line.startswith("$τ_p$ | 187.2 ± 5.6 | N m") for line in lines)
    assert any(line.startswith("$k_t$ | 0.0780 ± 0.0023 | N m/A") for line in lines)
    notes = [b.text for b in sheet.blocks if isinstance(b, Paragraph)]
    assert any("1: toolbox parameter set cjt_Orange_80_6000" in text for text in notes)
    assert any("cannot run at full speed continuously" in text for text in notes)
    assert sum(isinstance(block, Figure) for block in sheet.blocks) == 8


def test_a_sheet_claims_no_more_than_peak_speed_and_heat_allow(orange: JointFile) -> None:
    known = orange.parameters.quantities
    kept = {name: q for name, q in known.items() if not name.startswith(("Tmp_", "r_th", "T_th"))}
    kept["dq_p"] = Quantity(2.0, "rad/s")
    p = orange.parameters
    bare = JointParameters(p.name, p.source, kept, p.axis, p.origin)
    blocks = make_sheet([replace(orange, parameters=bare)]).blocks
    (facts,) = (b.items for b in blocks if isinstance(b, Facts))
    assert ("peak speed", "2", "rad/s") in facts
    assert ("peak mechanical power", "374", "W") in facts
    said = [b.caption for b in blocks if isinstance(b, Figure)]
    assert not any("continuous" in text or "rated" in text for text in said)
    (missing,) = (b.text for b in blocks if isinstance(b, Paragraph) and "Not drawn" in b.text)
    assert missing.count("Tmp_WMax of ") == 1


def test_both_formats_and_images(sheet: Sheet, tmp_path: Path) -> None:
    (pdf,) = write_sheet(sheet, tmp_path / "sheet.pdf")
    assert pdf.read_bytes().startswith(b"%PDF")
    assert 2 <= len(write_sheet(sheet, tmp_path / "sheet.png")) <= 4
    (page,) = write_sheet(sheet, tmp_path / "sheet.html")
    text = page.read_text(encoding="utf-8")
    assert text.count("<figure>") == 8
    assert "<i>k</i><sub>t</sub>" in text
    ids = re.findall(r'id="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    assert not re.findall(r'(?:src|href)="(?!#|data:)', text.replace("xlink:", ""))


def test_a_joint_with_few_parameters_has_a_short_sheet(tmp_path: Path) -> None:
    effects = {"coulomb": {"d_cm": Quantity(20.0, "N", low=19.0, high=21.0)}}
    file = replace(load_joint_file("emps"), effects=effects)
    sheet = make_sheet([file])
    lines = rows(sheet)
    assert not any(line.startswith("$τ_r$") for line in lines)
    headings = [block.text for block in sheet.blocks if isinstance(block, Heading)]
    assert "Effects beyond the linear joint" in headings
    assert "$d_cm$ | 20 (19 … 21) | N | Coulomb level of the motor" in lines
    assert any(line.startswith("$τ_C$ | 20.00 ± 0.51 | N |") for line in lines)
    notes = [block.text for block in sheet.blocks if isinstance(block, Paragraph)]
    assert any("another value of a parameter: coulomb." in text for text in notes)
    assert write_sheet(sheet, tmp_path / "emps.pdf")[0].stat().st_size > 10_000
    result = quantities([file])
    assert result["joints"]["emps"]["n"] == 1.0
    assert result["joints"]["emps"]["Mc"] == 20.0
    assert result["included"]["emps"] == ["coulomb"]


def test_torque_and_speed_need_three_numbers_and_what_is_not_drawn_says_why(
    tmp_path: Path,
) -> None:
    path = tmp_path / "mine.toml"
    numbers = {"I_m": (0.1, "kg m^2"), "k_t": (0.05, "N m/A"), "n": (100.0, "-")}
    numbers |= {"r": (0.5, "ohm"), "v_0": (24.0, "V")}
    rows = [f'{key} = {{ value = {x}, unit = "{unit}" }}' for key, (x, unit) in numbers.items()]
    path.write_text("\n".join(['name = "mine"', 'source = "me"', "[parameters]", *rows]))
    sheet = make_sheet([load_joint_file(path)])
    captions = [block.caption for block in sheet.blocks if isinstance(block, Figure)]
    assert any(caption.startswith("Torque and speed") for caption in captions)
    notes = [block.text for block in sheet.blocks if isinstance(block, Paragraph)]
    (told,) = [text for text in notes if text.startswith("Not drawn.")]
    assert re.search(r"\bheat\b[^:]*: i_p of ", told)
    assert "is needed and absent" in told
    assert write_sheet(sheet, tmp_path / "mine.html")[0].is_file()


NAMES = ("lemon_50_6000", "avocado_100_21000")


def test_the_numbers_of_several_joints(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["datasheet", *NAMES, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    for name in NAMES:
        values = result["joints"][name]
        expected = characteristics(load_joint_file(name).parameters)
        assert values["t_r"] == expected["t_r"]
        assert values["x"] == values["l_a"]
        assert values["T_ss_p"] is None
        assert "resistance rises" in result["infinite"][name]["T_ss_p"]
        assert result["included"][name] == []
        assert set(expected) < set(values) <= set(result["units"])


@pytest.mark.slow
def test_several_joints_side_by_side(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "both.html"
    assert main(["datasheet", *NAMES, "--out", str(out)]) == 0
    text = out.read_text(encoding="utf-8")
    assert all(name.replace("_", " ") in text for name in NAMES)
    assert text.count("<figure>") == 5


def test_notation() -> None:
    def mark(text: str) -> str:
        return render(text, str, lambda x: f"<{x}>", lambda x: f"[{x}]")

    assert mark("at $k_t n i_c$, twice") == "at <k>[t] <n> <i>[c], twice"
    assert mark("$T_A + R P / (1 - a_CU R P), P = r i_p²$").endswith("<P> = <r> <i>[p]²")
    assert mark("$min(τ_p, τ_stall / 2)$") == "min(<τ>[p], <τ>[stall] / 2)"
    assert [unit(x) for x in ("kg m^2", "-", "N m/W^0.5")] == ["kg m²", "", "N m/√W"]
    assert [number(x) for x in (16000.0, 0.0, -2.5, 1.25e-7)] == ["16000", "0", "-2.5", "1.25·10⁻⁷"]
    assert with_tolerance(6000.0, 90.0) == "6000 ± 90"


def test_linear_analysis_from_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["orange_80_6000", "--structure", "output_fixed", "rigid_gearbox", "--drive", "rl"]
    assert main(["analyse", *words, "--input", "v", "--json"]) == 0
    cases = json.loads(capsys.readouterr().out)["cases"]
    assert list(cases) == ["orange_80_6000, output_fixed", "orange_80_6000, rigid_gearbox"]
    names = [mode["name"] for mode in cases["orange_80_6000, rigid_gearbox"]["poles"]]
    assert names == ["free motion", "resonance", "torsion-bar mode"]
    assert main(["analyse", "orange_80_6000", "--input", "v", "--json"]) == 2
    assert "needs a drive with a voltage" in capsys.readouterr().err
    for words, message in (
        (["--out", "linear.doc"], ".pdf, .html, .png"),
        (["--dt", "0", "--json"], "--dt must be > 0 and <= 0.1 s"),
        (["orange_80_6000", "--json"], "got orange_80_6000 twice"),
    ):
        assert main(["analyse", "orange_80_6000", *words]) == 2
        assert message in capsys.readouterr().err


def test_a_joint_with_friction_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    """Without effects the measurement is the linear joint; friction damps and distorts it."""
    seen = []
    for words in ([], ["--effect", "coulomb"]):
        assert main(["analyse", "orange_80_6000", *words, "--identify", "10", "--json"]) == 0
        cases = json.loads(capsys.readouterr().out)["cases"]
        seen.append(cases["orange_80_6000"]["identified"])
    linear, rubbing = seen
    joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects={})
    model = np.abs(frequency_response(joint, np.array(linear["f"]), dt=1e-3))
    np.testing.assert_allclose(linear["gain"], model, rtol=2e-3)
    assert linear["distortion"] < 1e-3
    assert rubbing["distortion"] > 0.05
    assert max(rubbing["gain"]) < 0.5 * max(linear["gain"])
    words = ["analyse", "orange_80_6000", "--output", "q_m", "--identify", "10", "--json"]
    assert main(words) == 2
    assert "leave --input and --output" in capsys.readouterr().err


@pytest.mark.slow
def test_the_measured_response_is_drawn_over_the_linear_one(tmp_path: Path) -> None:
    out = tmp_path / "seen.html"
    words = ["orange_80_6000", "--structure", "output_fixed", "output_fixed_rigid_gearbox"]
    words += ["--effect", "coulomb", "--identify", "10", "--out", str(out)]
    assert main(["analyse", *words]) == 0
    text = out.read_text(encoding="utf-8")
    assert len(re.findall(r"nonlinear distortion \d+\.?\d* % of the output", text)) == 2
    assert "best linear approximation of the simulated joint" in text
    assert "resonance" in text
