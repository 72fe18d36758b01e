"""Torque does not outlive the program: a drive shows that it stops by itself, or is not armed."""

from __future__ import annotations

from typing import Any

import can
import numpy as np
import pytest

from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.safety import State
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.errors import ConfigurationError, HardwareError
from tests.canbus.bench import DRIVES, SET_BEFORE, config

FACTORY = {"watchdog": {"value": 0.0, "unit": "s"}}
SLOW = {"watchdog": {"value": 0.05, "unit": "s"}}
every_protocol = pytest.mark.parametrize("protocol", DRIVES)


def watched(protocol: str, **more: Any) -> dict[str, Any]:
    """Return a drive for which nobody accepted that it is unwatched."""
    return {k: v for k, v in DRIVES[protocol].items() if k != "unwatched"} | more


def connected(**changes: dict[str, Any]) -> tuple[CanPlant, Emulator]:
    given = config(**changes)
    emulator = Emulator(given)
    plant = CanPlant(given, VirtualLink(emulator))
    plant.connect()
    return plant, emulator


def torque_after_a_kill(plant: CanPlant, emulator: Emulator) -> float:
    """Return the torque that is left once the watchdog's time is over [N m]."""
    plant.arm()
    plant.reset()
    for _ in range(60):
        plant.step(np.array([5.0]))
    assert emulator.torque != 0.0
    emulator.advance(emulator.now + plant.config.drive.settings.watchdog + 2e-3)
    return emulator.torque


@every_protocol
def test_as_it_leaves_the_factory_a_drive_stops_or_is_not_armed(protocol: str) -> None:
    plant, emulator = connected(drive=watched(protocol), emulator=FACTORY)
    if protocol in SET_BEFORE:
        with pytest.raises(HardwareError, match="unwatched = true"):
            plant.arm()
        assert plant.state is State.IDLE
        assert emulator.torque == 0.0
    else:
        assert torque_after_a_kill(plant, emulator) == 0.0


@pytest.mark.parametrize("reports", ["ask", "cyclic"])
@pytest.mark.parametrize("firmware", ["0.5", "0.6"])
@pytest.mark.parametrize("emulator", [FACTORY, SLOW])
def test_an_odrive_whose_watchdog_cannot_be_set_is_not_armed(
    reports: str, firmware: str, emulator: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cjt_gym.canbus.protocols.odrive.ENDPOINTS", {})
    drive = {"protocol": "odrive", "node": 3, "reports": reports, "firmware": firmware}
    plant, emulated = connected(drive=drive, emulator=emulator)
    with pytest.raises(HardwareError, match=r"must stop by itself within 0\.0035 s"):
        plant.arm()
    assert plant.state is State.IDLE
    assert emulated.drive.mode.value == "disabled"


@pytest.mark.parametrize("reports", ["ask", "cyclic"])
def test_an_odrive_whose_watchdog_was_set_before_proves_it(
    reports: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cjt_gym.canbus.protocols.odrive.ENDPOINTS", {})
    drive = {"protocol": "odrive", "node": 3, "reports": reports}
    before = {"watchdog": {"value": 0.0035, "unit": "s"}}
    assert torque_after_a_kill(*connected(drive=drive, emulator=before)) == 0.0


def test_a_dbc_drive_proves_it_where_its_mapping_shows_its_state() -> None:
    assert torque_after_a_kill(*connected(drive=DRIVES["dbc"])) == 0.0


@every_protocol
def test_an_unwatched_drive_is_armed_as_it_is(protocol: str) -> None:
    plant, emulator = connected(drive=watched(protocol, unwatched=True), emulator=FACTORY)
    plant.arm()
    assert plant.state is State.ARMED
    assert emulator.torque == 0.0


def test_unwatched_is_said_in_so_many_words() -> None:
    with pytest.raises(ConfigurationError, match="unwatched of .* must be true or false"):
        config(drive=watched("mit", unwatched="yes"))


@every_protocol
def test_no_torque_is_commanded_while_it_is_proven(protocol: str) -> None:
    given = config(drive=DRIVES[protocol])
    link = VirtualLink(Emulator(given))
    plant = CanPlant(given, link)
    master, commanded = plant.joint.nodes.drive.master, []

    def note(t: float, message: can.Message) -> None:
        torque = master.commanded(message)
        commanded.append(torque or 0.0)

    link.sent = note
    plant.connect()
    plant.arm()
    assert commanded
    assert np.abs(commanded).max() < 0.02 * master.torque_range[1]


def test_an_interrupt_while_it_is_proven_leaves_the_drive_off() -> None:
    given = config()
    link = VirtualLink(Emulator(given))
    plant = CanPlant(given, link)
    plant.connect()

    def interrupt(now: float) -> None:
        if link.emulator.drive.mode.value == "enabled":
            raise KeyboardInterrupt

    link.watch(interrupt, 1e-3)
    with pytest.raises(KeyboardInterrupt):
        plant.arm()
    link.watch(lambda now: None, 1e-3)
    link.emulator.advance(link.emulator.now + 1e-3)
    assert link.emulator.drive.mode.value == "disabled"
