"""The same run over every bus and protocol, against an emulator that serves in real time.

Machines stall; so the allowances for time are wide here, and no time is asserted.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.emulated_arm import serve
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.ports import Port, SocketcandPort, open_port
from cjt_gym.canbus.safety import State
from cjt_gym.canbus.settings import BusSettings
from cjt_gym.errors import ConfigurationError, HardwareError
from cjt_gym.records import read_record
from tests.canbus.bench import DRIVES, config
from tests.canbus.pump import PumpLink, client_of

SECOND = {"value": 1.0, "unit": "s"}
PATIENT = {"rate_hz": 100, "missed": 100, "overrun": SECOND, "watchdog": SECOND}
SOFT = {"soft": {"value": 0.05, "unit": "s"}}
BUSES = ("virtual", *(("slcan",) if find_spec("pty") else ()), "socketcand")


@contextmanager
def served(given: HardwareConfig, port: Port) -> Iterator[Emulator]:
    """Serve an emulator in a thread."""
    emulator, stopped = Emulator(given), threading.Event()
    emulator.advance(0.01)
    thread = threading.Thread(target=serve, args=(emulator, port, 1.0, stopped.is_set))
    thread.start()
    try:
        yield emulator
    finally:
        stopped.set()
        thread.join()
        port.close()


def bus_of(interface: str) -> tuple[BusSettings, Port]:
    """Return where a client finds the bus, and the emulator's end of it."""
    if interface == "slcan":
        from cjt_gym.canbus.ports.slcan import SlcanPort

        adapter = SlcanPort()
        return BusSettings("slcan", adapter.path), adapter
    if interface == "socketcand":
        server = SocketcandPort(port=0)
        return BusSettings("socketcand", "can0", port=server.port), server
    settings = BusSettings("virtual", "bench-of-buses")
    return settings, open_port(settings)


def unhurried(drive: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a drive that reports every 10 ms: a serial line has not the width for more."""
    if "cycle_ms" in drive:
        return drive | {"cycle_ms": 10}
    if drive.get("file") != "example_drive":
        return drive
    data = resources.files("cjt_gym.canbus.protocols") / "data"
    for name in ("example_drive.dbc", "example_drive.map.toml"):
        text = (data / name).read_text()
        slow = re.sub(r'("GenMsgCycleTime" BO_ \d+) 1;', r"\1 10;", text)
        (folder / name).write_text(slow)
    return drive | {"file": str(folder / "example_drive.map.toml")}


@pytest.mark.parametrize("protocol", DRIVES)
@pytest.mark.parametrize("interface", BUSES)
def test_every_frame_goes_through(interface: str, protocol: str) -> None:
    settings, port = bus_of(interface)
    given = replace(config(drive=DRIVES[protocol], control=SOFT), bus=settings)
    emulator = Emulator(given)
    link = PumpLink(emulator, port, client_of(settings, port))
    try:
        with CanPlant(given, link) as plant:
            plant.connect()
            plant.arm()
            plant.reset()
            for _ in range(60):
                last = plant.step(np.array([20.0]))
            assert emulator.torque == pytest.approx(20.0, abs=0.1)
            assert last.tau[0] == pytest.approx(20.0, abs=5.0)
        assert emulator.torque == 0.0
    finally:
        link.close()
        port.close()


@pytest.mark.slow  # in real time: a machine that stalls for seconds fails it
@pytest.mark.parametrize("protocol", DRIVES)
@pytest.mark.parametrize("interface", BUSES)
def test_run_over_a_bus(interface: str, protocol: str, tmp_path: Path) -> None:
    settings, port = bus_of(interface)
    drive = unhurried(DRIVES[protocol], tmp_path)
    given = replace(config(drive=drive, control=PATIENT | SOFT), bus=settings)
    path = tmp_path / "run.csv"
    with served(given, port) as emulator, CanPlant(given, record=path) as plant:
        plant.connect()
        assert plant.state is State.IDLE
        with pytest.raises(HardwareError, match="must be armed"):
            plant.reset()
        plant.arm()
        first = plant.reset()
        assert emulator.torque == 0.0
        k_b = given.joint.parameters.k_b
        for steps in range(1, 500):  # as long as a busy machine needs
            last = plant.step(np.array([20.0]))
            near = abs(last.tau[0] - 20.0) < 2.0 + 2.0 * k_b * 2e-4
            if steps >= 20 and near and abs(emulator.torque - 20.0) < 0.1:
                break
        assert near
        assert emulator.torque == pytest.approx(20.0, abs=0.1)
        plant.stop()
        assert plant.state is State.ARMED
        assert abs(first.tau[0]) < 2.0 + k_b * 4e-4
    assert emulator.torque == 0.0
    record = read_record(path)
    assert len(record) == steps + 5  # that fade
    assert record["tau_cmd"].max() == 20.0
    assert record["tau_cmd"][-1] == 0.0
    assert record.provenance["timing_us"]["ages"]["p50"] > 0.0


def test_second_master_is_refused(tmp_path: Path) -> None:
    settings, port = bus_of("virtual")
    given = replace(config(control=PATIENT | SOFT), bus=settings)
    with served(given, port), CanPlant(given) as plant:
        plant.connect()
        with pytest.raises(HardwareError, match="commanded by another process"):
            CanPlant(given).connect()


def test_socketcand_serves_several_clients_that_see_each_other() -> None:
    port = SocketcandPort(port=0)
    stopped, heard = threading.Event(), []

    def listen() -> None:
        while not stopped.is_set():
            heard.extend(port.receive(0.01))

    thread = threading.Thread(target=listen)
    thread.start()
    try:
        options = {"interface": "socketcand", "host": "127.0.0.1", "port": port.port}
        with (
            can.Bus(channel="can0", **options) as one,
            can.Bus(channel="can0", **options) as two,
        ):
            import time

            time.sleep(0.1)
            one.send(can.Message(arbitration_id=0x123, data=b"\x01\xff", is_extended_id=False))
            found = two.recv(2.0)
            assert found is not None
            assert (found.arbitration_id, bytes(found.data)) == (0x123, b"\x01\xff")
            assert not found.is_extended_id
            two.send(can.Message(arbitration_id=0x18FF0001, data=b"", is_extended_id=True))
            back = one.recv(2.0)
            assert back is not None
            assert (back.arbitration_id, back.dlc, back.is_extended_id) == (0x18FF0001, 0, True)
    finally:
        stopped.set()
        thread.join()
        port.close()
    assert [message.arbitration_id for message in heard] == [0x123, 0x18FF0001]


def test_nobody_there_is_one_clear_error() -> None:
    port = SocketcandPort(port=0)
    number = port.port
    port.close()
    given = replace(config(), bus=BusSettings("socketcand", "can0", port=number))
    with pytest.raises(ConfigurationError, match="No socketcand server"):
        CanPlant(given).connect()


def test_no_pseudo_terminals_are_said_to_be_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pty", None)  # as on Windows
    monkeypatch.delitem(sys.modules, "cjt_gym.canbus.ports.slcan", raising=False)
    with pytest.raises(ConfigurationError, match="pseudo-terminals, which this system"):
        open_port(BusSettings("slcan", "pty"))
