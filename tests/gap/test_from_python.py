"""A diagnosis from Python finds what the command does: signs, structure and gear ratio."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.errors import RecordError
from cjt_gym.gap import diagnose
from cjt_gym.records import read_log
from tests.gap.horizons.rotor import datasheet, record


def test_a_turned_channel_is_put_right_and_told() -> None:
    right = record()
    turned = right.with_columns({"q_m": -right["q_m"]})
    one, other = (diagnose(x, datasheet(), "rigid") for x in (right, turned))
    assert other.unexplained.text.startswith("q_m: sign turned")
    assert "sign turned" not in one.unexplained.text
    assert one.effects == other.effects


def test_the_structure_may_be_that_of_the_joint() -> None:
    bare, file = replace(record(), structure=None), replace(datasheet(), structure="rigid")
    assert diagnose(bare, file).joint.structure == "rigid"


def test_a_record_too_short_to_test_on_is_refused() -> None:
    whole = record()
    with pytest.raises(RecordError, match="at least 50 samples to test a diagnosis on, got 40"):
        diagnose(whole.slice(40, None), datasheet(), "rigid", whole.slice(0, 40))


def test_a_log_takes_the_gear_ratio_of_the_joint_that_its_mapping_names(tmp_path: Path) -> None:
    angle = np.linspace(0.0, 10.0, 200)
    np.savetxt(
        tmp_path / "log.csv", np.c_[0.01 * np.arange(200), angle],
        delimiter=",", header="t,pos", comments="",
    )  # fmt: skip
    mapping = tmp_path / "log.map.toml"
    text = 'joint = "joint.toml"\n[columns.t]\n[columns.q_m]\nsource = "pos"\nside = "motor"\n'
    mapping.write_text(text, encoding="utf-8")
    with pytest.raises(RecordError, match="needs the gear ratio"):
        read_log(tmp_path / "log.csv")
    joint = tmp_path / "joint.toml"
    joint.write_text('[parameters]\nn = { value = 5, unit = "-" }\n', encoding="utf-8")
    (found,), _ = read_log(tmp_path / "log.csv")
    assert found["q_m"] == pytest.approx(angle / 5.0)
    (found,), _ = read_log(tmp_path / "log.csv", n=2.0)
    assert found["q_m"] == pytest.approx(angle / 2.0)
    mapping.write_text(text.replace("joint.toml", "orange_80_6000"), encoding="utf-8")
    (found,), _ = read_log(tmp_path / "log.csv")
    assert found["q_m"] == pytest.approx(angle / 80.0)
    joint.write_text("not TOML", encoding="utf-8")
    mapping.write_text(text, encoding="utf-8")
    with pytest.raises(RecordError, match="needs the gear ratio"):
        read_log(tmp_path / "log.csv")
