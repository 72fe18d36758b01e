"""Long logs: in pieces, and only the windows that tell most."""

from __future__ import annotations

import cProfile
import pstats
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym.errors import RecordError
from cjt_gym.records import (
    Record,
    concat,
    default_units,
    informative_windows,
    iter_record,
    read_log,
    read_record,
    write_record,
)

BUSY = ((310.0, 330.0), (1200.0, 1220.0), (2450.0, 2460.0))
"""Stretches of the log in which something happens [s]; at rest but for noise elsewhere."""


def long_log(seconds: float, rate: float) -> dict[str, NDArray[np.float32]]:
    """Return a log that mostly rests; each busy stretch has frequencies and a range of its own."""
    rng = np.random.default_rng(3)
    t = np.arange(round(seconds * rate)) / rate
    i = 0.01 * rng.standard_normal(len(t))
    q = 1e-5 * rng.standard_normal(len(t))
    for k, (begin, end) in enumerate(BUSY):
        busy = (t >= begin) & (t < end)
        s = t[busy] - begin
        i[busy] += (k + 1.0) * np.sin(2.0 * np.pi * (0.5 + k) * s * (1.0 + 0.1 * s))
        q[busy] += 0.1 * np.sin(2.0 * np.pi * (0.5 + k) * s)
    return {"t": t, "i": i.astype(np.float32), "q_m": q.astype(np.float32)}


@pytest.fixture(scope="module")
def hour(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "hour.npz"
    np.savez(path, **long_log(3600.0, 100.0))
    return path


def starts(records: tuple[Record, ...]) -> list[tuple[float, float]]:
    return [(round(r["t"][0], 1), round(r["t"][-1] + 0.01, 1)) for r in records]


def test_the_windows_of_an_hour(hour: Path) -> None:
    records, repairs = informative_windows(hour, seconds=50.0)
    assert starts(records) == list(BUSY)
    assert "Of 360 windows of 10 s 5 are used, the most informative" in repairs[-1].text


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", **long_log(900.0, 1000.0))
    tracemalloc.start()
    informative_windows(tmp_path / "log.npz", seconds=10.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.3 * (tmp_path / "log.npz").stat().st_size


def test_few_windows_differ(hour: Path) -> None:
    records, _ = read_log(hour, seconds=30.0)
    inside = [sum(r["t"][0] >= begin for begin, _ in BUSY) for r in records]
    assert sorted(inside) == [1, 2, 3], "one of each stretch rather than all of one"


def test_windows_of_a_wheel_that_coasts_lie_at_all_its_speeds(tmp_path: Path) -> None:
    """Nothing drives it and nothing turns round: only its speed tells one window from another."""
    t = np.arange(0.0, 600.0, 0.02)
    columns = {"t": t, "dq_m": 120.0 * np.exp(-t / 150.0), "i": 0.0 * t}
    write_record(Record(columns, {"t": "s", "dq_m": "rad/s", "i": "A"}), tmp_path / "coast.npz")
    records, _ = read_log(tmp_path / "coast.npz", seconds=60.0)
    speeds = np.array([np.mean(r["dq_m"]) for r in records])
    assert min(speeds) < 10.0
    assert max(speeds) > 100.0
    assert np.any((speeds > 20.0) & (speeds < 60.0))


@pytest.mark.slow
def test_work_grows_with_length(tmp_path: Path) -> None:
    """Counted in calls of functions, which are the same on every machine."""
    calls = []
    for length in (1000.0, 4000.0, 16000.0):
        path = tmp_path / f"{length:g}.npz"
        np.savez(path, **long_log(length, 20.0))
        with cProfile.Profile() as profile:
            informative_windows(path, seconds=20.0)
        calls.append(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]
    assert calls[2] - calls[1] < 5.0 * (calls[1] - calls[0])


def test_a_short_log_is_returned_whole(tmp_path: Path) -> None:
    columns = {name: values[: 100 * 25] for name, values in long_log(30.0, 100.0).items()}
    np.savez(tmp_path / "short.npz", **columns)
    (record,), repairs = informative_windows(tmp_path / "short.npz", seconds=60.0)
    assert len(record) == 100 * 25
    assert not [repair for repair in repairs if repair.kind == "cut"]


@pytest.mark.parametrize(("seconds", "length"), [(5.0, 10.0), (10.0, 0.0)])
def test_lengths_that_make_no_sense(seconds: float, length: float, hour: Path) -> None:
    with pytest.raises(RecordError, match="length of a window must be > 0 s and at most"):
        informative_windows(hour, seconds=seconds, length=length)


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet", ".mat"])
def test_pieces_joined_are_the_record(suffix: str, tmp_path: Path) -> None:
    record = read_record("emps").slice(0, 3000)
    path = write_record(record, tmp_path / f"log{suffix}")
    pieces = list(iter_record(path, rows=700))
    assert [len(piece) for piece in pieces] == [700, 700, 700, 700, 200]
    whole = concat(pieces)
    assert dict(whole.units) == dict(record.units)
    assert all(np.array_equal(whole[name], record[name]) for name in record.columns)
    with pytest.raises(RecordError, match="rows must be >= 1"):
        next(iter_record(path, rows=0))


def test_records_that_do_not_fit_are_not_joined() -> None:
    record = Record({"t": [0.0, 1.0], "i": [0.0, 1.0]}, default_units(("t", "i")))
    with pytest.raises(RecordError, match="must increase"):
        concat([record, record])
    with pytest.raises(RecordError, match="same columns and units"):
        concat([record, Record({"t": [2.0, 3.0]}, {"t": "s"})])
    with pytest.raises(RecordError, match="at least one record"):
        concat([])


def test_a_record_is_a_mapping_of_its_columns() -> None:
    record = Record({"t": [0.0, 1.0], "i": [0.0, 1.0]}, default_units(("t", "i")))
    assert list(record.keys()) == ["t", "i"]
    assert dict(record)["i"].tolist() == [0.0, 1.0]
