"""Bits on the wire, and the rate that a bus carries, against an emulated bus of that bit rate."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from can.util import CAN_FD_DLC
from hypothesis import given
from hypothesis import strategies as st

from cjt_gym.canbus.bus_load import bus_load
from cjt_gym.canbus.config import load_hardware, parse_hardware, parse_joints
from cjt_gym.canbus.dialogue import Dialogue
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.frame_bits import _bits, bits_of, crc, stuffed, wire_time
from cjt_gym.canbus.nodes import Nodes
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.cli import main
from cjt_gym.disk import to_toml
from cjt_gym.errors import ConfigurationError, UnknownNameError
from tests.canbus.bench import DRIVES, document, sharp

BITRATE = 250_000


@given(st.lists(st.integers(0, 1), min_size=1, max_size=120))
def test_crc_of_a_frame_with_its_crc_is_zero(bits: list[int]) -> None:
    assert crc([*bits, *_bits(crc(bits), 15)]) == 0


@given(st.lists(st.integers(0, 1), max_size=80))
def test_stuffed_bits_are_those_that_a_receiver_takes_out(bits: list[int]) -> None:
    wire: list[int] = []
    for bit in bits:
        wire.append(bit)
        if len(wire) >= 5 and len(set(wire[-5:])) == 1:
            wire.append(1 - bit)
    assert stuffed(bits) == len(wire) - len(bits)
    assert all(len(set(wire[k : k + 6])) == 2 for k in range(len(wire) - 5))


@pytest.mark.parametrize(
    ("extended", "size", "plain"), [(False, 0, 47), (False, 8, 111), (True, 0, 67), (True, 8, 131)]
)
def test_classical_frames_have_their_length(extended: bool, size: int, plain: int) -> None:
    least = can.Message(
        arbitration_id=0x155, is_extended_id=extended, data=bytes([0b01011010] * size)
    )
    most = can.Message(arbitration_id=0, is_extended_id=extended, data=bytes(size))
    for message in (least, most):
        bits = bits_of(message)
        assert bits.fast == 0
        assert plain <= bits.nominal <= plain + (plain - 13 - 1) // 4
    assert bits_of(most).nominal > bits_of(least).nominal
    assert wire_time(least, 1e6, 5e6) == pytest.approx(bits_of(least).nominal * 1e-6)


@pytest.mark.parametrize("size", [8, 16, 20, 64])
def test_fd_frames_send_their_data_fast(size: int) -> None:
    facts: dict[str, Any] = {"arbitration_id": 0x155, "is_extended_id": False, "is_fd": True}
    data = bytes([0b01011010] * size)
    slow = bits_of(can.Message(**facts, data=data))
    fast = bits_of(can.Message(**facts, data=data, bitrate_switch=True))
    check = 17 + 4 + 6 if size <= 16 else 21 + 4 + 7
    assert slow.fast == 0
    assert fast.nominal + fast.fast == pytest.approx(slow.nominal, abs=2)  # BRS is another bit
    assert fast.fast >= 1 + 4 + 8 * size + check + 1
    assert fast.nominal >= 1 + 11 + 1 + 1 + 3 + 12
    assert size in CAN_FD_DLC


def joints(*protocols: str, **changes: Any) -> dict[str, Any]:
    """Return a document that lists a joint for each of these protocols."""
    tables = document(**changes)
    tables["control"] = sharp(**tables["control"])
    tables["emulator"] = {"watchdog": {"value": 0.0035, "unit": "s"}}
    shared = {name: tables[name] for name in ("bus", "control", "emulator")}
    own = [
        {"name": f"joint_{k}", "drive": {**DRIVES[p], "node": k + 1}, "joint": tables["joint"]}
        for k, p in enumerate(protocols)
    ]
    return {**shared, "joints": own}


def is_carried(drive: dict[str, Any], rate: float) -> bool:
    """Whether an emulated bus keeps up with a loop."""
    bus = {"bitrate": BITRATE, "options": {"data_bitrate": BITRATE}}
    config = parse_hardware(
        document(drive=drive, bus=bus, control=sharp(rate_hz=rate)), "x", Path()
    )
    emulator = Emulator(config)
    link, nodes = VirtualLink(emulator), Nodes(config)
    talk, master = Dialogue(link, nodes), nodes.drive.master
    talk.perform(nodes.drive, [*master.configure(), *master.clear(), *master.enable()])
    begin = link.now()
    for k in range(round(0.5 * rate)):
        link.send(nodes.command(5.0 * np.sin(20.0 * k / rate)))
        link.wait_until(begin + (k + 1) / rate)
        link.receive()
    assert emulator.medium is not None
    return emulator.medium.free - link.now() < 3.0 / rate


@pytest.mark.parametrize("protocol", ["mit", "moteus", "cia402", "odrive"])
def test_predicted_rate_is_that_of_the_emulated_bus(protocol: str) -> None:
    drive = {k: v for k, v in DRIVES[protocol].items() if k not in ("reports", "cycle_ms")}
    config = parse_hardware(document(drive=drive, control={"rate_hz": 100}), "x", Path())
    most = bus_load([config], BITRATE, BITRATE).most_hz
    assert is_carried(drive, 0.95 * most)
    assert not is_carried(drive, 1.05 * most)


def test_joints_that_find_no_room_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(listed(joints(*["mit"] * 7, bus={"bitrate": 500_000})))
    assert main(["bus", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [joint["node"] for joint in told["joints"]] == [1, 2, 3, 4, 5, 6, 7]
    shares = [joint["share"] for joint in told["joints"]]
    assert told["share"] == pytest.approx(sum(shares))
    room = int(1.0 / max(shares))
    assert told["saturating"] == [f"joint_{k}" for k in range(room, 7)]
    assert told["most_hz"] == pytest.approx(500.0 / told["share"], rel=0.02)
    assert main(["bus", str(path), "--bitrate", "8e6"]) == 0
    shown = capsys.readouterr().out
    assert "do not fit" not in shown
    assert "joint_6" in shown
    assert main(["bus", str(path), "--bitrate", "3"]) == 2


def listed(tables: dict[str, Any]) -> str:
    """Return tables and a list of joints as TOML."""
    lines = [to_toml({name: table for name, table in tables.items() if name != "joints"})]
    for own in tables["joints"]:
        lines.append(f'[[joints]]\nname = "{own["name"]}"')
        text = to_toml({name: table for name, table in own.items() if name != "name"})
        lines.append(text.replace("\n[", "\n[joints.").replace("[drive]", "[joints.drive]", 1))
    return "\n".join(lines)


def test_one_joint_of_a_list_runs_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(listed(joints("moteus", "cia402")))
    assert load_hardware(path, "joint_1").drive.protocol == "cia402"
    with pytest.raises(ConfigurationError, match="joint_0, joint_1, .* --joint NAME"):
        load_hardware(path)
    with pytest.raises(UnknownNameError, match="Did you mean 'joint_1'"):
        load_hardware(path, "joint1")
    words = ["hardware", str(path), "--joint", "joint_1", "--dry-run", "--duration", "0.02"]
    assert main(words) == 0
    assert "frames would be sent" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"joints": []}, r"must be tables \[\[joints\]\]"),
        ({"drive": DRIVES["mit"]}, "drive"),
        ({"joints": [{"drive": DRIVES["mit"], "joint": {"file": "orange_80_6000"}}]}, "name"),
        ({"joints": [*joints("mit")["joints"], *joints("mit")["joints"]]}, "differ in name"),
    ],
)
def test_mistakes_in_a_list_are_named(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigurationError, match=text):
        parse_joints({**joints("mit"), **change}, "arm.toml", Path())
