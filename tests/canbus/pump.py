"""A link over a real bus in the time of the emulator: every frame goes through, no clock counts."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

import can

from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.link import Arrival, open_bus
from cjt_gym.canbus.ports import Port
from cjt_gym.canbus.ports.socketcand import QUIET
from cjt_gym.canbus.settings import BusSettings

LONGEST = 20.0
STEP = 1e-3


def client_of(settings: BusSettings, port: Port) -> can.BusABC:
    """Return python-can's bus to a port, which is served until the client is through."""
    made: list[can.BusABC] = []
    thread = threading.Thread(target=lambda: made.append(open_bus(settings)))
    thread.start()
    while thread.is_alive():
        port.receive(0.01)
    time.sleep(1.2 * QUIET)
    port.receive(0.0)
    return made[0]


class PumpLink:
    """Carries frames between a client's bus and an emulator's port, one by one."""

    stamps = "reception"

    def __init__(self, emulator: Emulator, port: Port, bus: can.BusABC) -> None:
        self.emulator, self.port, self.bus = emulator, port, bus
        self._inbox: list[Arrival] = []

    def now(self) -> float:
        return self.emulator.now

    def wait_until(self, t: float) -> None:
        while self.emulator.now < t:
            self.emulator.advance(min(t, self.emulator.now + STEP))
            self._carry()

    def send(self, messages: Sequence[can.Message]) -> None:
        for message in messages:
            self.bus.send(message)
        found: list[can.Message] = []
        while len(found) < len(messages):
            some = self.port.receive(LONGEST)
            assert some, "The port lost a frame."
            found += some
        self.emulator.send(found)
        self._carry()

    def receive(self) -> list[Arrival]:
        found, self._inbox = self._inbox, []
        return found

    def watch(self, supervise: Callable[[float], None], every: float) -> None:
        pass

    def close(self) -> None:
        self.bus.shutdown()

    def _carry(self) -> None:
        for due in self.emulator.receive():
            self.port.send(due.message)
            message = self.bus.recv(LONGEST)
            assert message is not None, "The bus lost a frame."
            self._inbox.append(Arrival(due.t, message))
