"""TOML and JSON of anybody: a clear error, soon."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cjt_gym.disk import parse_json, parse_toml, read_toml, to_toml, toml_text
from cjt_gym.errors import ConfigurationError, RecordError
from cjt_gym.joint import load_joint_file

HOSTILE = {
    "a key of many parts": (".".join("a" * 20_000) + " = 1", "more than 64 parts"),
    "quoted parts": (".".join(['"\\""'] * 20_000) + " = 1", "more than 64 parts"),
    "a table of many parts": ("[" + ".".join("a" * 20_000) + "]", "more than 64 parts"),
    "deep lists": ("a = " + "[" * 50_000, "nested too deeply"),
    "less deep lists": ("a = " + "[" * 60 + "]" * 60, "more than 32 levels"),
    "deep tables": ("a = " + "{ a = " * 200 + "1" + "}" * 200, "more than 32 levels"),
    "a long number": ("a = " + "9" * 10_000, "integer string"),
    "a number without a float": ("a = " + "9" * 400, "bits, 64 are read"),
    "no TOML": ("a = ", "line|document"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_toml(case: str) -> None:
    text, message = HOSTILE[case]
    with pytest.raises(RecordError, match=f"run.toml must be a TOML file in UTF-8: .*({message})"):
        parse_toml(text, "run.toml", RecordError)


@pytest.mark.parametrize("text", ["[" * 50_000, "1" * 400, "{", '{"a":' * 40 + "1" + "}" * 40])
def test_hostile_json(text: str) -> None:
    with pytest.raises(ConfigurationError, match="run.json must be JSON"):
        parse_json(text, "run.json", ConfigurationError)


def test_a_long_text_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.toml"
    path.write_text("a = 1 # and more")
    monkeypatch.setenv("CJT_GYM_MAX_BYTES_OF_TEXT", "10")
    with pytest.raises(RecordError, match="16 bytes, .* CJT_GYM_MAX_BYTES_OF_TEXT to a larger"):
        read_toml(path, RecordError)
    monkeypatch.setenv("CJT_GYM_MAX_BYTES_OF_TEXT", "16")
    assert read_toml(path, RecordError) == {"a": 1}
    monkeypatch.setenv("CJT_GYM_MAX_BYTES_OF_TEXT", "many")
    with pytest.raises(ConfigurationError, match="must be a whole number > 0, got 'many'"):
        read_toml(path, RecordError)


def test_a_joint_file_of_great_numbers_is_an_error_of_ours(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    value = "9" * 400
    path.write_text(
        f'name = "x"\nsource = "x"\n[parameters]\nk_b = {{ value = {value}, unit = "N m/rad" }}\n'
    )
    with pytest.raises(ValueError, match="64 are read"):
        load_joint_file(path)


@given(text=st.text(st.characters(exclude_categories=["Cs"])))
def test_any_text_survives_toml(text: str) -> None:
    assert tomllib.loads(f"a = {toml_text(text)}") == {"a": text}
    assert tomllib.loads(to_toml({text: text})) == {text: text}
