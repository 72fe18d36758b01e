"""ODrive frames against the DBC that the maker publishes for firmware 0.6.10."""

from functools import cache
from importlib.resources import files
from typing import Any

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cjt_gym.canbus.protocols import PROTOCOLS, settings_of
from cjt_gym.canbus.protocols.contract import Fault, Mode, frame_of
from cjt_gym.canbus.protocols.odrive import OdriveMaster
from cjt_gym.canbus.protocols.odrive_firmware import OdriveFirmware
from cjt_gym.canbus.protocols.odrive_messages import ERRORS, ERRORS_05, IN_05, MESSAGES
from cjt_gym.errors import ConfigurationError, ProtocolError
from tests.canbus.protocols.line import Line, settings_for, started


@cache
def published(firmware: str = "0.6.10") -> Any:
    folder = files("odrive_can") / "dbc"
    return cantools.database.load_file(str(folder / f"odrive-cansimple-{firmware}.dbc"))


def message_of(name: str) -> Any:
    return published().get_message_by_name(f"Axis0_{name}")


every_message = pytest.mark.parametrize("name", MESSAGES)


@every_message
@given(data=st.binary(min_size=8, max_size=8))
def test_both_read_the_same_values(name: str, data: bytes) -> None:
    row = MESSAGES[name]
    data = data[: row.layout.size]
    theirs = message_of(name).decode(data, decode_choices=False) if data else {}
    for field, value in row.layout.decode(data).items():
        assert value == theirs[field] or value != value


@every_message
def test_length_and_direction(name: str) -> None:
    row, theirs = MESSAGES[name], message_of(name)
    assert row.layout.size == theirs.length
    assert row.to_drive == ("Master" in theirs.senders)
    assert row.command == theirs.frame_id


def test_the_masters_frames_are_those_of_the_dbc() -> None:
    master = OdriveMaster(settings_of(PROTOCOLS["odrive"], {"node": 3}, n=100.0))
    (_, closed) = master.enable()
    state = published().decode_message(0x067, closed.frames[0].data)
    assert (closed.frames[0].arbitration_id, state["Axis_Requested_State"]) == (
        0x067,
        "CLOSED_LOOP_CONTROL",
    )
    torque, *asked = master.command(12.0)
    assert torque.arbitration_id == 0x06E
    assert published().decode_message(0x06E, torque.data)["Input_Torque"] == pytest.approx(0.12)
    assert all(frame.is_remote_frame and not frame.data for frame in asked)
    assert {frame.arbitration_id for frame in asked} >= {0x069, 0x074}


def test_identifier_of_the_makers_example() -> None:
    frames = OdriveMaster(settings_of(PROTOCOLS["odrive"], {"node": 1})).disable()
    assert [frame.arbitration_id for frame in frames] == [0x2E, 0x27]


def test_a_heartbeat_by_the_dbc_is_understood() -> None:
    master = OdriveMaster(settings_of(PROTOCOLS["odrive"], {"node": 0}))
    values = {
        "Axis_Error": 0x1000000,
        "Axis_State": "IDLE",
        "Procedure_Result": 3,
        "Trajectory_Done_Flag": 0,
    }
    data = message_of("Heartbeat").encode(values)
    update = master.decode(frame_of(1, data))
    assert update is not None
    assert (update.mode, update.error, update.text) == (Mode.FAULT, 0x1000000, "watchdog expired")


def test_encoder_estimates_by_the_dbc_are_on_the_link_side() -> None:
    drive = {"node": 0, "sign": -1, "offset": 3.0}
    master = OdriveMaster(settings_of(PROTOCOLS["odrive"], drive, n=50.0))
    data = message_of("Get_Encoder_Estimates").encode({"Pos_Estimate": 2.5, "Vel_Estimate": 8.0})
    update = master.decode(frame_of(9, data))
    assert update is not None
    assert update.channels["q_m"] == pytest.approx(-(2.5 * 6.283185307 - 3.0) / 50.0)
    assert update.channels["dq_m"] == pytest.approx(-8.0 * 6.283185307 / 50.0)


def test_the_watchdog_can_be_set_over_its_endpoints() -> None:
    endpoints = {"watchdog_timeout_endpoint": 190, "enable_watchdog_endpoint": 191}
    line = Line(settings_for("odrive", **endpoints), "odrive")
    assert isinstance(line.firmware, OdriveFirmware)
    line.firmware.watchdog = 0.0
    line.start()
    assert line.firmware.watchdog == pytest.approx(line.settings.watchdog)
    write = next(frame for frame in line.sent if frame.arbitration_id == 3 << 5 | 4)
    assert write.data.hex() == "01be0000" + "cdcc4c3d"


def test_an_axis_with_an_error_refuses_to_run() -> None:
    line = Line(settings_for("odrive"), "odrive")
    line.pass_time(0.01)
    line.firmware.fail(Fault.OVER_TEMPERATURE)
    with pytest.raises(ProtocolError, match="ODrive 3 refuses closed loop control: motor too hot"):
        line.run(line.master.enable())


def test_a_drive_that_sends_in_its_cycle_is_not_asked() -> None:
    line = started("odrive", reports="cyclic", cycle_ms=4)
    heard = line.pass_time(1.0, lambda: line.master.command(0.1)[:1])
    estimates = [frame for frame in heard if frame.arbitration_id == 3 << 5 | 9]
    assert len(estimates) == pytest.approx(250, abs=2)
    assert len(line.master.command(0.1)) == 1
    assert line.master.periods["q_m"] == pytest.approx(4e-3)


def test_torque_only_in_torque_control() -> None:
    line = started("odrive")
    line.send(line.master.command(0.5))
    assert line.firmware.torque == pytest.approx(0.5)
    velocity = message_of("Set_Controller_Mode").encode({"Control_Mode": 2, "Input_Mode": 1})
    line.send([frame_of(3 << 5 | 0xB, velocity)])
    assert line.firmware.torque == 0.0


def test_emergency_stop() -> None:
    line = started("odrive")
    line.send([frame_of(3 << 5 | 2)])
    assert line.firmware.fault is Fault.STOPPED


def test_firmware_05_by_its_dbc() -> None:
    older = {message.name: message for message in published("0.5.6").messages}
    sent = [row for row in MESSAGES.values() if row.to_drive and row.name not in ("RxSdo", "Estop")]
    for row in (*sent, *(MESSAGES[name] for name in IN_05)):
        theirs = older[f"Axis0_{row.name}"]
        assert theirs.frame_id == row.command
        signals = {signal.name: signal for signal in theirs.signals}
        shift = 0
        for field in row.layout.fields:
            if field.name in signals and field.name != "Trajectory_Done_Flag":
                assert (signals[field.name].start, signals[field.name].length) == (
                    shift,
                    field.bits,
                )
            shift += field.bits
    choices = older["Axis0_Heartbeat"].get_signal_by_name("Axis_Error").choices
    assert set(ERRORS_05) == set(choices) - {0}
    newer = message_of("Heartbeat").get_signal_by_name("Axis_Error").choices
    assert set(ERRORS) == set(newer) - {0}


def test_a_drive_of_firmware_05() -> None:
    line = started("odrive", firmware="0.5")
    line.show({"q_m": 0.2, "v_bus": 24.0, "temperature": 55.0})
    line.pass_time(0.2, lambda: line.master.command(0.5))
    assert line.firmware.torque == pytest.approx(0.5)
    assert set(line.channels) == line.master.channels == {"q_m", "dq_m", "i", "v_bus"}
    line.firmware.fail(Fault.WATCHDOG)
    line.pass_time(0.2, line.master.poll)
    assert (line.mode, line.error) == (Mode.FAULT, 0x800)
    with pytest.raises(ConfigurationError, match="Endpoints must be 0 with firmware 0.5"):
        settings_for("odrive", firmware="0.5", enable_watchdog_endpoint=12)
