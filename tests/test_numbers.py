"""Numbers that no command can take end in one line and status 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from cjt_gym.cli import main

SIMULATE = ("simulate", "orange_80_6000", "--out", "x.csv")
HARDWARE = str(Path(__file__).parents[1] / "examples" / "hardware" / "joint.toml")
REFUSED = [
    (*SIMULATE, "--seed", "-1"),
    (*SIMULATE, "--duration", "nan"),
    (*SIMULATE, "--duration", "-1"),
    (*SIMULATE, "--duration", "inf"),
    (*SIMULATE, "--duration", "1e7"),
    (*SIMULATE, "--dt", "0"),
    (*SIMULATE, "--dt", "nan"),
    (*SIMULATE, "--dt", "1e-300"),
    (*SIMULATE, "--dt-physics", "0"),
    (*SIMULATE, "--amplitude", "nan"),
    ("analyse", "orange_80_6000", "--seed", "-1", "--identify", "1", "--json"),
    ("export", "orange_80_6000", "--to", "mujoco", "--timestep", "0", "--out", "x.xml"),
    ("emulate", HARDWARE, "--seconds", "-1"),
    ("emulate", HARDWARE, "--seconds", "nan"),
    ("diagnose", "emps", "--seconds", "nan"),
    ("hardware", HARDWARE, "--seed", "-1", "--dry-run"),
    ("hardware", HARDWARE, "--duration", "nan", "--dry-run"),
]


@pytest.mark.parametrize("words", REFUSED, ids=" ".join)
def test_numbers_that_cannot_be(
    words: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        status = main(words)
    except SystemExit as end:  # of the parser
        status = int(str(end.code))
    said = capsys.readouterr().err.strip()
    assert status == 2
    assert len(said.splitlines()) == 1
    assert said.startswith("cjt-gym")
    assert list(tmp_path.iterdir()) == []


def test_memory_that_there_is_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def much(options: object) -> None:
        raise MemoryError

    monkeypatch.setattr("cjt_gym.commands.joints.run", much)
    assert main(["joints"]) == 1
    assert "not enough memory" in capsys.readouterr().err
