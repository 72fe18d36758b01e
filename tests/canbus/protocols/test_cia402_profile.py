"""CiA 402 without CANopen: a drive on another bus is told the same, here by CoE's two calls."""

from __future__ import annotations

import pytest

from cjt_gym.canbus.protocols.cia402_objects import OBJECTS, PDOS, State
from cjt_gym.canbus.protocols.cia402_profile import ENABLING, Access, Controlword, Profile
from cjt_gym.canbus.protocols.contract import Mode, Settings
from cjt_gym.errors import ProtocolError
from tests.canbus.protocols.line import settings_for

SHOWN = {
    Controlword.DISABLE_VOLTAGE: State.SWITCH_ON_DISABLED,
    Controlword.SHUTDOWN: State.READY,
    Controlword.SWITCH_ON: State.SWITCHED_ON,
    Controlword.ENABLE: State.ENABLED,
}


class Slave:
    """A drive with the names of pysoem's slave: SDOs on a dictionary, process data as bytes."""

    def __init__(self, profile: Profile) -> None:
        self.objects = {key: bytes(row.field.bits // 8) for key, row in OBJECTS.items()}
        self.objects[0x1000, 0] = (0x00020192).to_bytes(4, "little")
        self.objects[0x608F, 1] = profile.increments.to_bytes(4, "little")
        self.objects[0x6076, 0] = round(profile.rated_torque * 1e3).to_bytes(4, "little")
        self.objects[0x6075, 0] = round(profile.rated_current * 1e3).to_bytes(4, "little")

    def sdo_write(self, index: int, subindex: int, data: bytes) -> None:
        assert len(data) == OBJECTS[index, subindex].field.bits // 8
        self.objects[index, subindex] = data

    def sdo_read(self, index: int, subindex: int) -> bytes:
        return self.objects[index, subindex]

    def exchange(self) -> None:
        """Take the output and set the input, as a cycle of the bus does."""
        sent = PDOS[0].layout.decode(self.output)
        state = SHOWN[int(sent["Controlword"])]
        torque = sent["Target torque"] if state == State.ENABLED else 0.0
        first = {"Statusword": state, "Position": 1000, "Torque": torque}
        values = (first, {"Velocity": 0, "Current": 0, "Error code": 0}, {"DC link voltage": 48e3})
        pairs = zip(PDOS[1:], values, strict=True)
        self.input = b"".join(pdo.layout.encode(row) for pdo, row in pairs)


class Coe:
    """What carries the profile on EtherCAT: all of it that is not the profile's own."""

    def __init__(self, slave: Slave, settings: Settings) -> None:
        self.slave, self.profile, self.scaling = slave, Profile(settings), settings.scaling

    def access(self, one: Access) -> None:
        if one.value is None:
            assert one.accepts(self.slave.sdo_read(*one.key))
        else:
            self.slave.sdo_write(*one.key, one.data)

    def configure(self) -> None:
        maps = [access for pdo in PDOS for access in self.profile.mapping(pdo)]
        for one in (self.profile.identity(), self.profile.abort(), *maps, *self.profile.setup()):
            self.access(one)

    def cycle(self, word: int, tau_m: float = 0.0) -> dict[str, float]:
        self.slave.output = self.profile.outputs(word, self.scaling.drive_torque(tau_m))
        self.slave.exchange()
        values, rest = {}, self.slave.input
        for pdo in PDOS[1:]:
            values |= pdo.layout.decode(rest)
            rest = rest[pdo.layout.size :]
        return values


def test_a_drive_is_armed_run_and_disarmed_over_ethercat() -> None:
    settings = settings_for("cia402")
    slave = Slave(Profile(settings))
    coe = Coe(slave, settings)
    coe.configure()
    assert slave.objects[0x6060, 0] == b"\x0a"
    entries = [slave.objects[PDOS[0].mapping, sub].hex() for sub in (0, 1, 2)]
    assert entries == ["02", "10004060", "10007160"]  # 6040h and 6071h, 16 bits each
    for _, word, state in ENABLING:
        assert coe.profile.shows(int(coe.cycle(word)["Statusword"]), state)
    for torque in (1.5, -2.0):
        update = coe.profile.inputs(coe.cycle(Controlword.ENABLE, torque))
        assert update.mode is Mode.ENABLED
        assert update.channels["tau_m"] == pytest.approx(torque, rel=0.01)
        assert update.channels["v_bus"] == 48.0
        assert settings.scaling.torque(coe.profile.commanded(slave.output)) == pytest.approx(
            torque, rel=0.01
        )
    update = coe.profile.inputs(coe.cycle(Controlword.DISABLE_VOLTAGE, 1.0))
    assert (update.mode, update.channels["tau_m"]) == (Mode.DISABLED, 0.0)
    assert coe.profile.commanded(slave.output) == 0.0


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
