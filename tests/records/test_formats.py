"""Files of other programs: text in its dialects, MATLAB, HDF5, MCAP with JSON and ROS 2."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import savemat

from cjt_gym.errors import RecordError
from cjt_gym.records import (
    FORMATS,
    Record,
    default_units,
    draft_mapping,
    read_log,
    read_record,
    write_record,
)
from tests.python import run_python

N = 300
T = np.arange(N) * 1e-3
Q = np.sin(20.0 * T)
PLAIN = {"columns": {"t": {}, "q_m": {}}}

DIALECTS = {
    "commas": "t,q_m\n{rows}",
    "semicolons": "t;q_m\n{rows}",
    "tabs": "t\tq_m\n{rows}",
    "blanks": "t   q_m\n{rows}",
    "decimal commas": "t;q_m\n{rows}",
    "numpy": "# t,q_m\n{rows}",
    "comments": "# recorded in the lab\n% by us\nt,q_m\n{rows}",
    "quotes": '"t","q_m"\n{rows}',
    "byte order mark": "\ufefft,q_m\n{rows}",
    "carriage returns": "t,q_m\r\n{rows}",
}
SEPARATORS = {"semicolons": ";", "tabs": "\t", "blanks": "  ", "decimal commas": ";"}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_dialects_of_text(dialect: str, tmp_path: Path) -> None:
    end = "\r\n" if dialect == "carriage returns" else "\n"
    rows = end.join(
        SEPARATORS.get(dialect, ",").join(map(repr, map(float, row)))
        for row in zip(T, Q, strict=True)
    )
    if dialect == "decimal commas":
        rows = rows.replace(".", ",")
    path = tmp_path / "log.csv"
    path.write_bytes(DIALECTS[dialect].format(rows=rows).encode())
    record = read_record(path, mapping=PLAIN)
    assert np.array_equal(record["t"], T)
    assert np.array_equal(record["q_m"], Q)


def test_damaged_lines_cost_only_themselves(tmp_path: Path) -> None:
    lines = [f"{t!r},{q!r},ok" for t, q in zip(T.tolist(), Q.tolist(), strict=True)]
    lines[10] = "0.01,#\ufffd"
    lines[20] = "0.02,ERR,ok"
    lines[-1] = "0.29"
    path = tmp_path / "log.csv"
    path.write_text("t,q_m,state\n" + "\n".join(lines), encoding="utf-8")
    (record,), repairs = read_log(path)
    assert len(record) == N - 2
    assert np.flatnonzero(np.isnan(record["q_m"])).size == 1
    texts = " ".join(repair.text for repair in repairs)
    assert "2 rows without a readable time, or with more or fewer cells" in texts
    assert "t, q_m taken as SI units. Left out: state." in texts


def test_a_log_without_any_known_name_says_how_to_map_it(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time,pos\n0,0\n1,1\n")
    with pytest.raises(RecordError, match=r"Columns there: time, pos. .* --out .*log.map.toml"):
        read_log(tmp_path / "log.csv")


def test_vectors_and_structures_of_matlab(tmp_path: Path) -> None:
    content = {
        "t": T[:, None],
        "log": {"motor": {"pos": np.rad2deg(Q)}, "name": "rig"},
        "both": np.column_stack([Q, 2.0 * Q]),
        "kp": 3.0,
    }
    savemat(tmp_path / "log.mat", content)
    mapping = {
        "columns": {
            "t": {},
            "q_m": {"source": "log.motor.pos", "unit": "deg"},
            "q_l": "both[1]",
        }
    }
    record = read_record(tmp_path / "log.mat", mapping=mapping)
    assert np.allclose(record["q_m"], Q)
    assert np.array_equal(record["q_l"], 2.0 * Q)
    with pytest.raises(RecordError, match="Unknown column 'kp'"):
        read_record(tmp_path / "log.mat", mapping={"columns": {"t": {}, "i": "kp"}})
    savemat(tmp_path / "none.mat", {"kp": "text"})
    with pytest.raises(RecordError, match="found only kp. Objects such as timeseries"):
        read_log(tmp_path / "none.mat")


def test_dimensions_of_matlab_without_a_sign(tmp_path: Path) -> None:
    """LabVIEW writes the dimensions of arrays as numbers without a sign."""
    savemat(tmp_path / "log.mat", {"t": T[:, None], "pos": Q[:, None]}, do_compression=False)
    signed, unsigned = (struct.pack("<II", kind, 8) for kind in (5, 6))
    content = (tmp_path / "log.mat").read_bytes()
    assert content.count(signed) == 2
    (tmp_path / "log.mat").write_bytes(content.replace(signed, unsigned))
    record = read_record(tmp_path / "log.mat", mapping={"columns": {"t": {}, "q_m": "pos"}})
    assert np.array_equal(record["q_m"], Q)


def test_objects_beside_the_vectors_of_a_matlab_file_are_skipped(tmp_path: Path) -> None:
    """A figure or a table has no shape; its variable says its name and class instead."""
    savemat(tmp_path / "log.mat", {"t": T[:, None], "pos": Q[:, None]}, do_compression=False)

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    names = (element(1, text) for text in (b"figure1", b"MCOS", b"matlab.ui.Figure"))
    body = element(6, struct.pack("<II", 17, 0)) + b"".join(names)
    with (tmp_path / "log.mat").open("ab") as file:
        file.write(element(14, body))
    record = read_record(tmp_path / "log.mat", mapping={"columns": {"t": {}, "q_m": "pos"}})
    assert np.array_equal(record["q_m"], Q)


def test_columns_of_other_lengths_than_their_time_are_refused(tmp_path: Path) -> None:
    savemat(tmp_path / "log.mat", {"half": T[::2], "pos": Q, "scope_time": T[:9]})
    mapping = {"columns": {"t": "half", "q_m": "pos"}}
    with pytest.raises(RecordError, match=r"must have the same length, got .* of 't' and .* dt"):
        read_log(tmp_path / "log.mat", mapping)
    with pytest.raises(RecordError, match="must have the same length"):
        read_record(tmp_path / "log.mat", mapping=mapping)
    assert 'dt = "?"' in draft_mapping(tmp_path / "log.mat")  # no time of something shorter


def test_matlab_7_3_and_hdf5(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    for name in ("log.h5", "log.mat"):
        with h5py.File(tmp_path / name, "w", userblock_size=512) as file:
            file["t"], file["log/pos"] = T[None, :], Q
        if name == "log.mat":
            with (tmp_path / name).open("r+b") as block:
                block.write(b"MATLAB 7.3 MAT-file".ljust(116))
        mapping = {"columns": {"t": {}, "q_m": "log.pos"}}
        assert np.array_equal(read_record(tmp_path / name, mapping=mapping)["q_m"], Q)


MISSING = [
    ("log.mat", b"MATLAB 7.3 MAT-file", "h5py", "needs h5py.*pip install"),
    ("log.mcap", b"", "mcap.records", "needs mcap, which is not installed: pip install"),
]


@pytest.mark.parametrize(("name", "content", "module", "message"), MISSING)
def test_what_to_install(
    name: str,
    content: bytes,
    module: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / name).write_bytes(content)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(RecordError, match=message):
        read_log(tmp_path / name)


def write_json(path: Path, encoding: str = "json") -> Path:
    """Write a topic at 1 kHz and one at 200 Hz with a clock that starts later."""
    writer_of = pytest.importorskip("mcap.writer").Writer
    with path.open("wb") as file:
        writer = writer_of(file)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        motor = writer.register_channel("/motor", encoding, schema)
        torque = writer.register_channel("/torque", encoding, schema)
        start = 1_700_000_000_000_000_000
        for k in range(N):
            stamp = start + k * 1_000_000
            data = {"pos": {"deg": float(np.rad2deg(Q[k]))}, "i": [0.0, float(k)], "ok": True}
            writer.add_message(motor, stamp, json.dumps(data).encode(), stamp)
            if k % 5 == 0:
                late = stamp + 300_000
                content = json.dumps({"nm": float(np.sin(20.0 * (T[k] + 3e-4)))})
                writer.add_message(torque, late, content.encode(), late)
        writer.finish()
    return path


JSON = {
    "columns": {
        "q_m": {"source": "/motor:pos.deg", "unit": "deg"},
        "i": {"source": "/motor:i[1]"},
        "tau": {"source": "/torque:nm"},
    }
}


def test_json_in_mcap(tmp_path: Path) -> None:
    record = read_record(write_json(tmp_path / "log.mcap"), mapping=JSON, allow_nan=True)
    assert np.allclose(record["t"], T, atol=1e-6)
    assert np.allclose(record["q_m"], Q)
    assert record["i"].tolist() == list(range(N))
    known = np.isfinite(record["tau"])
    assert known.sum() > 290
    assert np.allclose(record["tau"][known], Q[known], atol=2e-3)


def test_mcap_that_ends_early_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    path = write_json(tmp_path / "log.mcap")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) - 40])
    (record,), _ = read_log(path, mapping=JSON)
    assert np.allclose(record["q_m"], Q)


def test_columns_of_unequal_lengths_are_told(tmp_path: Path) -> None:
    h5py, path = pytest.importorskip("h5py"), tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        for name, samples in (("t", 12), ("q_m", 12), ("tau_ref", 8)):
            file[name] = 0.1 * np.arange(samples)
    with pytest.raises(RecordError, match="the same length, got .* 8 of 'tau_ref'"):
        read_log(path)


def test_a_schema_that_is_none_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mcap_ros2")
    path = tmp_path / "log.mcap"
    writer = pytest.importorskip("mcap.writer").Writer(str(path))
    writer.start()
    schema = writer.register_schema("p/A", "ros2msg", b"flnat64 y\n")
    writer.add_message(writer.register_channel("/a", "cdr", schema), 0, b"\0\1\0\0" + bytes(8), 0)
    writer.finish()
    with pytest.raises(RecordError):
        read_log(path)
    assert capsys.readouterr().err == ""


def test_mcap_in_another_encoding_is_refused(tmp_path: Path) -> None:
    path = write_json(tmp_path / "log.mcap", encoding="protobuf")
    with pytest.raises(RecordError, match=r"in JSON or of ROS 2 .* /motor \(protobuf\)"):
        read_log(path, mapping=JSON)


JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def joint_state(k: int) -> Any:
    stamp = {"sec": 1_700_000_000, "nanosec": k * 1_000_000}
    return {
        "header": {"stamp": stamp, "frame_id": ""},
        "name": ["hip", "knee"],
        "position": [0.0, float(Q[k])],
        "velocity": [],
        "effort": [0.0, float(k)],
    }


def test_joint_states_of_ros_2(tmp_path: Path) -> None:
    writer_of = pytest.importorskip("mcap_ros2.writer").Writer
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = writer_of(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for k in range(N):
            log_time = 1_700_000_000_000_000_000 + k * 1_000_000 + (k % 7) * 90_000
            writer.write_message("/joint_states", schema, joint_state(k), log_time)
        writer.finish()
    mapping = {
        "columns": {
            "t": {"source": "/joint_states:header.stamp", "unit": "ns"},
            "q_m": "/joint_states:position[knee]",
            "tau": "/joint_states:effort[knee]",
        }
    }
    record = read_record(tmp_path / "log.mcap", mapping=mapping)
    assert np.allclose(record["t"], T, atol=1e-6)
    assert np.allclose(record["q_m"], Q)
    assert record["tau"].tolist() == list(range(N))


@pytest.mark.parametrize("suffix", [s for s, form in FORMATS.items() if form.write is not None])
@pytest.mark.parametrize("rows", [1, 7, 100, 1000])
def test_pieces_of_a_table_make_the_whole(suffix: str, rows: int, tmp_path: Path) -> None:
    columns: dict[str, NDArray[np.float64]] = {"t": T[:50], "q_m": Q[:50]}
    path = write_record(Record(columns, default_units(("t", "q_m"))), tmp_path / f"run{suffix}")
    pieces = list(FORMATS[suffix].stream(path, rows))
    assert all(len(piece["t"]) <= rows for piece in pieces)
    for name, values in columns.items():
        assert np.array_equal(np.concatenate([piece[name] for piece in pieces]), values)


def test_other_formats_are_not_imported_for_a_csv(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,q_m\n0,0\n0.1,1\n")
    text = (
        "import sys; from cjt_gym.records import read_log; read_log('log.csv');"
        "print([m for m in ('h5py', 'mcap', 'pyarrow', 'scipy.io') if m in sys.modules])"
    )
    assert run_python(text, cwd=tmp_path).stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["t,q,i", *(f'{k},0.1,"-0,3{k}"' for k in range(30))], "numbers with a decimal point"),
        (["t,q,i", *(f"{k},0.1,{'OK' if k % 2 else 1}" for k in range(30))], "got 'OK' in row 2"),
        (["Axis1", "t,q,i", *(f"{k},0.1,1" for k in range(30))], "above lines of 3 cells"),
        (["t:,0,q:,0.2", *(f"t:,{k},q:,0.1" for k in range(30))], "a line of column names"),
        (["t,q,q", *(f"{k},0.1,1" for k in range(30))], "Rename one of them in its first line"),
    ],
    ids=["decimal comma", "text", "title", "labels", "twice"],
)
def test_what_is_no_table_of_numbers_is_told_with_its_place(
    tmp_path: Path, lines: list[str], said: str
) -> None:
    log = tmp_path / "log.csv"
    log.write_text("\n".join(lines), encoding="utf-8")
    named = {"t": {"source": "t"}, "q_m": {"source": "q"}, "i": {"source": "i"}}
    with pytest.raises(RecordError, match=said):
        read_log(log, {"columns": named})


def test_a_text_beside_the_mapped_columns_does_not_matter(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    rows = "\n".join(f"{1e-3 * k},0.1,{k % 2 == 0}" for k in range(30))
    log.write_text(f"t,q,on\n{rows}", encoding="utf-8")
    (record,), _ = read_log(log, {"columns": {"t": {}, "q_m": {"source": "q"}}})
    assert len(record) == 30


def test_a_converted_record_does_not_take_the_mapping_of_its_log(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    rows = "\n".join(f"{k},{0.5 * k}" for k in range(30))
    log.write_text(f"ms,deg\n{rows}", encoding="utf-8")
    (tmp_path / "log.map.toml").write_text(
        '[columns]\nt = { source = "ms", unit = "ms" }\nq_m = { source = "deg", unit = "deg" }\n'
    )
    (record,), _ = read_log(log)
    write_record(record, tmp_path / "log.npz")
    assert np.array_equal(read_record(tmp_path / "log.npz")["q_m"], record["q_m"])
