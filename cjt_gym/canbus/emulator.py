"""A drive and its sensors with a simulated joint behind them, on an emulated bus.

Nothing here reads a clock: time is told. So the same emulator serves real clients in real time,
and tests faster than that.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, final

import can
import numpy as np

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.ports.port import Port
from cjt_gym.canbus.protocols import protocol_of
from cjt_gym.canbus.protocols.contract import Firmware
from cjt_gym.canbus.wire import Due, Medium, Wire
from cjt_gym.joint import Joint
from cjt_gym.joint.arrays import CHANNELS, WINDING
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.plant import SimulatedPlant

TICK = 2.5e-4
"""Time between two looks of a drive at its joint [s]; its torque is constant in between."""
SUBSTEPS = 2
WAKE = 1e-3
"""Longest time after which an idle emulator looks at its nodes [s]."""
SLOWEST = 0.02
"""Time that an emulator may fall behind [s]; beyond, its time stands still instead.

A drive never sends a burst of old frames.
"""
AMBIENT = 25.0


def emulated_joint(config: HardwareConfig, effects: Any = None) -> Joint:
    """Return the joint that is emulated: the nominal one with sensors and effects.

    Args:
        config: The joint on its bus; noise and quantization of its sensors are always on where the
            joint file knows them.
        effects: What it has instead of the effects of the configuration.
    """
    nominal, wanted = config.joint, config.effects if effects is None else effects
    listed = wanted if isinstance(wanted, Mapping) else dict.fromkeys(wanted or ())
    given: dict[str, Any] = dict(listed)
    for effect, key in (("noise", "noise"), ("quantization", "resolution")):
        if any(key in known for known in nominal.file.sensors.values()):
            given.setdefault(effect, {})
    resolved = resolve_effects(given, nominal.file, nominal.structure_row, nominal.drive)
    joint = replace(nominal, effects=resolved)
    joint.packed()  # raises where effects do not fit the joint
    return joint


def medium_of(config: HardwareConfig) -> Medium | None:
    """Return what the frames of a bus share, None where no bit rate is given."""
    bus = config.bus
    if bus.bitrate is None:
        return None
    return Medium(bus.bitrate, float(bus.options.get("data_bitrate", 0) or bus.bitrate))


@dataclass
class Node:
    """An emulated node.

    Attributes:
        name: Its name in the configuration.
        firmware: What it does.
        alive: Whether it takes and sends frames; a dead one is silent.
    """

    name: str
    firmware: Firmware
    alive: bool = True


@final
class Emulator:
    """Nodes, the joint that they move and measure, and the bus that they share.

    Attributes:
        joint: The joint, with all its effects.
        plant: Its simulation.
        nodes: The drive, then the sensors.
        now: Time that it has been advanced to [s].
        torque: Motor torque that acts [N m].
        torque_changed: Called with the time and the torque whenever it changes, or None.
        tamper: Function of a frame from a node, its name and the time, that returns what the bus
            makes of it; None for an honest bus.
        medium: What its frames share, where the bus has a bit rate.
    """

    def __init__(self, config: HardwareConfig, joint: Joint | None = None) -> None:
        """Boot the nodes at time zero, the joint at rest.

        Args:
            config: The joint on its bus.
            joint: What is emulated; by default `emulated_joint(config)`.
        """
        settings = config.emulator
        self.joint = emulated_joint(config) if joint is None else joint
        self.plant = SimulatedPlant(self.joint, 1, TICK, TICK / SUBSTEPS)
        self.plant.reset(seed=settings.seed)
        self.nodes = [
            Node(node.name, protocol_of(node.protocol).firmware(node.settings))
            for node in config.nodes
        ]
        self.now = 0.0
        self.torque = 0.0
        self.torque_changed: Callable[[float, float], None] | None = None
        self.tamper: Callable[[can.Message, str, float], Sequence[can.Message]] | None = None
        self.medium = medium_of(config)
        self._in = Wire(settings, settings.seed + 1, self.medium)
        self._out = Wire(settings, settings.seed + 2, self.medium)
        self._ticks = 0
        p = self.joint.parameters
        self._per_ampere = p.k_t * p.n
        self._fixed = {"temperature": p.get("Tmp_ANom", AMBIENT), "v_bus": p.get("v_0", 48.0)}
        self._command, self._load = np.zeros(1), np.zeros(1)
        for node in self.nodes:
            self._answer(node, node.firmware.boot(0.0))
        self._look()

    @property
    def drive(self) -> Firmware:
        """The firmware of the drive."""
        return self.nodes[0].firmware

    def send(self, messages: Sequence[can.Message]) -> None:
        """Put frames of a master on the bus now."""
        for message in messages:
            self._in.put(self.now, message)
        self._deliver(self.now)

    def inject(self, message: can.Message, t: float) -> None:
        """Let a frame set out to the master at a time [s], whoever may have sent it."""
        self._out.put(t, message)

    def receive(self) -> list[Due]:
        """Return the frames for the master that have arrived by now."""
        return self._out.take(self.now)

    def next(self) -> float:
        """Return until when nothing happens by itself that a master could notice [s]."""
        return min(self._out.next(), self._in.next(), (self._ticks + WAKE / TICK) * TICK)

    def advance(self, t: float) -> None:
        """Let time pass until `t` [s]."""
        while (tick := (self._ticks + 1) * TICK) <= t:
            self._deliver(tick)
            self._command[0] = self.torque
            self.plant.advance(self._command, self._load)
            self._ticks += 1
            self.now = tick
            self._look()
        self._deliver(t)
        self.now = max(self.now, t)

    def _deliver(self, t: float) -> None:
        """Hand the frames to the nodes that have arrived by a time [s]."""
        arrived = self._in.take(t)
        for due in arrived:
            self.now = max(self.now, due.t)
            for node in self.nodes:
                if node.alive:
                    self._answer(node, node.firmware.receive(due.message, self.now))
        if arrived:
            self._obey()

    def _obey(self) -> None:
        """Let the drive's torque act."""
        torque = self.drive.torque
        if torque != self.torque and self.torque_changed is not None:
            self.torque_changed(self.now, torque)
        self.torque = torque

    def _look(self) -> None:
        """Show the nodes what the joint does."""
        channels = self.channels()
        for node in self.nodes:
            reports = node.firmware.update(channels, self.now)
            if node.alive:
                self._answer(node, reports)
        self._obey()

    def _answer(self, node: Node, messages: Sequence[can.Message]) -> None:
        for message in messages:
            made = [message]
            if self.tamper is not None:
                made = list(self.tamper(message, node.name, self.now))
            for frame in made:
                self._out.put(self.now, frame)

    def channels(self) -> dict[str, float]:
        """Return what the nodes measure, by the names of the protocols' channels."""
        arrays = self.plant.batch.arrays
        seen = dict(zip(CHANNELS, arrays.measured[0].tolist(), strict=True))
        warmth = self._fixed["temperature"] + float(arrays.memory[0, WINDING])
        return {
            **seen,
            "tau_m": self._per_ampere * seen["i"],
            "temperature": warmth,
            "v_bus": self._fixed["v_bus"],
        }


class Emulated(Protocol):
    """What can be served: an emulator, or several on one bus."""

    @property
    def now(self) -> float: ...

    def send(self, messages: Sequence[can.Message]) -> None: ...
    def receive(self) -> list[Due]: ...
    def next(self) -> float: ...
    def advance(self, t: float) -> None: ...


def serve(
    emulator: Emulated,
    ports: Sequence[Port],
    speed: float,
    stopped: Callable[[], bool],
) -> None:
    """Run an emulator on ports until it is stopped.

    Args:
        emulator: The emulator.
        ports: Where clients are; all are on the same bus. The first one is waited on.
        speed: Time of the joint over that of the clock on the wall.
        stopped: Says whether to stop.
    """
    begin = time.perf_counter() - emulator.now / speed
    while not stopped():
        now = (time.perf_counter() - begin) * speed
        if now - emulator.now > SLOWEST * speed:
            begin += (now - emulator.now) / speed
            now = emulator.now
        emulator.advance(now)
        _hand_out(emulator, ports)
        wait = (emulator.next() - emulator.now) / speed
        for k, port in enumerate(ports):
            messages = port.receive(wait if k == 0 else 0.0)
            if messages:
                emulator.advance((time.perf_counter() - begin) * speed)
                emulator.send(messages)
                _hand_out(emulator, ports)


def _hand_out(emulator: Emulated, ports: Sequence[Port]) -> None:
    for due in emulator.receive():
        due.message.timestamp = time.time()
        for port in ports:
            port.send(due.message)


__all__ = ["TICK", "Emulator", "Node", "emulated_joint", "serve"]
