"""Every reader of a file: sound files as seeds, and how a changed one is read."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.baselines.gains import read_gains
from cjt_gym.canbus.config import load_joints
from cjt_gym.errors import CjtGymError
from cjt_gym.joint import load_joint
from cjt_gym.joint.build import build_joints
from cjt_gym.joint.files.joint_file import load_joint_file
from cjt_gym.records import load_mapping, read_log, read_record, write_record
from cjt_gym.records.record import Record
from cjt_gym.records.tables.can_table import frames
from cjt_gym.signals import make_signals
from cjt_gym.training.deploy.exported import load_exported
from cjt_gym.training.deploy.stepper import Stepper
from cjt_gym.training.learning.config import load_config
from cjt_gym.training.learning.run_folder import open_run
from cjt_gym.training.learning.runs import row_of
from tests.training.test_hostile_policies import policy

Parts = tuple[bytes, ...]
ROOT = Path(__file__).parents[2]
META = b'dt = 0.1\njoint = "orange_80_6000"\n[units]\nt = "s"\nq_m = "rad"\ntau_ref = "N m"\n'
BUS = b"""[columns]
q_m = "/A:q_m"
tau = { source = "/A:tau", unit = "mN m" }
"""
TOPIC = b'[columns]\nq_m = "/cjt_gym/record:q_m"\ntau = { source = "/b:y" }\n'
MAPPING = b"""n = 80
[columns]
t = { source = "time", unit = "ms" }
[columns.q_m]
unit = "deg"
side = "motor"
sign = -1
"""
GAINS = b"""controller = "pd"
[gains]
kp = { value = 1.0, unit = "-" }
[tuned]
joint = "x"
"""
BUILD = b"""structures = ["rigid"]
drives = ["current"]
[joints]
a = { file = "orange_80_6000", parameters = { k_b = 1e4 } }
[effects]
x = { coulomb = { dq_0 = 0.002 } }
"""
TOOLBOX = b"""function params = mine
params.('I_m') = 9.4e-02; % rotor
params.d_cm = 2.64;
d_g = 2.2
end
"""
DBC = b"""VERSION ""
NS_ :
BS_:
BU_: X
BO_ 100 A: 8 X
 SG_ q_m : 0|16@1- (0.01,0) [-300|300] "rad" X
 SG_ m M : 16|8@1+ (1,0) [0|0] "" X
 SG_ tau m1 : 24|16@1- (0.1,0) [0|0] "N m" X
"""


@dataclass(frozen=True)
class Target:
    """A reader.

    Attributes:
        seeds: Sound files, each in the parts that are changed.
        files: Files that parts make, by name.
        run: Reads them in a folder.
    """

    seeds: Sequence[Parts]
    files: Callable[[Parts], dict[str, bytes]]
    run: Callable[[Path], Any]


def record() -> Record:
    t = np.arange(12) * 0.1
    columns = {"t": t, "q_m": np.sin(t), "tau_ref": np.cos(t)}
    units = {"t": "s", "q_m": "rad", "tau_ref": "N m"}
    return Record(columns, units, joint="orange_80_6000", provenance={"mode": "test"})


def _written(suffix: str, folder: Path) -> bytes:
    return write_record(record(), folder / f"seed{suffix}").read_bytes()


def _both(path: Path) -> None:
    """Read a table as a log, as a record, and as a reference; an error of one hides no other."""
    refused: list[CjtGymError] = []
    for read in (read_log, read_record, lambda p: make_signals(str(p), 1.0)):
        try:
            read(path)
        except CjtGymError as error:
            refused.append(error)
    if len(refused) == 3:
        raise refused[0]


def table(suffix: str, seeds: Sequence[bytes]) -> Target:
    """Return the reader of a table, beside which lies what is known of it."""
    return Target(
        [(seed,) for seed in seeds],
        lambda parts: {f"x{suffix}": parts[0], "x.toml": META},
        lambda folder: _both(folder / f"x{suffix}"),
    )


def _traced(path: Path) -> None:
    """Read all frames, and now and then what they say, for which a DBC file is read."""
    for frame in frames(path):
        assert frame.timestamp is not None
    if path.stat().st_size % 16 == 0:
        _both(path)


def trace(suffix: str, folder: Path) -> Target:
    """Return the reader of a trace."""
    return Target(
        [(_trace(suffix, folder),)],
        lambda parts: {f"x{suffix}": parts[0], "x.dbc": DBC, "x.map.toml": BUS},
        lambda here: _traced(here / f"x{suffix}"),
    )


def text(name: str, seeds: Sequence[bytes], run: Callable[[Path], Any]) -> Target:
    """Return the reader of one text."""
    return Target(
        [(seed,) for seed in seeds],
        lambda parts: {name: parts[0]},
        lambda folder: run(folder / name),
    )


def _npz(names: Sequence[str]) -> Callable[[Parts], dict[str, bytes]]:
    def files(parts: Parts) -> dict[str, bytes]:
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
            for name, part in zip(names, parts, strict=True):
                archive.writestr(f"{name}.npy", part)
        return {"x.npz": buffer.getvalue(), "x.toml": META}

    return files


def _npy(values: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(values))
    return buffer.getvalue()


def _members(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {n.removesuffix(".npy"): archive.read(n) for n in archive.namelist()}


def _mat(folder: Path) -> list[bytes]:
    from scipy.io import savemat
    from scipy.sparse import eye

    columns = {name: record()[name] for name in record().columns}
    cell = np.empty((1, 2), object)
    cell[0, 0], cell[0, 1] = np.arange(3.0), "text"
    seeds = []
    for content, form in (
        (columns, "5"),
        (columns, "4"),
        (columns | {"log": {"c": cell, "s": "text", "e": eye(3).tocsc()}, "n": 1.0}, "5"),
    ):
        savemat(folder / "seed.mat", content, format=form)
        seeds.append((folder / "seed.mat").read_bytes())
    return seeds


def _packed_mat(parts: Parts) -> dict[str, bytes]:
    data = parts[0]
    if len(parts[0]) % 2 and len(data) > 136:  # every other one compressed
        body = zlib.compress(data[128:])
        data = data[:128] + struct.pack("<II", 15, len(body)) + body
    return {"x.mat": data, "x.toml": META}


def _hdf5(folder: Path) -> bytes:
    import h5py

    with h5py.File(folder / "seed.h5", "w") as file:
        for name in record().columns:
            file[name] = record()[name]
        del file["q_m"]
        file.create_dataset("q_m", data=record()["q_m"], chunks=(5,), compression="gzip")
        file["text"] = "words"
    return (folder / "seed.h5").read_bytes()


def _mcap(folder: Path) -> list[bytes]:
    from mcap.writer import CompressionType, Writer

    seeds = []
    for compression in (CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4):
        writer = Writer(str(folder / "seed.mcap"), compression=compression)
        writer.start()
        plain = writer.register_schema("a", "jsonschema", b"{}")
        ros = writer.register_schema(
            "p/A", "ros2msg", b"Foo[] x\nfloat64 y\nstring[] name\n" + b"=" * 80
            + b"\nMSG: p/Foo\nint32[] z\nuint8[2] w\n",
        )  # fmt: skip
        one = writer.register_channel("/cjt_gym/record", "json", plain)
        two = writer.register_channel("/b", "cdr", ros)
        for k in range(4):
            message = {"t": 0.1 * k, "q_m": k, "tau_ref": 1.0}
            writer.add_message(one, k, json.dumps(message).encode(), k)
            body = struct.pack("<IIIii2xxxdII", 1, 2, 0, 1, 2, 3.0, 1, 2)
            writer.add_message(two, k, b"\0\1\0\0" + body + b"a\0", k)
        writer.finish()
        seeds.append((folder / "seed.mcap").read_bytes())
    return seeds


def _trace(suffix: str, folder: Path) -> bytes:
    import can

    with can.Logger(folder / f"seed{suffix}") as logger:
        for k in range(20):
            logger(
                can.Message(
                    timestamp=1e9 + 0.1 * k,
                    arbitration_id=100,
                    is_extended_id=False,
                    data=struct.pack("<hBh3x", k, k % 2, 2 * k),
                )
            )
    return (folder / f"seed{suffix}").read_bytes()


def _blf_parts(data: bytes) -> Parts:
    """Return header, head of the container, and its content."""
    return data[:144], data[144:176], zlib.decompress(data[176:])


def _blf(parts: Parts) -> dict[str, bytes]:
    body = zlib.compress(parts[2])
    head = bytearray(parts[1].ljust(32, b"\0"))
    head[8:12] = struct.pack("<L", 32 + len(body))
    data = parts[0] + bytes(head) + body
    return {"x.blf": data, "x.dbc": DBC, "x.map.toml": BUS}


def _run_folder() -> tuple[bytes, bytes]:
    facts = {
        "kind": "cjt_gym training run",
        "schema": 1,
        "status": "done",
        "steps": 10,
        "seed": 0,
        "joint": "orange_80_6000",
        "structure": "rigid",
        "seconds": 1.0,
        "best_steps": 3,
    }
    return json.dumps(facts).encode(), b"steps,seconds,rmse,return,validation_rmse\n1,2,3,4,5\n"


def _read_run(folder: Path) -> None:
    run = open_run(folder)
    row_of(run)
    run.progress()


def _shipped(*names: str) -> list[bytes]:
    return [(ROOT / name).read_bytes() for name in names]


def _joint(path: Path) -> None:
    load_joint_file(path)
    load_joint(path, "output_fixed")


def targets(folder: Path) -> dict[str, Target]:
    """Return every reader, with seeds that are made in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    form = "t,q_m,tau_ref\n0,1,2\n0.1,2,3\n0.2,3,4\n"
    texts = [
        form,
        form.replace(",", ";").replace(".", ","),
        "# made by us\n" + form,
        form.replace(",", " "),
    ]
    arrays = {name: record()[name] for name in record().columns}
    kept = _members(_policy(folder).read_bytes())
    facts, progress = _run_folder()
    config = (ROOT / "training/configs/demo.toml").read_bytes()
    return {
        "csv": table(".csv", [t.encode() for t in texts]),
        "parquet": table(".parquet", [_written(".parquet", folder)]),
        "npz": Target(
            [tuple(map(_npy, arrays.values()))],
            _npz(list(arrays)),
            lambda f: _both(f / "x.npz"),
        ),
        "zip": table(".npz", [_written(".npz", folder)]),
        "mat": Target([(s,) for s in _mat(folder)], _packed_mat, lambda f: _both(f / "x.mat")),
        "h5": table(".h5", [_hdf5(folder)]),
        "mcap": Target(
            [(seed,) for seed in _mcap(folder)],
            lambda parts: {"x.mcap": parts[0], "x.map.toml": TOPIC},
            lambda f: _both(f / "x.mcap"),
        ),
        "log": trace(".log", folder),
        "asc": trace(".asc", folder),
        "trc": trace(".trc", folder),
        "blf": Target([_blf_parts(_trace(".blf", folder))], _blf, lambda f: _traced(f / "x.blf")),
        "dbc": Target(
            [(DBC, _trace(".log", folder))],
            lambda parts: {"x.dbc": parts[0], "x.log": parts[1], "x.map.toml": BUS},
            lambda f: _both(f / "x.log"),
        ),
        "facts": Target(
            [((folder / "seed.toml").read_bytes(),)],
            lambda parts: {"x.toml": parts[0], "x.csv": form.encode()},
            lambda f: _both(f / "x.csv"),
        ),
        "mapping": Target(
            [(MAPPING, b"time,q_m\n0,1\n100,2\n200,3\n")],
            lambda parts: {"x.map.toml": parts[0], "x.csv": parts[1]},
            lambda f: (load_mapping(f / "x.map.toml"), _both(f / "x.csv")),
        ),
        "joint": text(
            "x.toml", _shipped("params/orange_80_6000.toml", "params/lime_50_21000.toml"), _joint
        ),
        "toolbox": text("x.m", [TOOLBOX], load_joint_file),
        "build": text("x.toml", [BUILD], build_joints),
        "policy": Target(
            [tuple(kept.values())],
            _npz(list(kept)),
            lambda f: Stepper(load_exported(f / "x.npz")).step([1.0, 1.0], *[0.0] * 7),
        ),
        "gains": text("x.toml", [GAINS], read_gains),
        "config": text("x.toml", [config], load_config),
        "run": Target(
            [(facts, progress, config)],
            lambda p: dict(zip(("run.json", "progress.csv", "config.toml"), p, strict=True)),
            _read_run,
        ),
        "hardware": text(
            "x.toml",
            _shipped("examples/hardware/joint.toml", "examples/hardware/arm.toml"),
            load_joints,
        ),
    }


def _policy(folder: Path) -> Path:
    from cjt_gym.training.deploy.exported import save_exported

    return save_exported(policy(), folder / "policy.npz")
