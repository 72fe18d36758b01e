"""Records: what may be in one, round trips through files, and what bad files are told."""

from __future__ import annotations

import pickle
import tomllib
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cjt_gym.errors import CjtGymError, RecordError
from cjt_gym.joint import load_joint_file
from cjt_gym.records import (
    COLUMNS,
    FORMATS,
    Record,
    default_units,
    read_record,
    record_names,
    write_record,
)

WRITABLE = sorted(suffix for suffix, form in FORMATS.items() if form.write is not None)
FLOATS = st.floats(allow_nan=False, allow_infinity=False, width=64)
FACTS = st.recursive(
    st.booleans() | st.integers(-(2**60), 2**60) | FLOATS | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3)
    ),
    max_leaves=6,
)
SENSORS = st.dictionaries(
    st.sampled_from(["q_m", "q_l", "tau", "i"]),
    st.dictionaries(st.sampled_from(["resolution", "noise"]), st.floats(0.0, 1.0), max_size=2),
    max_size=3,
)


def small(**changes: Any) -> Record:
    """Return a valid record of three samples, with some of its arguments changed."""
    columns = {"t": [0.0, 0.001, 0.002], "q_m": [0.0, 0.1, 0.2], "tau": [1.0, 2.0, 3.0]}
    arguments: dict[str, Any] = {"columns": columns, "units": default_units(tuple(columns))}
    return Record(**(arguments | changes))


@st.composite
def records(draw: st.DrawFn) -> Record:
    """Draw a valid record: any columns, rotary or prismatic, any facts."""
    names = draw(st.lists(st.sampled_from(sorted(COLUMNS)), min_size=1, unique=True))
    true = draw(st.sampled_from([[], ["true_q_m"], ["true_dq_l", "true_tau"]]))
    length, dt = draw(st.integers(1, 5)), draw(st.floats(1e-5, 1.0))
    columns = {
        name: draw(st.lists(FLOATS, min_size=length, max_size=length)) for name in names + true
    }
    if "t" in columns:
        start = draw(st.floats(-10.0, 10.0))
        columns["t"] = list(start + dt * np.arange(length))
    return Record(
        columns=columns,
        units=default_units(tuple(columns), prismatic=draw(st.booleans())),
        dt=dt,
        seed=draw(st.none() | st.integers(0, 2**62)),
        parameter_hash=draw(st.none() | st.text(max_size=8)),
        joint=draw(st.none() | st.text(min_size=1, max_size=8)),
        structure=draw(st.none() | st.just("rigid")),
        versions=draw(st.dictionaries(st.text(max_size=8), st.text(max_size=8), max_size=2)),
        provenance=draw(st.dictionaries(st.text(max_size=10) | st.just("mode"), FACTS, max_size=4)),
        sensors=draw(SENSORS),
    )


@pytest.mark.parametrize("suffix", WRITABLE)
@settings(max_examples=40, deadline=None)
@given(record=records())
def test_a_record_survives_every_format_unchanged(suffix: str, record: Record) -> None:
    with TemporaryDirectory() as folder:
        path = write_record(record, Path(folder) / f"run.1{suffix}")
        assert path.with_suffix(".toml").is_file()
        assert read_record(path) == record
        assert read_record(path.with_suffix(".toml")) == record


@given(record=records())
def test_a_record_can_be_sent_to_another_process(record: Record) -> None:
    assert pickle.loads(pickle.dumps(record)) == record


def test_the_folder_of_a_record_is_made(tmp_path: Path) -> None:
    path = write_record(small(), tmp_path / "new" / "run.csv")
    assert path.parent == tmp_path / "new"
    assert read_record(path) == small()


def test_the_file_that_other_programs_write_is_read_as_it_is(tmp_path: Path) -> None:
    np.savez(tmp_path / "diagnose.npz", t=np.arange(3) * 1e-3, i_cmd=np.zeros(3), q_m=np.ones(3))
    (tmp_path / "nominal.toml").write_text('name = "hidden"\n')
    (tmp_path / "diagnose.toml").write_text(
        'dt = 0.001\njoint = "nominal.toml"\nstructure = "output_fixed"\nmode = "open loop"\n'
        'excitation = "composite"\noutput = "locked"\n[units]\nt = "s"\ni_cmd = "A"\nq_m = "rad"\n'
        '[sensors.q_m]\nresolution = { value = 4.8e-6, unit = "rad", source = "datasheet" }\n'
    )
    record = read_record(tmp_path / "diagnose.npz")
    assert record.dt == 0.001
    assert record.joint_file == tmp_path / "nominal.toml"
    assert dict(record.provenance) == {
        "mode": "open loop",
        "excitation": "composite",
        "output": "locked",
    }
    assert record.sensors["q_m"] == {"resolution": 4.8e-6}


@pytest.mark.parametrize("name", ["emps", "emps_pulses"])
def test_shipped_records(name: str) -> None:
    record = read_record(name)
    assert name in record_names()
    assert (len(record), record.dt, record.prismatic) == (24841, 1e-3, True)
    nominal = load_joint_file(record.joint_file or "")
    assert nominal.effects == {}
    assert nominal.parameters.d_m == 0.0, "a diagnosis has to find the friction by itself"
    assert "Janot" in record.provenance["citation"]
    assert np.allclose(np.diff(record.t), 1e-3, atol=2e-5)
    assert 0.24 < np.ptp(record["q_m"]) < 0.25


@pytest.mark.parametrize("name", ["emps", "emps_pulses"])
def test_the_recorded_command_follows_from_the_recorded_position(name: str) -> None:
    record = read_record(name)
    controller = record.provenance["controller"]
    kp, kv = controller["kp"]["value"], controller["kv"]["value"]
    q, extra = record["q_m"], record.columns.get("i_extra", np.zeros(len(record)))
    velocity = np.concatenate([[0.0, 0.0], (q[2:] - q[:-2]) / (2 * record.dt)])
    command = kv * (kp * (record["q_ref"] - q) - velocity) + extra
    misfit = np.sqrt(np.mean((command - record["i_cmd"])[2:] ** 2))
    assert misfit < 0.06, "volts; without the pulses it would be 2.5"


def test_columns_are_read_only() -> None:
    given = np.zeros(3)
    record = small(columns={"q_m": given}, units={"q_m": "rad"}, dt=1e-3)
    given[0] = 1.0
    assert record["q_m"][0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        record["q_m"][0] = 1.0


def test_time_follows_from_dt_where_there_is_no_column() -> None:
    record = small(columns={"q_m": [1.0, 2.0, 3.0]}, units={"q_m": "rad"}, dt=0.5)
    assert record.t.tolist() == [0.0, 0.5, 1.0]


def test_irregular_sampling_is_allowed() -> None:
    columns = {"t": [0.0, 0.001, 0.005, 0.0051], "q_m": [0.0] * 4}
    assert small(columns=columns, units=default_units(tuple(columns)), dt=0.001).dt == 0.001


def test_slice_counts_samples_and_keeps_what_is_known() -> None:
    record = small(seed=7).slice(1, 3)
    assert (len(record), record.seed, record["q_m"].tolist()) == (2, 7, [0.1, 0.2])
    with pytest.raises(RecordError, match="at least one sample"):
        small().slice(5)


def test_with_columns_adds_and_replaces() -> None:
    record = small().with_columns({"q_m": [9.0] * 3, "true_q_m": [8.0] * 3}, {"true_q_m": "rad"})
    assert (record["q_m"][0], record["true_q_m"][0], record["tau"][0]) == (9.0, 8.0, 1.0)


def test_missing_samples_only_on_request(tmp_path: Path) -> None:
    columns = {"t": [0.0, 1.0], "q_m": [0.0, np.nan]}
    units = default_units(tuple(columns))
    with pytest.raises(
        RecordError, match=r"'q_m' of the record must be finite, got nan at sample 1"
    ):
        Record(columns, units)
    record = Record(columns, units, allow_nan=True)
    for suffix in WRITABLE:
        path = write_record(record, tmp_path / f"run{suffix}")
        with pytest.raises(RecordError, match="accepted with allow_nan=True"):
            read_record(path)
        assert read_record(path, allow_nan=True) == record
    (tmp_path / "run.csv").write_text("t,q_m\n0,0\n1,\n")
    assert read_record(tmp_path / "run.csv", allow_nan=True) == record


def test_quantities_of_a_joint_file_serve_as_sensor_values() -> None:
    from cjt_gym.joint.files.parameters import Quantity

    sensors = {"q_m": {"noise": Quantity(1e-5, "rad")}}
    assert small(sensors=sensors).sensors["q_m"] == {"noise": 1e-5}
    with pytest.raises(
        RecordError, match=r"sensors.q_m.noise .* must have the unit .* 'rad', got 'deg'"
    ):
        small(sensors={"q_m": {"noise": Quantity(1e-5, "deg")}})


BAD_ARGUMENTS: list[tuple[dict[str, Any], str]] = [
    ({"columns": {}, "units": {}}, "at least one column"),
    ({"columns": {"q": [1.0]}, "units": {"q": "rad"}}, r"Unknown column 'q'\. .*Known: .*q_g"),
    ({"columns": {"taw": [1.0]}, "units": {"taw": "N m"}}, "Did you mean 'tau'"),
    ({"columns": {"true_t": [1.0]}, "units": {"true_t": "s"}}, "Unknown column 'true_t'"),
    (
        {"columns": {"q_m": [1.0]}, "units": {}, "dt": 1.0},
        r"'q_m' of the record has no unit. Add  q_m = ",
    ),
    (
        {"columns": {"q_m": [1.0]}, "units": {"q_m": "rad", "tau": "N m"}},
        "'tau' .* missing from the table",
    ),
    (
        {"columns": {"q_m": [1.0]}, "units": {"q_m": "deg"}},
        "must be 'rad' or 'm', got 'deg'. Convert",
    ),
    (
        {"columns": {"q_m": [1.0], "tau": [1.0]}, "units": {"q_m": "m", "tau": "N m"}},
        "must all be rotary",
    ),
    (
        {"columns": {"q_m": [1.0], "tau": [1.0, 2.0]}, "units": {"q_m": "rad", "tau": "N m"}},
        "1 .* and 2 ",
    ),
    (
        {"columns": {"q_m": [[1.0]]}, "units": {"q_m": "rad"}},
        r"one-dimensional, got the shape \(1, 1\)",
    ),
    ({"columns": {"q_m": ["a"]}, "units": {"q_m": "rad"}}, "real numbers, got the type <U1"),
    (
        {"columns": {"q_m": [np.inf]}, "units": {"q_m": "rad"}, "dt": 1.0},
        "must be finite, got inf at sample 0",
    ),
    ({"columns": {"t": [np.nan]}, "units": {"t": "s"}, "allow_nan": True}, "'t' .* must be finite"),
    ({"columns": {"q_m": [1.0]}, "units": {"q_m": "rad"}}, "column t or a sample time"),
    ({"dt": -1.0}, "dt of the record must be > 0 s, got -1.0"),
    ({"dt": 1.0}, r"dt .* says 1.0 s, but the median interval of t is 0.001 s"),
    (
        {"columns": {"t": [0.0, 1.0, 1.0]}, "units": {"t": "s"}},
        "must increase .* 1.0 s at sample 2",
    ),
    ({"sensors": {"q_m": {"noize": 1.0}}}, "Unknown sensor property 'noize'. Did you mean 'noise'"),
    ({"sensors": {"q_m": {"noise": -1.0}}}, "must be >= 0 rad, got -1.0"),
    ({"sensors": {"true_q_m": {"noise": 1.0}}}, "free of sensor effects"),
]


@pytest.mark.parametrize(("changes", "message"), BAD_ARGUMENTS)
def test_a_record_refuses_what_is_not_one(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(RecordError, match=message):
        small(**changes)


def test_an_absent_column_is_named_with_those_that_are_there() -> None:
    with pytest.raises(
        RecordError, match=r"Unknown column 'tau_m'. Did you mean .* Known: q_m, t, tau"
    ):
        small()["tau_m"]


BAD_TABLES = [
    ("csv", "t,q_m\n0,0\n1\n", "Line 3 of .*run.csv must have 2 values like its header, got 1"),
    ("csv", "t,q_m\n0,0\n1,nan\n", "'q_m' of .*run.csv must be finite, got nan at sample 1"),
    ("csv", "t,q_m\n0,0\n0,0\n", "t of .*run.csv must increase"),
    ("csv", "t;q m\n0;0\n", "Unknown column 'q m'"),
    ("csv", "t,q_m\n0,1 rad\n", "Line 2 of .*run.csv must hold numbers"),
    ("csv", "t,t\n0,0\n", "must have a name of its own, got 't' twice"),
    (
        "csv",
        "t\n0\n",
        "'q_m' of .*run.csv has a unit but is missing from the table. Columns there: t",
    ),
    ("csv", "t,q_m,q_l\n0,0,0\n", "'q_l' of .*run.csv has no unit"),
    ("csv", "t,q_m,qm\n0,0,0\n", "Unknown column 'qm'. Did you mean 'q_m'"),
    ("csv", "", "line of column names, got an empty file"),
    ("npz", "no archive", "run.npz must be an NPZ archive"),
    ("parquet", "no table", "run.parquet must be a Parquet file"),
    ("mat", "no file", "run.mat must be a MATLAB file"),
    ("h5", "no file", "run.h5 must be an HDF5 file"),
    ("mcap", "no file", "run.mcap must be an MCAP file"),
    ("xlsx", "", "must end in .csv, .*.trc, got"),
]


@pytest.mark.parametrize(("suffix", "text", "message"), BAD_TABLES)
def test_bad_tables(suffix: str, text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text('dt = 1.0\n[units]\nt = "s"\nq_m = "rad"\n')
    (tmp_path / f"run.{suffix}").write_text(text)
    with pytest.raises(RecordError, match=message):
        read_record(tmp_path / f"run.{suffix}")


def test_objects_in_an_archive_are_not_unpickled(tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", q_m=np.array([{}], dtype=object))
    (tmp_path / "run.toml").write_text('dt = 1.0\n[units]\nq_m = "rad"\n')
    with pytest.raises(RecordError, match="plain numeric arrays"):
        read_record(tmp_path / "run.npz")


BAD_METADATA = [
    ("dt = ", "must be a TOML file in UTF-8: .*line 1"),
    ('dt = "1 ms"', "dt of .* must be a number, got '1 ms'"),
    ("dt = true", "dt of .* must be a number, got True"),
    ("seed = 1.5", "seed of .* must be a whole number"),
    ("joint = 1", "joint of .* must be a string"),
    ("units = 1", "units of .* must be a table"),
    ('unit = { q_m = "rad" }', "Unknown key 'unit'. Did you mean 'units'"),
    ('strucutre = "rigid"', "Unknown key 'strucutre'. Did you mean 'structure'"),
    ('[units]\nt = "ms"\nq_m = "rad"', "'t' of .* must be 's', got 'ms'"),
    ("[sensors]\nq_m = 1.0", "sensors.q_m of .* must be a table"),
    ("[sensors.q_m]\nnoise = 1.0", r"sensors.q_m.noise of .* must look like \{ value"),
    ('[sensors.q_m]\nnoise = { value = "a", unit = "rad" }', "a number as its value"),
    ('[sensors.q_m]\nnoise = { value = 1, units = "rad" }', "must look like"),
]


@pytest.mark.parametrize(("text", "message"), BAD_METADATA)
def test_bad_metadata(text: str, message: str, tmp_path: Path) -> None:
    units = "" if "unit" in text and "sensors" not in text else '\n[units]\nt = "s"\nq_m = "rad"\n'
    (tmp_path / "run.toml").write_text(text + units)
    (tmp_path / "run.csv").write_text("t,q_m\n0,0\n1,1\n")
    with pytest.raises(RecordError, match=message):
        read_record(tmp_path / "run.csv")


def test_missing_files(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"no file .*emp. Unknown record .* Did you mean 'emps'"):
        read_record("emp")
    (tmp_path / "run.csv").write_text("t\n0\n")
    with pytest.raises(RecordError, match=r"needs a file .*run.toml beside its table"):
        read_record(tmp_path / "run.csv")
    with pytest.raises(RecordError, match=r"exactly one table .* found none"):
        read_record(tmp_path / "other.toml")
    with pytest.raises(CjtGymError):
        write_record(small(), tmp_path / "run.xlsx")


def test_what_is_written_reads_like_what_others_write(tmp_path: Path) -> None:
    record = replace(small(), provenance={"mode": "open loop", "gains": {"kp": 1.0}}, seed=3)
    write_record(record, tmp_path / "run.npz")
    facts = tomllib.loads((tmp_path / "run.toml").read_text())
    assert facts == {
        "dt": 0.001,
        "seed": 3,
        "mode": "open loop",
        "units": {"t": "s", "q_m": "rad", "tau": "N m"},
        "provenance": {"gains": {"kp": 1.0}},
    }


def test_only_formats_that_can_be_written_are_offered(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="must end in .csv") as refused:
        write_record(read_record("emps"), tmp_path / "x.xls")
    assert ".csv" in str(refused.value)
    assert ".blf" not in str(refused.value)


def test_what_is_no_record_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(CjtGymError, match="record must be a Record, got None"):
        write_record(None, tmp_path / "x.csv")  # type: ignore[arg-type]
    with pytest.raises(CjtGymError, match="path must be the path of the file to write, got None"):
        write_record(read_record("emps"), None)  # type: ignore[arg-type]


def test_a_sample_time_that_times_give_is_rounded() -> None:
    t = 0.5 + 0.002 * np.arange(400)
    assert float(np.median(np.diff(t))) != 0.002
    assert Record({"t": t, "q_m": np.zeros(400)}, default_units(("t", "q_m"))).dt == 0.002
