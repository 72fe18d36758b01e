"""A drive and its sensors with a simulated joint behind them, on an emulated bus.

Time is an argument, never a clock, so the same emulator serves real clients in real time and tests
that run faster.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import can
import numpy as np

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.protocols import protocol_of
from cjt_gym.canbus.protocols.firmware import Firmware
from cjt_gym.canbus.wire import Due, Medium, Wire
from cjt_gym.joint import Joint
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.kernel.arrays import CHANNELS, WINDING
from cjt_gym.plant import SimulatedPlant

TICK = 2.5e-4
"""Time between two looks of a drive at its joint [s]; its torque is constant in between."""
SUBSTEPS = 2
WAKE = 1e-3
"""Longest time after which an idle emulator looks at its nodes [s]."""
AMBIENT = 25.0
"""Temperature where the joint file gives none for its parameters [deg C]: that of a laboratory."""


def emulated_joint(config: HardwareConfig, effects: Any = None) -> Joint:
    """Return the joint to emulate: the nominal one with sensors and effects.

    Args:
        config: Configuration of the joint; sensor noise and quantization are on wherever the joint
            file gives them.
        effects: Effects that replace those of the configuration.
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
    """Return the wire that the frames of a bus share; None without a bit rate."""
    bus = config.bus
    if bus.bitrate is None:
        return None
    return Medium(bus.bitrate, float(bus.options.get("data_bitrate", 0) or bus.bitrate))


@dataclass
class Node:
    """An emulated node."""

    name: str  # its name in the configuration
    firmware: Firmware  # its firmware
    alive: bool = True  # whether it receives and sends frames


@final
class Emulator:
    """Nodes, the joint that they move and measure, and their bus.

    Attributes:
        joint: The joint with all its effects.
        plant: Its simulation.
        nodes: The drive, then the sensors.
        now: Current time of the emulation [s].
        torque: Present motor torque [N m].
        torque_changed: Called with time and torque when the torque changes, or None.
        tamper: Called with every frame of a node, its name and the time; returns the frames that
            arrive instead. None for an honest bus.
        medium: The wire that all frames share, if the bus has a bit rate.
    """

    def __init__(self, config: HardwareConfig, joint: Joint | None = None) -> None:
        """Boot the nodes at time zero, the joint at rest.

        Args:
            config: Configuration of the joint.
            joint: Joint to emulate; `emulated_joint(config)` by default.
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
        self._ambient, self._supply = p.get("Tmp_ANom", AMBIENT), p.get("v_0", 48.0)
        self._command, self._load = np.zeros(1), np.zeros(1)
        for node in self.nodes:
            self._answer(node, node.firmware.boot(0.0))
        self._look()

    @property
    def drive(self) -> Firmware:
        """The firmware of the drive."""
        return self.nodes[0].firmware

    def heeds(self, message: can.Message) -> bool:
        """Return whether a frame may be for one of the nodes."""
        return any(node.firmware.heeds(message) for node in self.nodes)

    def send(self, messages: Sequence[can.Message]) -> None:
        """Put frames of a master on the bus now."""
        for message in messages:
            self._in.put(self.now, message)
        self._deliver(self.now)

    def inject(self, message: can.Message, t: float) -> None:
        """Send a frame to the master at a time [s], from no node in particular."""
        self._out.put(t, message)

    def receive(self) -> list[Due]:
        """Return the frames for the master that have arrived by now."""
        return self._out.take(self.now)

    def next(self) -> float:
        """Return the time of the next event that a master could notice [s]."""
        return min(self._out.next(), self._in.next(), (self._ticks + WAKE / TICK) * TICK)

    def advance(self, t: float) -> None:
        """Advance the time to `t` [s]."""
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
        arrived = self._in.take(t)
        for due in arrived:
            self.now = max(self.now, due.t)
            for node in self.nodes:
                if node.alive:
                    self._answer(node, node.firmware.receive(due.message, self.now))
        if arrived:
            self._obey()

    def _obey(self) -> None:
        torque = self.drive.torque
        if torque != self.torque and self.torque_changed is not None:
            self.torque_changed(self.now, torque)
        self.torque = torque

    def _look(self) -> None:
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
        seen["tau_m"] = self._per_ampere * seen["i"]
        seen["temperature"] = self._ambient + float(arrays.memory[0, WINDING])
        seen["v_bus"] = self._supply
        return seen
