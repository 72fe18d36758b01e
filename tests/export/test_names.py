"""The name of a joint becomes text of other languages, and stays a name there."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import fromstring

import pytest

from cjt_gym.datasheet import make_sheet, write_sheet
from cjt_gym.datasheet.html import to_html
from cjt_gym.datasheet.pdf import to_typst
from cjt_gym.export import to_isaaclab, to_mujoco
from cjt_gym.joint import Joint, JointFile, load_joint, load_joint_file

NAMES = {
    "newline": "a\nevil: {class: x}\n#",
    "carriage return": "a\revil: 1",
    "line separator": "a\u2028evil: 1\x85evil: 2",
    "end of a comment": 'a --> <include file="/x"/> <!--',
    "end of an attribute": "a\"'/><evil/>",
    "formula": "a$\\frac$",
    "one dollar": "a$b",
    "backslash": "a\\",
    "typst": '#read("/etc/passwd") "#[= ]',
    "html": "</title><script>alert(1)</script>",
    "control": "a\x00\x1b[2J",
    "underscore": "_a",
    "not ASCII": "Gelenk ä \U0001f600",
}


def named(file: JointFile, name: str) -> JointFile:
    parameters = replace(file.parameters, name=name, source=name)
    return replace(file, parameters=parameters)


def joint_of(name: str) -> Joint:
    joint = load_joint("orange_80_6000", "output_fixed", effects=["coulomb"])
    return replace(joint, file=named(joint.file, name))


@pytest.mark.parametrize("case", NAMES)
def test_isaaclab(case: str) -> None:
    yaml = pytest.importorskip("yaml")
    plain = yaml.safe_load(to_isaaclab(joint_of("plain")).text)
    text = to_isaaclab(joint_of(NAMES[case])).text
    assert yaml.safe_load(text) == plain
    assert json.dumps(NAMES[case]) in text.splitlines()[0]


@pytest.mark.parametrize("case", NAMES)
def test_mujoco(case: str) -> None:
    model, plain = (fromstring(to_mujoco(joint_of(n)).text) for n in (NAMES[case], "plain"))
    kept = "".join(c if c in "\n\r" or c >= " " else "?" for c in NAMES[case])
    assert model.attrib == {"model": kept}
    assert [(e.tag, e.attrib) for e in list(model.iter())[1:]] == [
        (e.tag, e.attrib) for e in list(plain.iter())[1:]
    ]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Glyph")
def test_sheets(tmp_path: Path) -> None:
    name = 'a_$\\frac$ $ #read("/x") <script>alert(1)</script> \x1b \U0001f600 \\'
    file = named(load_joint_file("orange_80_6000"), name)
    sheet = make_sheet([file, named(file, "_" + name)])
    page, source = to_html(sheet), to_typst(sheet)
    assert "<script>alert" not in page
    assert "a $\\frac$ $ #read(&quot;/x&quot;)" in page
    assert '\\#read("\\/x")' in source
    assert '#read("/x")' not in source
    assert 'title: "a $\\\\frac$ $ #read(\\"/x\\") ' in source
    (path,) = write_sheet(sheet, tmp_path / "x.pdf")
    assert path.read_bytes().startswith(b"%PDF")
