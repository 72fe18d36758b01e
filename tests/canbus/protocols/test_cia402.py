"""CiA 402 frames against the standard's octets and against the canopen library as a peer."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import canopen
import pytest
from canopen.profiles.p402 import BaseNode402

from cjt_gym.canbus.protocols import PROTOCOLS
from cjt_gym.canbus.protocols.cia402_firmware import Cia402Firmware
from cjt_gym.canbus.protocols.cia402_objects import OBJECTS, State, object_dictionary, state_of
from cjt_gym.canbus.protocols.contract import Fault, Mode, Step, frame_of
from cjt_gym.errors import ConfigurationError, ProtocolError
from tests.canbus.protocols.line import Line, settings_for, started


def steps() -> dict[str, Step]:
    master = PROTOCOLS["cia402"].master(settings_for("cia402"))
    return {step.text: step for step in master.configure()}


def octets(step: Step) -> tuple[int, str]:
    return step.frames[0].arbitration_id, step.frames[0].data.hex(" ")


def test_octets_of_the_standard() -> None:
    made = steps()
    assert octets(made["Pre-operational"]) == (0x000, "80 03")
    assert octets(made["Look for a drive"]) == (0x603, "40 00 10 00 00 00 00 00")
    assert octets(made["Write Producer heartbeat time"]) == (0x603, "2b 17 10 00 64 00 00 00")
    assert octets(made["Write Mode of operation"]) == (0x603, "2f 60 60 00 0a 00 00 00")
    assert octets(made["Write TPDO 1 object 2"]) == (0x603, "23 00 1a 02 20 00 64 60")
    assert octets(made["Write TPDO 1 identifier"]) == (0x603, "23 00 18 01 83 01 00 00")
    assert octets(made["Start the node"]) == (0x000, "01 03")
    rpdo, sync, *_ = PROTOCOLS["cia402"].master(settings_for("cia402")).command(-2.5)
    assert (rpdo.arbitration_id, rpdo.data.hex(" ")) == (0x203, "0f 00 f4 01")
    assert (sync.arbitration_id, len(sync.data)) == (0x080, 0)


@pytest.mark.parametrize(
    ("word", "state"),
    [
        (0x0000, State.NOT_READY),
        (0x0250, State.SWITCH_ON_DISABLED),
        (0x0231, State.READY),
        (0x0233, State.SWITCHED_ON),
        (0x1237, State.ENABLED),
        (0x0217, State.QUICK_STOP),
        (0x021F, State.FAULT_REACTION),
        (0x0218, State.FAULT),
    ],
)
def test_states_of_the_profile(word: int, state: int) -> None:
    assert state_of(word) == state


def test_configuration_as_canopen_reads_it() -> None:
    line = started("cia402")
    assert isinstance(line.firmware, Cia402Firmware)
    node = line.firmware._node
    node.tpdo.read()
    node.rpdo.read()
    mapped = {pdo.cob_id: [each.index for each in pdo] for pdo in node.tpdo.values()}
    assert mapped == {
        0x183: [0x6041, 0x6064, 0x6077],
        0x283: [0x606C, 0x6078, 0x603F],
        0x383: [0x6079, 0x6061],
    }
    assert [each.index for each in node.rpdo[1]] == [0x6040, 0x6071]
    assert node.sdo[0x1016][1].raw == 127 << 16 | 50


def test_the_dictionary_survives_an_eds_file(tmp_path: Path) -> None:
    path = tmp_path / "drive.eds"
    canopen.export_od(object_dictionary(3), str(path))
    read = canopen.import_od(str(path), node_id=3)
    for row in OBJECTS.values():
        variable = read.get_variable(row.index, row.sub)
        assert variable is not None, row
        assert (len(variable), variable.access_type) == (row.field.bits, row.access)


@contextmanager
def drive_on_a_bus(channel: str) -> Iterator[Cia402Firmware]:
    """Let a drive live on a virtual bus, in a thread."""
    firmware = PROTOCOLS["cia402"].firmware(settings_for("cia402"))
    assert isinstance(firmware, Cia402Firmware)
    stop = threading.Event()
    joint = {"q_m": 0.2, "dq_m": 0.0, "v_bus": 48.0}

    def live(bus: can.BusABC) -> None:
        frames = list(firmware.boot(time.monotonic()))
        while not stop.is_set():
            if frame := bus.recv(1e-3):
                frames += firmware.receive(frame, time.monotonic())
            for each in [*frames, *firmware.update(joint, time.monotonic())]:
                bus.send(each)
            frames = []

    with can.Bus(interface="virtual", channel=channel) as bus:
        thread = threading.Thread(target=live, args=(bus,))
        thread.start()
        try:
            yield firmware
        finally:
            stop.set()
            thread.join()


@contextmanager
def client(channel: str) -> Iterator[Any]:
    network = canopen.Network()
    network.connect(interface="virtual", channel=channel)
    try:
        yield network.add_node(BaseNode402(3, object_dictionary(3)))
    finally:
        network.disconnect()


def test_the_profile_of_canopen_drives_our_drive() -> None:
    with drive_on_a_bus("cia402 peer") as firmware, client("cia402 peer") as node:
        node.nmt.state = "PRE-OPERATIONAL"
        node.sdo["Producer heartbeat time"].raw = 20
        node.nmt.wait_for_heartbeat(timeout=2.0)
        node.tpdo.read()
        node.rpdo.read()
        node.tpdo[1].clear()
        node.tpdo[1].add_variable("Statusword")
        node.tpdo[1].add_variable("Position")
        node.tpdo[1].cob_id, node.tpdo[1].trans_type, node.tpdo[1].event_timer = 0x183, 255, 5
        node.tpdo[1].enabled = True
        node.tpdo[1].save()
        node.rpdo[1].clear()
        node.rpdo[1].add_variable("Controlword")
        node.rpdo[1].add_variable("Target torque")
        node.rpdo[1].cob_id, node.rpdo[1].enabled = 0x203, True
        node.rpdo[1].save()
        node.setup_402_state_machine()
        node.nmt.state = "OPERATIONAL"
        assert node.is_op_mode_supported("CYCLIC SYNCHRONOUS TORQUE")
        node.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
        assert node.sdo[0x6061].raw == 10
        node.state = "OPERATION ENABLED"
        assert firmware.mode is Mode.ENABLED
        node.rpdo[1]["Target torque"].raw = 500
        node.rpdo[1].transmit()
        node.tpdo[1].wait_for_reception(1.0)
        assert firmware.torque == pytest.approx(-0.5 * 0.1 * 50.0)
        turns = (-0.2 * 50.0 + 0.5) / 6.283185307
        assert node.tpdo[1]["Position"].raw == pytest.approx(turns * 65536, abs=1)
        firmware.fail(Fault.OVER_TEMPERATURE)
        assert node.emcy.wait(timeout=1.0).code == 0x4310
        node.tpdo[1].wait_for_reception(1.0)
        assert node.is_faulted()
        node.reset_from_fault()
        assert node.state == "OPERATION ENABLED"


def test_a_drive_with_another_rated_torque_is_refused() -> None:
    line = Line(settings_for("cia402"), "cia402")
    line.firmware.receive(
        frame_of(0x603, bytes.fromhex("23 76 60 00 20 03 00 00")),
        0.0,
    )
    with pytest.raises(ProtocolError, match="Rated torque of drive 3 must be 100 mN m .* has 800"):
        line.run(line.master.configure())


def test_what_the_drive_refuses_is_told_in_words() -> None:
    step = steps()["Write Mode of operation"]
    assert step.confirmed is not None
    abort = frame_of(0x583, bytes.fromhex("80 60 60 00 11 00 09 06"))
    with pytest.raises(ProtocolError, match="Mode of operation: drive 3 refuses it"):
        step.confirmed(abort)


def test_an_emergency_is_a_fault() -> None:
    master = PROTOCOLS["cia402"].master(settings_for("cia402"))
    data = bytes.fromhex("10 23 01 00 00 00 00 00")
    update = master.decode(frame_of(0x083, data))
    assert update is not None
    assert (update.mode, update.error) == (Mode.FAULT, 0x2310)


def test_leaving_operational_ends_the_torque() -> None:
    line = started("cia402")
    line.send(line.master.command(0.5))
    line.send([frame_of(0, bytes([0x02, 3]))])
    assert line.firmware.torque == 0.0
    assert line.firmware.mode is Mode.FAULT


def test_no_torque_in_another_mode_of_operation() -> None:
    line = started("cia402")
    line.send(line.master.command(0.5))
    assert line.firmware.torque == pytest.approx(0.5)
    velocity = bytes.fromhex("2f 60 60 00 09 00 00 00")
    line.send([frame_of(0x603, velocity)])
    assert line.firmware.torque == 0.0


def test_ratings_must_be_positive() -> None:
    with pytest.raises(ConfigurationError, match="rated_torque must be finite and > 0 N m"):
        settings_for("cia402", rated_torque=0.0)
