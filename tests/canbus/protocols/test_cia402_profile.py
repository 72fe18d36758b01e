"""CiA 402 without CANopen: a drive on another bus is told the same, here by CoE's two calls."""

from __future__ import annotations

import pytest

from cjt_gym.canbus.protocols.cia402_objects import OBJECTS, PDOS, State
from cjt_gym.canbus.protocols.cia402_profile import ENABLING, Controlword, Profile
from cjt_gym.canbus.protocols.contract import Mode
from cjt_gym.errors import ProtocolError
from tests.canbus.protocols.line import settings_for

SHOWN = {
    Controlword.DISABLE_VOLTAGE: State.SWITCH_ON_DISABLED,
    Controlword.SHUTDOWN: State.READY,
    Controlword.SWITCH_ON: State.SWITCHED_ON,
    Controlword.ENABLE: State.ENABLED,
}


class Slave:
    """A drive as an EtherCAT master sees it: objects by SDO, and process data as bytes."""

    def __init__(self, profile: Profile) -> None:
        self.objects = {key: bytes(row.field.bits // 8) for key, row in OBJECTS.items()}
        self.objects[0x1000, 0] = (0x00020192).to_bytes(4, "little")
        for access in profile.setup():
            if access.value is None and access.key == (0x608F, 1):
                self.objects[access.key] = profile.increments.to_bytes(4, "little")
        self.objects[0x6076, 0] = round(profile.rated_torque * 1e3).to_bytes(4, "little")
        self.objects[0x6075, 0] = round(profile.rated_current * 1e3).to_bytes(4, "little")

    def sdo_write(self, index: int, subindex: int, data: bytes) -> None:
        assert len(data) == OBJECTS[index, subindex].field.bits // 8
        self.objects[index, subindex] = data

    def sdo_read(self, index: int, subindex: int) -> bytes:
        return self.objects[index, subindex]

    def exchange(self, output: bytes) -> bytes:
        values = PDOS[0].layout.decode(output)
        torque = int(values["Target torque"])
        state = SHOWN[int(values["Controlword"])]
        return PDOS[1].layout.encode({"Statusword": state, "Position": 1000, "Torque": torque})


def test_a_drive_runs_without_canopen() -> None:
    settings = settings_for("cia402")
    profile = Profile(settings)
    slave = Slave(profile)
    mapping = [access for pdo in PDOS for access in profile.mapping(pdo)]
    for access in (profile.identity(), profile.abort(), *mapping, *profile.setup()):
        if access.value is None:
            assert access.accepts(slave.sdo_read(*access.key))
        else:
            slave.sdo_write(*access.key, access.data)
    assert slave.objects[0x6060, 0] == b"\x0a"
    entries = [slave.objects[PDOS[0].mapping, sub].hex() for sub in (0, 1, 2)]
    assert entries == ["02", "10004060", "10007160"]  # 6040h and 6071h, 16 bits each
    for _, word, state in ENABLING:
        answer = PDOS[1].layout.decode(slave.exchange(profile.outputs(word, 0.0)))
        assert profile.shows(int(answer["Statusword"]), state)
    command = profile.outputs(Controlword.ENABLE, settings.scaling.drive_torque(1.5))
    update = profile.inputs(PDOS[1].layout.decode(slave.exchange(command)))
    assert update.mode is Mode.ENABLED
    assert update.channels["tau_m"] == pytest.approx(1.5, rel=0.01)
    assert settings.scaling.torque(profile.commanded(command)) == pytest.approx(1.5, rel=0.01)
    assert profile.commanded(profile.outputs(Controlword.SHUTDOWN, 1.0)) == 0.0


def test_what_is_not_as_configured_is_refused() -> None:
    profile = Profile(settings_for("cia402"))
    slave = Slave(profile)
    slave.objects[0x6076, 0] = bytes(4)
    wrong = next(access for access in profile.setup() if access.key == (0x6076, 0))
    with pytest.raises(ProtocolError, match="Rated torque of drive .* must be"):
        wrong.accepts(slave.sdo_read(*wrong.key))
    with pytest.raises(ProtocolError, match="profile 402"):
        profile.identity().accepts(bytes(4))
    with pytest.raises(ProtocolError, match="it has a fault"):
        profile.shows(State.FAULT, State.ENABLED)
