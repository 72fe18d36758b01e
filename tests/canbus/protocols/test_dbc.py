"""A drive by its DBC file: octets by hand, and the maker's DBC of an ODrive."""

from importlib.resources import files
from math import pi
from pathlib import Path
from typing import Any

import pytest
from can import Message

from cjt_gym.canbus.protocols import PROTOCOLS, settings_of
from cjt_gym.canbus.protocols.contract import Master, Mode
from cjt_gym.errors import CjtGymError, ConfigurationError, ProtocolError, UnknownNameError
from tests.canbus.protocols.line import Line, settings_for

ODRIVE_MAPPING = """
n = 50.0
[can]
dbc = "{dbc}"
disabled = {{ "/Axis3_Set_Axis_State:Axis_Requested_State" = 1 }}
state = {{ source = "/Axis3_Heartbeat:Axis_State", disabled = [1], enabled = [8] }}
error = "/Axis3_Heartbeat:Axis_Error"
[can.enabled]
"/Axis3_Set_Axis_State:Axis_Requested_State" = 8
"/Axis3_Set_Controller_Mode:Control_Mode" = 1
"/Axis3_Set_Controller_Mode:Input_Mode" = 1
[columns.tau_cmd]
source = "/Axis3_Set_Input_Torque:Input_Torque"
side = "motor"
sign = -1
[columns.q_m]
source = "/Axis3_Get_Encoder_Estimates:Pos_Estimate"
unit = "rev"
side = "motor"
sign = -1
[columns.i]
source = "/Axis3_Get_Iq:Iq_Measured"
sign = -1
"""


def master(**drive: Any) -> Master:
    return PROTOCOLS["dbc"].master(settings_of(PROTOCOLS["dbc"], drive))


TORQUE, ANGLE = 0x10000300, 0x10000301


def frame(identifier: int, octets: str) -> Message:
    return Message(
        arbitration_id=identifier, is_extended_id=identifier > 0x7FF, data=bytes.fromhex(octets)
    )


def test_a_command_by_hand() -> None:
    (sent,) = master(file="example_drive").command(50.0)
    assert sent.arbitration_id == 257
    assert sent.data.hex(" ") == "fe 0c 01 00 00 00 00 00"


def test_a_report_by_hand() -> None:
    update = master(file="example_drive").decode(frame(513, "70 17 00 3c 00 18 fc 0a"))
    assert update is not None
    assert update.channels["q_m"] == pytest.approx(-(60.0 - 12.0) * pi / 180 / 50)
    assert update.channels["dq_m"] == pytest.approx(-30.0 * 2 * pi / 60 / 50)
    assert update.channels["i"] == pytest.approx(5.0)
    assert (update.mode, update.error, update.text) == (Mode.ENABLED, 2, "error 2")


def test_a_sensor_is_heard_and_never_commanded() -> None:
    sensor = master(file="torque_sensor")
    assert sensor.channels == {"tau"}
    assert sensor.periods == {"tau": pytest.approx(1e-3)}
    assert not [*sensor.command(3.0), *sensor.poll(), *sensor.disable(), *sensor.enable()]
    update = sensor.decode(frame(TORQUE, "00 00 80 bf 00 07"))
    assert update is not None
    assert (update.channels, update.error) == ({"tau": -1.0}, 0)


def test_sensors_of_different_nodes_do_not_hear_each_other() -> None:
    torque = frame(TORQUE, "00 00 80 bf 00 07")
    angle = frame(ANGLE, "00 00 80 3f 00 00 00 00")
    assert master(file="torque_sensor").decode(angle) is None
    assert master(file="load_encoder").decode(torque) is None
    update = master(file="load_encoder").decode(angle)
    assert update is not None
    assert update.channels == {"q_l": 1.0, "dq_l": 0.0}


@pytest.mark.parametrize("name", ["torque_sensor", "load_encoder", "joint_sensor"])
def test_an_emulated_sensor_reports_the_joint(name: str) -> None:
    line = Line(settings_for("dbc", file=name), "dbc")
    line.show({"tau": -3.25, "q_l": 0.5, "dq_l": 0.125})
    line.run(line.master.configure())
    line.pass_time(0.01)
    assert set(line.channels) == line.master.channels
    for channel, value in line.channels.items():
        assert value == line.joint[channel]


def test_the_makers_dbc_of_an_odrive_drives_an_odrive(tmp_path: Path) -> None:
    dbc = files("odrive_can") / "dbc" / "odrive-cansimple-0.6.10.dbc"
    path = tmp_path / "odrive.map.toml"
    path.write_text(ODRIVE_MAPPING.format(dbc=dbc), encoding="utf-8")
    line = Line(settings_for("odrive", reports="cyclic", sign=-1, offset=0.0), "odrive")
    line.master = master(file=str(path))
    line.start()
    line.show({"q_m": 0.3, "i": 2.0})
    line.pass_time(0.05, lambda: line.master.command(0.75))
    assert line.mode is Mode.ENABLED
    assert line.firmware.torque == pytest.approx(0.75)
    assert line.channels["q_m"] == pytest.approx(0.3)
    assert line.channels["i"] == pytest.approx(2.0)
    line.send(line.master.disable())
    assert line.firmware.mode is Mode.DISABLED


def test_a_current_is_commanded_where_the_drive_takes_no_torque(tmp_path: Path) -> None:
    text = (files("cjt_gym.canbus.protocols") / "data" / "example_drive.map.toml").read_text()
    text = text.replace("tau_cmd", "i_cmd").replace('unit = "N m"\nside = "motor"\n', "")
    path = tmp_path / "current.map.toml"
    dbc = files("cjt_gym.canbus.protocols") / "data" / "example_drive.dbc"
    path.write_text(text.replace("example_drive.dbc", str(dbc)), encoding="utf-8")
    settings = settings_of(PROTOCOLS["dbc"], {"file": str(path), "torque_constant": 0.1}, n=50.0)
    line = Line(settings, "dbc")
    (sent,) = line.master.command(15.0)
    assert int.from_bytes(sent.data[:2], "big", signed=True) * 0.002 == pytest.approx(-3.0)
    line.start()
    line.send(line.master.command(15.0))
    assert line.firmware.torque == pytest.approx(15.0, abs=0.02)
    with pytest.raises(ConfigurationError, match="torque_constant must be given"):
        master(file=str(path))


def test_a_torque_beyond_the_declared_range_is_refused() -> None:
    drive = master(file="example_drive")
    assert drive.torque_range == (pytest.approx(-3000.0), pytest.approx(3000.0))
    with pytest.raises(ProtocolError, match="Drive_Command cannot be sent"):
        drive.command(3001.0)


def test_a_frame_that_is_too_short_is_an_error() -> None:
    with pytest.raises(ProtocolError, match="Drive_State breaks its DBC file: Wrong data size: 2"):
        master(file="example_drive").decode(frame(513, "00 00"))


@pytest.mark.parametrize(
    ("text", "error", "match"),
    [
        ("n = 1", ConfigurationError, r"must have a table \[can\] with  dbc"),
        ('[can]\ndbc = "none.dbc"', ConfigurationError, "must have a table per column"),
        (
            '[can]\ndbc = "none.dbc"\n[columns.q_m]\nsource = "/A:B"',
            ConfigurationError,
            "There is no DBC file .*none.dbc",
        ),
        ('[can]\ndbc = "DBC"\nspeed = 1', UnknownNameError, "Unknown key in .can. of"),
        (
            '[can]\ndbc = "DBC"\n[columns.q_m]\nsource = "/Drive_Stat:Position"',
            UnknownNameError,
            "Did you mean 'Drive_State'",
        ),
        (
            '[can]\ndbc = "DBC"\n[columns.q_m]\nsource = "/Drive_State:Positio"',
            UnknownNameError,
            "Did you mean 'Position'",
        ),
        (
            '[can]\ndbc = "DBC"\n[columns.q_m]\nsource = "Position"',
            ConfigurationError,
            "must be \"/Message:Signal\", got 'Position'",
        ),
        (
            '[can]\ndbc = "DBC"\n[columns.tau_cmd]\nsource = "/Drive_Command:Torque"',
            ConfigurationError,
            "must map at least one of q_m",
        ),
        ("[can", ConfigurationError, "must be a TOML file"),
    ],
)
def test_a_bad_mapping_is_one_clear_error(
    tmp_path: Path, text: str, error: type[CjtGymError], match: str
) -> None:
    dbc = files("cjt_gym.canbus.protocols") / "data" / "example_drive.dbc"
    path = tmp_path / "bad.map.toml"
    path.write_text(text.replace("DBC", str(dbc)), encoding="utf-8")
    with pytest.raises(error, match=match):
        master(file=str(path))


def test_an_unknown_mapping_is_told_with_the_known_ones() -> None:
    with pytest.raises(ConfigurationError, match="one of example_drive, joint_sensor"):
        master(file="exmple")
