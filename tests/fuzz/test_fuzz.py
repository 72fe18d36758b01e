"""A short run of the fuzzer; `make fuzz` is a long one."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.run import Findings, fuzz, tried
from tests.fuzz.targets import Target, targets

INPUTS = 60
NAMES = (
    *("csv", "parquet", "npz", "zip", "mat", "h5", "mcap", "log", "asc", "trc", "blf", "dbc"),
    *("facts", "mapping", "joint", "toolbox", "build", "policy", "gains", "config", "run"),
    "hardware",
)


@pytest.fixture(scope="module")
def readers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Target]:
    return targets(tmp_path_factory.mktemp("seeds"))


def test_every_reader_is_here(readers: dict[str, Target]) -> None:
    assert set(NAMES) == set(readers)


@pytest.mark.parametrize("name", NAMES)
def test_a_reader_answers_or_raises_our_error(
    name: str, readers: dict[str, Target], tmp_path: Path
) -> None:
    found = fuzz(readers[name], tmp_path / "x", INPUTS, seed=0)
    assert found.kinds == {}
    assert found.inputs == INPUTS
    assert found.refused > INPUTS // 3


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", NAMES)
def test_seeds_are_read(name: str, readers: dict[str, Target], tmp_path: Path) -> None:
    found = Findings()
    for seed in readers[name].seeds:
        assert tried(readers[name], tmp_path / "x", seed, found) == "read"


def test_a_foreign_exception_and_a_long_one_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(folder: Path) -> None:
        if len((folder / "x").read_bytes()) % 2:
            raise KeyError("of nobody")
        while True:
            pass

    monkeypatch.setattr("tests.fuzz.run.PATIENCE", 0.01)
    target = Target([(b"a", b"")], lambda parts: {"x": parts[0]}, run)
    kinds = fuzz(target, tmp_path / "x", 30, seed=0).kinds
    assert {kind.split()[0] for kind in kinds} == {"KeyError", "TooLongError"}
