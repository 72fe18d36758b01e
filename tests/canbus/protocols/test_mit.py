"""MIT mini-cheetah frames against the makers' documents."""

import struct
from typing import Any

import pytest
from can import Message
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motor_driver import canmotorlib

from cjt_gym.canbus.protocols import PROTOCOLS, settings_of
from cjt_gym.canbus.protocols.contract import Mode, frame_of
from cjt_gym.canbus.protocols.mit import MODELS, MitMaster, command_layout
from cjt_gym.canbus.protocols.mit_firmware import MitFirmware
from cjt_gym.errors import ConfigurationError, ProtocolError


def master(**drive: object) -> MitMaster:
    return MitMaster(settings_of(PROTOCOLS["mit"], {"node": 1, **drive}))


def data_of(frames: list[Message]) -> list[str]:
    return [frame.data.hex(" ") for frame in frames]


def uint(x: float, low: float, high: float, bits: int) -> int:
    """The conversion that the manual prints; it cuts off where ours rounds."""
    return int((x - low) * ((1 << bits) - 1) / (high - low))


def test_special_frames_are_those_of_the_manual() -> None:
    enter = master().enable()[1].frames[0]
    assert enter.arbitration_id == 1
    assert enter.data.hex() == "fffffffffffffffc"
    assert master().disable()[-1].data.hex() == "fffffffffffffffd"


def test_zero_torque_is_the_manuals_frame_of_zeros() -> None:
    assert data_of(master().command(0.0)) == ["7f ff 7f f0 00 00 07 ff"]


@pytest.mark.parametrize("torque", [-18.0, -7.3, -0.1, 3.3, 17.9, 18.0])
def test_torque_is_packed_as_the_manual_packs_it(torque: float) -> None:
    data = master(model="AK80-9").command(torque)[0].data
    packed = (data[6] & 0xF) << 8 | data[7]
    assert packed - uint(torque, -18.0, 18.0, 12) in (0, 1)
    assert data[:6].hex() == "7fff7ff00000"


def test_all_fields_of_a_command_lie_where_the_manual_puts_them() -> None:
    values = {"position": 3.0, "velocity": -20.0, "kp": 120.0, "kd": 2.5, "torque": 5.0}
    data = command_layout(MODELS["AK10-9"]).encode(values)
    p, v = data[0] << 8 | data[1], data[2] << 4 | data[3] >> 4
    kp, kd = (data[3] & 0xF) << 8 | data[4], data[5] << 4 | data[6] >> 4
    assert p - uint(3.0, -12.5, 12.5, 16) in (0, 1)
    assert v - uint(-20.0, -50.0, 50.0, 12) in (0, 1)
    assert kp - uint(120.0, 0.0, 500.0, 12) in (0, 1)
    assert kd - uint(2.5, 0.0, 5.0, 12) in (0, 1)


def test_a_reply_of_eight_bytes() -> None:
    reply = frame_of(0, bytes.fromhex("01 8000 80 0c 00 2a 00"))
    update = master().decode(reply)
    assert update is not None
    assert update.channels["q_m"] == pytest.approx(0.5 * 25 / 65535)
    assert update.channels["dq_m"] == pytest.approx(0.5 * 100 / 4095)
    assert update.channels["tau_m"] == pytest.approx(-18 + 0xC00 * 36 / 4095)
    assert update.channels["temperature"] == 42.0
    assert (update.mode, update.error) == (None, 0)


def test_a_reply_of_six_bytes_needs_its_option() -> None:
    reply = frame_of(0, bytes.fromhex("01 8000 80 0c 00"))
    with pytest.raises(ProtocolError, match="must have 8 bytes, got 6.*reply_bytes"):
        master().decode(reply)
    update = master(reply_bytes=6).decode(reply)
    assert update is not None
    assert set(update.channels) == {"q_m", "dq_m", "tau_m"}


def test_replies_of_other_drives_are_not_taken() -> None:
    reply = frame_of(0, bytes.fromhex("02 8000 80 0c 00 2a 00"))
    assert master().decode(reply) is None


def test_the_end_of_a_range_is_no_value() -> None:
    reply = frame_of(0, bytes.fromhex("01 ffff 00 0f ff 2a 00"))
    update = master().decode(reply)
    assert update is not None
    assert update.channels["q_m"] != update.channels["q_m"]
    assert update.channels["dq_m"] != update.channels["dq_m"]
    assert update.channels["tau_m"] == pytest.approx(18.0)


def test_gains_of_another_master_are_obeyed() -> None:
    firmware = MitFirmware(settings_of(PROTOCOLS["mit"], {"node": 1}))
    firmware.boot(0.0)
    layout = command_layout(MODELS["AK80-9"])
    enter = frame_of(1, bytes.fromhex("ff" * 7 + "fc"))
    stiff = layout.encode({"position": 0.1, "kp": 50.0, "kd": 1.0})
    firmware.receive(enter, 0.0)
    firmware.receive(frame_of(1, stiff), 0.0)
    assert firmware.torque == pytest.approx(5.0, abs=0.1)
    firmware.update({"q_m": 0.1, "dq_m": 1.0}, 0.001)
    assert firmware.torque == pytest.approx(-1.0, abs=0.1)


def test_ranges_of_another_model() -> None:
    assert master(model="AK80-64").torque_range == (-144.0, 144.0)
    assert master(ranges=[12.5, 30.0, 32.0]).torque_range == (-32.0, 32.0)
    with pytest.raises(ConfigurationError, match="ranges must be the three ends"):
        master(ranges=[1.0])
    with pytest.raises(ConfigurationError, match="model of .* must be one of AK10-9"):
        master(model="AK1")
    with pytest.raises(ProtocolError, match=r"torque must lie in \[-18, 18\] N m, got 19 N m"):
        master().command(19.0)


class Wire:
    """What the client of others takes for a socket: a drive of ours at its end."""

    def __init__(self, ranges: list[float]) -> None:
        drive = {"node": 1, "ranges": ranges, "reply_bytes": 6}
        self.firmware = MitFirmware(settings_of(PROTOCOLS["mit"], drive))
        self.firmware.boot(0.0)
        self.heard: list[Message] = []
        self.answers: list[Message] = []

    def send(self, packed: bytes) -> None:
        identifier, _, data = struct.unpack("=IB3x8s", packed)
        self.heard.append(frame_of(identifier, data))
        self.answers += self.firmware.receive(self.heard[-1], 0.0)

    def recvfrom(self, size: int) -> tuple[bytes, None]:
        frame = self.answers.pop(0)
        return struct.pack("=IB3x6s", frame.arbitration_id, frame.dlc, bytes(frame.data)), None


@pytest.fixture(name="client")
def _client(monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Wire]:
    """An independent client of the protocol, from the Underactuated Lab of DFKI."""
    wire = Wire([12.5, 25.64, 18.0])
    monkeypatch.setattr(canmotorlib, "set_zero_sleep", 0.0)
    monkeypatch.setattr(canmotorlib, "dt_sleep", 0.0)
    monkeypatch.setattr(canmotorlib.CanMotorController, "can_socket_declared", True)
    monkeypatch.setattr(canmotorlib.CanMotorController, "motor_socket", wire)
    return canmotorlib.CanMotorController("can0", 1, "AK80_9_V2"), wire


def test_another_client_switches_our_drive_on_and_off(client: tuple[Any, Wire]) -> None:
    controller, wire = client
    controller.enable_motor()
    assert wire.firmware.mode is Mode.ENABLED
    controller.disable_motor()
    assert wire.firmware.mode is Mode.DISABLED


@given(
    torque=st.floats(-18.0, 18.0),
    kp=st.floats(0.0, 500.0),
    kd=st.floats(0.0, 5.0),
    q=st.floats(-12.0, 12.0),
    dq=st.floats(-25.0, 25.0),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100)
def test_another_client_and_our_drive_agree(
    client: tuple[Any, Wire], torque: float, kp: float, kd: float, q: float, dq: float
) -> None:
    controller, wire = client
    controller.enable_motor()
    wire.firmware.update({"q_m": q, "dq_m": dq, "tau_m": torque}, 0.0)
    zero = wire.firmware._zero
    shown = controller.send_rad_command(q - zero, dq, kp, kd, torque)
    if abs(q - zero) < 12.4:
        assert shown[0] == pytest.approx(q - zero, abs=25.0 / 65535)
    assert shown[1] == pytest.approx(dq, abs=51.28 / 4095)
    assert shown[2] == pytest.approx(torque, abs=36.0 / 4095)
    told = command_layout((12.5, 25.64, 18.0)).decode(wire.heard[-1].data)
    assert told["kp"] == pytest.approx(kp, abs=500.0 / 4095)
    assert told["kd"] == pytest.approx(kd, abs=5.0 / 4095)
    assert told["torque"] == pytest.approx(torque, abs=36.0 / 4095)
