"""Traces of a bus, written by python-can and read as records."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from cjt_gym.canbus.protocols import PROTOCOLS, settings_of
from cjt_gym.canbus.traces import read_trace
from cjt_gym.cli import main
from cjt_gym.disk import to_toml
from cjt_gym.errors import RecordError
from cjt_gym.records import read_log, read_record
from tests.canbus.bench import document
from tests.canbus.protocols.line import DRIVES, Line, settings_for, started

SAMPLES = 300
PERIOD = 2e-3
START = 1.7e9
SUFFIXES = [".log", ".asc", ".blf", ".trc"]


def torque(k: int) -> float:
    return 0.4 * np.sin(0.05 * k)


def joint(k: int) -> dict[str, float]:
    return {"q_m": 0.02 * np.sin(0.05 * k), "dq_m": 0.01, "tau": 0.3 * np.cos(0.05 * k), "i": 0.1}


def recorded(path: Path, name: str) -> None:
    """Write the trace of a drive and a torque sensor."""
    line = Line(settings_for(name), name)
    sensor = PROTOCOLS["dbc"].firmware(settings_of(PROTOCOLS["dbc"], {"file": "torque_sensor"}))
    line.start()
    sensor.boot(line.now)
    with can.Logger(path) as logger:
        for k in range(SAMPLES):
            line.show(joint(k))
            frames = list(line.master.command(torque(k)))
            frames += line.send(frames) + line.pass_time(PERIOD)
            frames += sensor.update(joint(k), line.now)
            latest = {(each.arbitration_id, each.is_remote_frame): each for each in frames}
            for late, frame in enumerate(latest.values()):
                frame.timestamp = START + k * PERIOD + late * 5e-5
                frame.channel = "can0"
                logger.on_message_received(frame)


def nodes(name: str) -> list[Any]:
    sensor = settings_of(PROTOCOLS["dbc"], {"file": "torque_sensor"})
    return [(PROTOCOLS[name], settings_for(name)), (PROTOCOLS["dbc"], sensor)]


def check(records: Any, late: int = 1) -> None:
    (record,) = records
    assert len(record) >= SAMPLES - 20
    assert np.median(np.diff(record.t)) == pytest.approx(PERIOD, rel=0.01)
    k = np.round((record.t - record.t[0]) / PERIOD)
    first = SAMPLES - len(record)
    if "tau_cmd" in record.columns:
        expected = np.array([torque(each) for each in k + first])
        assert np.nanmax(np.abs(record["tau_cmd"] - expected)) < 0.06
    angles = np.array([joint(each)["q_m"] for each in k + first - late])
    error = np.abs(record["q_m"] - angles)[20:-20]
    assert np.nanmedian(error) < 3e-3
    assert np.nanmedian(np.abs(record["tau"])) > 0.1


@pytest.mark.parametrize(
    ("name", "suffix"),
    [(name, ".log") for name in sorted(DRIVES)] + [("odrive", suffix) for suffix in SUFFIXES[1:]],
)
def test_a_trace_through_each_protocol_and_of_every_kind(
    tmp_path: Path, name: str, suffix: str
) -> None:
    recorded(tmp_path / f"run{suffix}", name)
    records, repairs = read_trace(tmp_path / f"run{suffix}", nodes(name))
    check(records)
    assert not [each for each in repairs if each.kind == "unreadable"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_trace_with_its_dbc_file_is_a_log_like_any_other(tmp_path: Path, suffix: str) -> None:
    data = files("cjt_gym.canbus.protocols") / "data"
    (tmp_path / "bus.dbc").write_text((data / "example_drive.dbc").read_text())
    (tmp_path / "run.map.toml").write_text((data / "example_drive.map.toml").read_text())
    line = started("dbc")
    with can.Logger(tmp_path / f"run{suffix}") as logger:
        for k in range(SAMPLES):
            line.show(joint(k))
            for frame in [*line.master.command(torque(k)), *line.pass_time(PERIOD)[-1:]]:
                frame.timestamp = START + k * PERIOD
                frame.channel = "can0"
                logger.on_message_received(frame)
    ((record,), _) = read_log(tmp_path / f"run{suffix}")
    assert {"tau_cmd", "q_m", "dq_m", "i"} <= set(record.columns)
    expected = [torque(k) for k in range(SAMPLES)]
    assert record["tau_cmd"] == pytest.approx(np.array(expected), abs=0.06)
    assert record["q_m"] == pytest.approx(
        np.array([joint(k)["q_m"] for k in range(SAMPLES)]), abs=1e-4
    )


def test_frames_that_break_their_protocol_are_counted(tmp_path: Path) -> None:
    recorded(tmp_path / "run.log", "odrive")
    with (tmp_path / "run.log").open("a") as file:
        file.write("(1700000000.700000) can0 069#0011\n")
    _, repairs = read_trace(tmp_path / "run.log", nodes("odrive"))
    assert [each.count for each in repairs if each.kind == "unreadable"] == [1]


def test_a_trace_of_other_nodes_is_told(tmp_path: Path) -> None:
    (tmp_path / "run.log").write_text("(1700000000.700000) can0 7FF#00\n")
    with pytest.raises(RecordError, match="No frame of .* is from these nodes"):
        read_trace(tmp_path / "run.log", nodes("odrive"))


def test_a_trace_needs_its_dbc_file(tmp_path: Path) -> None:
    (tmp_path / "run.log").write_text("(1700000000.700000) can0 7FF#00\n")
    with pytest.raises(RecordError, match=r"needs the DBC file of its bus.* as run\.dbc"):
        read_log(tmp_path / "run.log")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_no_trace_is_told(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    path.write_bytes(b"\x00\x01 no trace \xff\n" * 20)
    with pytest.raises(RecordError):
        read_trace(path, nodes("odrive"))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_traces_are_converted_from_the_command_line(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "joint.toml"
    drive = DRIVES["odrive"] | {"protocol": "odrive"}
    config.write_text(
        to_toml(document(drive=drive)) + '[sensors.t]\nprotocol = "dbc"\nfile = "torque_sensor"\n'
    )
    recorded(tmp_path / f"run{suffix}", "odrive")
    out = tmp_path / "run.mcap"
    words = ["convert", str(tmp_path / f"run{suffix}"), "--bus", str(config), "--out", str(out)]
    assert main([*words, "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["records"]
    record = read_record(out, allow_nan=True)
    assert len(record) == told["samples"] > 200
    assert {"tau_cmd", "q_m", "tau"} <= set(record.columns)
    assert record.joint == "orange_80_6000"


@pytest.mark.parametrize("name", ["run.csv", "run.parquet", "run.mat", "run.mcap", "run.npz"])
def test_records_are_converted_to_every_format(tmp_path: Path, name: str) -> None:
    assert main(["convert", "hebi_sea", "--out", str(tmp_path / name)]) == 0
    there, back = read_record("hebi_sea"), read_record(tmp_path / name)
    assert list(there.columns) == list(back.columns)
    np.testing.assert_allclose(back["t"], there["t"], rtol=1e-9)
