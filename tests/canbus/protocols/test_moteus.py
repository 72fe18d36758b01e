"""moteus frames against the maker's documents and against its own Python client."""

from math import nan, tau
from typing import Any

import moteus
import pytest
from can import Message
from hypothesis import given
from hypothesis import strategies as st

from cjt_gym.canbus.protocols import PROTOCOLS, settings_of
from cjt_gym.canbus.protocols.contract import Fault, Mode, frame_of
from cjt_gym.canbus.protocols.moteus import MoteusMaster
from cjt_gym.canbus.protocols.moteus_firmware import MoteusFirmware
from cjt_gym.canbus.protocols.moteus_registers import (
    FLOAT,
    INT8,
    INT16,
    INT32,
    REGISTERS,
    REPLY,
    WRITE,
    pad,
    read,
    said,
    subframe,
)
from cjt_gym.errors import ConfigurationError, ProtocolError
from tests.canbus.protocols.line import Line, settings_for

TYPES = {INT8: moteus.INT8, INT16: moteus.INT16, INT32: moteus.INT32, FLOAT: moteus.F32}


def settings(**drive: Any) -> Any:
    return settings_of(PROTOCOLS["moteus"], {"node": 1, **drive})


def client(node: int = 1) -> moteus.Controller:
    return moteus.Controller(id=node, transport=object())


def frame_of_client(command: Any) -> Message:
    identifier = 0x8000 | command.source << 8 | 1
    return frame_of(identifier, pad(bytes(command.data)), extended=True, fd=True)


def test_the_documents_example_of_a_command() -> None:
    found = read(bytes.fromhex("01000a07206000200150ff140400130d"))
    assert said(found, "write") == {
        0x000: 10,
        0x020: pytest.approx(3.456 / 360),
        0x021: pytest.approx(25.92 / 360),
        0x022: pytest.approx(-1.76),
    }
    assert [each.numbers for each in found if each.kind == "ask"] == [range(4), range(0x00D, 0x010)]


def test_the_documents_example_of_a_reply() -> None:
    reply = frame_of(0x100, bytes.fromhex("2404000a005000000170ff230d181400"), fd=True)
    update = MoteusMaster(settings()).decode(reply)
    assert update is not None
    assert update.channels["q_m"] == pytest.approx(2.88 * tau / 360)
    assert update.channels["dq_m"] == pytest.approx(23.04 * tau / 360)
    assert update.channels["tau_m"] == pytest.approx(-1.44)
    assert update.channels["v_bus"] == 12.0
    assert update.channels["temperature"] == 20.0
    assert (update.mode, update.error) == (Mode.ENABLED, 0)


def test_the_address_of_the_master_has_seven_bits() -> None:
    assert MoteusMaster(settings(source=5)).poll()[0].arbitration_id == 0x8501
    with pytest.raises(ConfigurationError, match=r"source of .* must be >= 0 and <= 126, got 200"):
        settings(source=200)


def test_identifiers_of_the_document() -> None:
    (frame,) = MoteusMaster(settings()).command(0.0)
    assert frame.arbitration_id == 0x8001
    assert frame.is_extended_id
    assert frame.is_fd
    assert len(frame.data) == 48


@pytest.mark.parametrize("kind", TYPES)
@given(share=st.floats(-0.999, 0.999))
def test_the_client_reads_what_we_write(kind: int, share: float) -> None:
    for number, row in REGISTERS.items():
        high = min(row.field(kind).range[1], 1000.0)
        value = share * high if row.quantity != "number" else round(share * min(high, 100))
        parsed = moteus.parse_registers(subframe(WRITE, kind, number, [value])).command
        step = 0.0 if kind == FLOAT else row.field(kind).scale
        assert parsed[number] == pytest.approx(value, abs=0.51 * step + 1e-6 * high), row.name


@pytest.mark.parametrize("kind", [INT8, INT16, INT32, FLOAT])
def test_nothing_is_the_lowest_integer(kind: int) -> None:
    data = subframe(REPLY, kind, 0x001, [nan])
    (found,) = read(data)
    assert found.values[0] != found.values[0]
    theirs = moteus.parse_registers(data).response[1]
    assert theirs != theirs


@given(torque=st.floats(-50.0, 50.0))
def test_a_command_is_that_of_the_client(torque: float) -> None:
    ours, theirs = (MoteusFirmware(settings()) for _ in range(2))
    command = client().make_position(
        position=nan,
        velocity=0.0,
        kp_scale=0.0,
        kd_scale=0.0,
        ilimit_scale=0.0,
        feedforward_torque=torque,
        watchdog_timeout=0.05,
        query=True,
    )
    frames = (MoteusMaster(settings()).command(torque)[0], frame_of_client(command))
    for firmware, frame in zip((ours, theirs), frames, strict=True):
        firmware.boot(0.0)
        firmware.receive(frame, 0.0)
        firmware.update({"q_m": 0.3, "dq_m": 0.5}, 0.01)
        assert firmware.torque == pytest.approx(torque, abs=1e-5)
        firmware.update({}, 0.049)
        assert firmware.mode is Mode.ENABLED
        firmware.update({}, 0.051)
        assert firmware.fault is Fault.WATCHDOG
    parsed = moteus.parse_registers(bytes(frames[0].data)).command
    assert parsed[moteus.Register.MODE] == moteus.Mode.POSITION
    assert parsed[moteus.Register.COMMAND_FEEDFORWARD_TORQUE] == pytest.approx(torque, abs=1e-5)
    assert parsed[moteus.Register.COMMAND_TIMEOUT] == pytest.approx(0.05)


def test_the_client_reads_our_drive() -> None:
    firmware = MoteusFirmware(settings())
    firmware.boot(0.0)
    joint = {"q_m": 1.0, "dq_m": -2.0, "tau_m": 0.25, "i": 3.0, "temperature": 31.0, "v_bus": 24.0}
    firmware.update(joint, 0.0)
    (reply,) = firmware.receive(frame_of_client(client().make_query()), 0.0)
    assert reply.arbitration_id == 0x100
    values = moteus.parse_registers(bytes(reply.data)).response
    register = moteus.Register
    assert values[register.MODE] == moteus.Mode.STOPPED
    assert values[register.POSITION] == pytest.approx(1.0 / tau)
    assert values[register.VELOCITY] == pytest.approx(-2.0 / tau)
    assert values[register.TORQUE] == pytest.approx(0.25)
    assert values[register.VOLTAGE] == pytest.approx(24.0)
    assert values[register.TEMPERATURE] == pytest.approx(31.0)


def test_the_clients_position_control_holds_a_position() -> None:
    firmware = MoteusFirmware(settings())
    firmware.boot(0.0)
    firmware.receive(frame_of_client(client().make_position(position=0.5, query=True)), 0.0)
    assert firmware.torque == pytest.approx(4.0 * 0.5)
    stop = frame_of_client(client().make_stop())
    firmware.receive(stop, 0.0)
    assert firmware.mode is Mode.DISABLED


def test_an_unknown_register_is_an_error_of_its_own() -> None:
    firmware = MoteusFirmware(settings())
    firmware.boot(0.0)
    ask = Message(arbitration_id=0x8001, is_fd=True, data=bytes.fromhex("11f00250"))
    (reply,) = firmware.receive(ask, 0.0)
    assert moteus.parse_registers(bytes(reply.data)).errors[0][0] == 0x170
    with pytest.raises(ProtocolError, match="moteus 1 has no register 0x170"):
        MoteusMaster(settings()).decode(reply)


def test_a_drive_with_a_fault_refuses_to_run() -> None:
    line = Line(settings_for("moteus"), "moteus")
    line.firmware.fail(Fault.ENCODER)
    with pytest.raises(ProtocolError, match="moteus 3 refuses to run: encoder"):
        line.run(line.master.enable())


def test_a_limiting_code_is_no_fault() -> None:
    data = subframe(REPLY, INT8, 0x000, [10]) + subframe(REPLY, INT8, 0x00F, [99])
    update = MoteusMaster(settings()).decode(frame_of(0x100, pad(data), fd=True))
    assert update is not None
    assert (update.mode, update.error) == (Mode.ENABLED, 0)


def test_a_gateway_that_forgets_that_frames_are_can_fd() -> None:
    firmware = MoteusFirmware(settings())
    firmware.boot(0.0)
    (sent,) = MoteusMaster(settings()).poll()
    (reply,) = firmware.receive(sent, 0.0)
    plain = Message(arbitration_id=reply.arbitration_id, is_extended_id=False, check=False)
    plain.data = reply.data
    update = MoteusMaster(settings()).decode(plain)
    assert update is not None
    assert update.mode is Mode.DISABLED
