"""Small files that would cost a lot, and files that lead elsewhere."""

from __future__ import annotations

import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym.errors import ConfigurationError, RecordError
from cjt_gym.records import draft_mapping, read_log, write_record
from tests.disk.test_whole import RECORD

MUCH = 2_000_000
"""Bytes that a bomb makes of itself, with a limit of as many numbers over ten."""


def archive(path: Path, header: str, data: bytes = b"", copies: int = 1) -> None:
    text = header.encode().ljust(118) + b"\n"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for k in range(copies):
            head = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text
            file.writestr(f"q_m{k}.npy", head + data)


def npy(shape: str) -> str:
    return f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}"


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def array_head(kind: int, rows: int, columns: int) -> bytes:
    flags, sizes = struct.pack("<II", kind, 0), struct.pack("<2i", rows, columns)
    return element(6, flags) + element(5, sizes) + element(1, b"a")


def mat(path: Path, *parts: bytes) -> None:
    body = zlib.compress(element(14, b"".join(parts)))
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(head + struct.pack("<II", 15, len(body)) + body)


def nested(path: Path) -> None:
    inner = element(14, array_head(6, 1, 1) + element(9, struct.pack("<d", 1.0)))
    for _ in range(1200):
        inner = element(14, array_head(2, 1, 1) + FIELD + inner)
    mat(path, array_head(2, 1, 1), FIELD, inner)


def blf(path: Path) -> None:
    body = zlib.compress(b"\0" * MUCH)
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(body), 10)
    path.with_suffix(".dbc").write_text(DBC)
    path.write_bytes(
        struct.pack("<4sL", b"LOGG", 144).ljust(144, b"\0")
        + head
        + struct.pack("<H6xL4x", 2, 100)
        + body
    )


def mcap(path: Path, encoding: str, schema: bytes, *messages: bytes) -> None:
    from mcap.writer import Writer

    writer = Writer(str(path))
    writer.start()
    kind = {"json": "jsonschema", "cdr": "ros2msg"}[encoding]
    channel = writer.register_channel("/a", encoding, writer.register_schema("p/A", kind, schema))
    for k, message in enumerate(messages):
        writer.add_message(channel, k, message, k)
    writer.finish()


def ros(path: Path, size: int) -> None:
    schema = b"Foo[] x\n" + b"=" * 80 + b"\nMSG: p/Foo\nuint8[%d] y\n" % size
    mcap(path, "cdr", schema, b"\0\1\0\0" + struct.pack("<I", 4_000_000_000))


def hdf5(path: Path, **options: Any) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("q_m", dtype="f8", **options)


def virtual(path: Path) -> None:
    import h5py

    layout = h5py.VirtualLayout(shape=(10,), dtype="f8")
    layout[:] = h5py.VirtualSource(path.with_name("other.h5"), "q_m", shape=(10,))
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("q_m", layout)


def parquet(path: Path) -> None:
    import pyarrow
    from pyarrow import parquet as file

    file.write_table(pyarrow.table({"q_m": np.zeros(MUCH, np.int8)}), path, compression="zstd")


FIELD = struct.pack("<HHi", 5, 4, 8) + element(1, b"a".ljust(8, b"\0"))
"""The names of the fields of a structure that has one, as they stand before it."""
DBC = 'VERSION ""\nBO_ 1 A: 8 X\n SG_ q_m : 0|8@1+ (1,0) [0|0] "" X\n'
BOMBS: dict[str, tuple[Callable[[Path], None], str]] = {
    "shape.npz": (lambda p: archive(p, npy("(1000000000000000,)")), "but 0 bytes"),
    "negative.npz": (lambda p: archive(p, npy("(-5,)")), r"has the shape \(-5,\)"),
    "deep.npz": (lambda p: archive(p, npy("(" * 3000)), "Cannot parse header|EOF in"),
    "many.npz": (lambda p: archive(p, npy("(1,)"), bytes(8), 60), "60 columns, more than the 50"),
    "bomb.npz": (
        lambda p: archive(p, npy(f"({MUCH // 8},)"), bytes(MUCH)),
        "numbers, more than the 200000 that are read from a file of its size",
    ),
    "bomb.parquet": (parquet, "2000000 numbers, more than"),
    "names.csv": (
        lambda p: p.write_text(",".join(f"c{k}" for k in range(60)) + "\n1\n"),  # type: ignore[arg-type,return-value]
        "60 columns, .*set the environment variable CJT_GYM_MAX_COLUMNS to a larger number",
    ),
    "damaged.csv": (
        lambda p: p.write_text(",".join(f"c{k}" for k in range(50)) + "\nx" * 30_000),  # type: ignore[arg-type,return-value]
        "1500000 numbers",
    ),
    "nested.mat": (nested, "nested more than 32 levels"),
    "cell.mat": (lambda p: mat(p, array_head(1, 30_000, 30_000)), "must hold vectors"),
    "struct.mat": (lambda p: mat(p, array_head(2, 30_000, 30_000)), "must hold vectors"),
    "text.mat": (lambda p: mat(p, array_head(4, 30_000, 30_000)), "must hold vectors"),
    "numbers.mat": (
        lambda p: mat(p, array_head(6, 30_000, 30_000), element(9, bytes(8))),
        r"an array of shape \(30000, 30000\) has 1 numbers",
    ),
    "bomb.mat": (
        lambda p: mat(p, array_head(6, MUCH // 8, 1), element(9, bytes(MUCH))),
        "numbers, more than",
    ),
    "bomb.blf": (blf, "numbers, more than"),
    "bomb.mcap": (
        lambda p: mcap(p, "json", b"{}", b'{"a":1' + b" " * MUCH + b"}"),
        "numbers, more",
    ),
    "fields.mcap": (
        lambda p: mcap(p, "json", b"{}", *(b'{"f%d":1}' % k for k in range(60))),
        "51 columns, more than the 50",
    ),
    "path.mcap": (
        lambda p: mcap(p, "json", b"{}", json.dumps({"k" * 2000: [1] * 1000}).encode()),
        "a name has more than 1000 characters",
    ),
    "deep.mcap": (lambda p: mcap(p, "json", b"{}", b"[" * 90_000), "nested too deeply"),
    "endless.mcap": (lambda p: ros(p, 4), "it ends too early"),
    "empty.mcap": (lambda p: ros(p, 0), "must have a topic"),
    "huge.h5": (
        lambda p: hdf5(p, shape=(10**12,), chunks=(10**6,), compression="gzip"),
        "1000000000000 numbers",
    ),
    "external.h5": (
        lambda p: hdf5(p, shape=(10,), external=[("/etc/hostname", 0, 80)]),
        "q_m in .* is stored in other files, which are not read",
    ),
    "virtual.h5": (virtual, "is stored in other files"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_small_files_cost_little(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CJT_GYM_MAX_COLUMNS", "50")
    monkeypatch.setenv("CJT_GYM_MAX_NUMBERS", str(MUCH // 10))
    make, message = BOMBS[name]
    make(tmp_path / name)
    assert (tmp_path / name).stat().st_size < 200_000
    with pytest.raises(RecordError, match=message):
        read_log(tmp_path / name)


def test_a_record_larger_than_the_limit_is_read_as_large_as_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CJT_GYM_MAX_NUMBERS", "1")
    path = write_record(RECORD, tmp_path / "x.npz")
    assert len(read_log(path)[0][0]) == len(RECORD)


def test_a_table_that_is_not_utf_8_says_so(tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text('dt = 1.0\n[units]\nq_m = "rad"\n')
    (tmp_path / "run.csv").write_bytes("q_m\n1 \N{MICRO SIGN}\n".encode("latin-1"))
    from cjt_gym.records import read_record

    with pytest.raises(RecordError, match="must be a table of numbers as text in UTF-8: .*0xb5"):
        read_record(tmp_path / "run.csv")


def test_a_file_that_is_no_text_has_no_names(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(RecordError, match="got bytes that are no text"):
        draft_mapping(path)


def test_a_delay_that_would_fill_the_memory_is_an_error() -> None:
    from cjt_gym.joint import load_joint

    joint = load_joint("orange_80_6000", effects={"command_delay": {"delay": 1e9}})
    with pytest.raises(
        ConfigurationError, match="delays of orange_80_6000 together must be <= 100 s"
    ):
        joint.simulate([0.0] * 3)
