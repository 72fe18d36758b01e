"""The lock of a node goes by the bus, not by its spelling, and harms no file."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cjt_gym.canbus import lock
from cjt_gym.canbus.lock import NodeLock, bus_identity, machine_of
from cjt_gym.canbus.settings import BusSettings
from cjt_gym.errors import HardwareError


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(lock, "FOLDER", tmp_path)
    return tmp_path


@pytest.mark.parametrize("other", ["localhost", "LOCALHOST", "127.0.1.1", "0.0.0.0"])
def test_one_server_by_every_name(other: str) -> None:
    one = BusSettings("socketcand", "can0", host="127.0.0.1", port=29536)
    assert bus_identity(BusSettings("socketcand", "can0", other, 29536)) == bus_identity(one)
    hidden = BusSettings("socketcand", "can0", options={"host": other, "port": 29536})
    assert bus_identity(hidden) == bus_identity(one)
    for else_ in (
        BusSettings("socketcand", "can1", other, 29536),
        BusSettings("socketcand", "can0", other, 29537),
        BusSettings("socketcand", "can0", "192.0.2.1", 29536),
    ):
        assert bus_identity(else_) != bus_identity(one)


def test_a_name_that_nobody_knows_is_taken_as_it_is() -> None:
    assert machine_of("No-Such-Machine.invalid") == "no-such-machine.invalid"


def test_one_adapter_by_every_path(tmp_path: Path) -> None:
    device = tmp_path / "ttyACM0"
    device.touch()
    link = tmp_path / "by-id"
    link.symlink_to(device)
    names = {bus_identity(BusSettings("slcan", f"{path}")) for path in (device, link)}
    names.add(bus_identity(BusSettings("slcan", f"{link}@115200")))
    assert len(names) == 1


def test_another_temporary_folder_is_no_way_around_it(tmp_path: Path) -> None:
    held = NodeLock("bus-of-test-lock", 9)
    code = "from cjt_gym.canbus.lock import NodeLock; NodeLock('bus-of-test-lock', 9)"
    environment = {**os.environ, "TMPDIR": str(tmp_path), "TEMP": str(tmp_path)}
    run = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    held.release()
    assert "commanded by another process" in run.stderr
    NodeLock("bus-of-test-lock", 9).release()


@pytest.mark.parametrize("kind", ["symlink", "dangling", "hard link", "content", "folder", "pipe"])
def test_what_is_no_lock_is_left_as_it_is(kind: str, folder: Path) -> None:
    place, other = folder / "cjt-gym-bus-1.lock", folder / "precious.txt"
    other.write_text("123")
    if kind == "symlink":
        place.symlink_to(other)
    elif kind == "dangling":
        place.symlink_to(folder / "nothing")
    elif kind == "hard link":
        place.hardlink_to(other)
    elif kind == "content":
        place.write_text("dear diary")
    elif kind == "folder":
        place.mkdir()
    else:
        os.mkfifo(place)
    before = sorted((path.name, path.lstat().st_size) for path in folder.iterdir())
    with pytest.raises(HardwareError, match="must be the lock of a node"):
        NodeLock("bus", 1)
    assert sorted((path.name, path.lstat().st_size) for path in folder.iterdir()) == before
    assert other.read_text() == "123"


def test_lock_that_only_can_be_read_locks_as_well(folder: Path) -> None:
    NodeLock("bus", 1).release()
    path = folder / "cjt-gym-bus-1.lock"
    path.chmod(0o444)
    held = NodeLock("bus", 1)
    with pytest.raises(HardwareError, match="commanded by another process"):
        NodeLock("bus", 1)
    held.release()
    assert path.stat().st_size == lock.WIDTH
