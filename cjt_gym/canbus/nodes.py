"""The nodes of a joint as the master sees them: latest values, their ages, excess reports."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import can

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.link import Arrival
from cjt_gym.canbus.protocols import protocol_of
from cjt_gym.canbus.protocols.contract import SLOW, Master, Mode
from cjt_gym.canbus.safety import REMEDY, Fault
from cjt_gym.canbus.settings import NodeSettings
from cjt_gym.errors import ProtocolError

SPARE = 2.0
"""Answers that a node which is asked may owe, besides those that may be missing."""


@dataclass
class _Account:
    """Frames of one identifier that may still come, and the time of the latest [s]."""

    credit: float
    t: float


@dataclass
class Latest:
    """The latest value of a channel."""

    period: float  # time between two reports [s]
    oldest: float  # age above which it counts as missing [s]
    node: str  # name of the node that reports it
    label: str  # its name in the fault when it is missing
    value: float = math.nan  # in the channel's unit
    t: float = -math.inf  # arrival time of its frame [s]


@final
class Node:
    """One node: its master, its latest mode and error, and a count of its frames."""

    def __init__(self, settings: NodeSettings, owed: int, overrun: float) -> None:
        """Start without a report."""
        self.name, self.address = settings.name, settings.settings.node
        self.master: Master = protocol_of(settings.protocol).master(settings.settings)
        self.is_unwatched = settings.settings.unwatched
        self.mode: Mode | None = None
        self.error, self.text = 0, ""
        # what a DBC file describes comes in its own cycles, though its drive is polled to be off
        self.is_asked = bool(self.master.poll()) and settings.protocol != "dbc"
        self._owed, self._overrun = SPARE + owed, overrun
        self._accounts: dict[int, _Account] = {}

    def asked(self) -> None:
        """Note that the node was polled, and may answer with one more frame of each kind."""
        if self.is_asked:
            for account in self._accounts.values():
                account.credit = min(account.credit + 1.0, self._owed)

    def is_excess(self, arrival: Arrival, period: float, oldest: float) -> bool:
        """Return whether a frame comes more often than it should.

        A polled node may answer once per poll, plus all outstanding answers when it is first heard.
        One that reports by itself may send a frame per period, plus a burst of those that were held
        up.
        """
        t, message = arrival
        most = self._owed if self.is_asked else (oldest + self._overrun) / period + 1.0
        account = self._accounts.setdefault(message.arbitration_id, _Account(most, t))
        if not self.is_asked:
            account.credit = min(account.credit + (t - account.t) / period, most)
        account.t = t
        account.credit -= 1.0
        return account.credit < -0.5

    def forgive(self) -> None:
        """Reset the count of frames."""
        self._accounts.clear()


@final
class Nodes:
    """All nodes of a joint.

    Attributes:
        dt: Control step [s].
        missed: Number of consecutive reports that may be missing.
        all: The drive, then the sensors.
        latest: Latest value of every channel, from the first node that reports it.
    """

    def __init__(self, config: HardwareConfig) -> None:
        self.dt, self.missed = config.dt, config.missed
        # what may be missing, and answers to the commands by which a late loop catches up
        owed = config.missed + math.ceil(config.overrun / config.dt)
        self.all = [Node(settings, owed, config.overrun) for settings in config.nodes]
        self.latest: dict[str, Latest] = {}
        for node in self.all:
            for name in sorted(node.master.channels):
                period = max(node.master.periods.get(name, config.dt), 1e-6)
                oldest = max(self.oldest(period), SLOW.get(name, 0.0))
                label = f"{name} of {node.name}"
                self.latest.setdefault(name, Latest(period, oldest, node.name, label))

    def claims(self, message: can.Message) -> bool:
        """Return whether a frame is from one of these nodes, valid or not."""
        try:
            return any(node.master.decode(message) is not None for node in self.all)
        except ProtocolError:
            return True

    @property
    def drive(self) -> Node:
        """The node that moves the joint."""
        return self.all[0]

    def hear(self, arrivals: Sequence[Arrival]) -> Fault | None:
        """Take frames, and return the first fault found in them."""
        found: Fault | None = None
        for arrival in arrivals:
            found = self._hear_one(arrival) or found
        return found

    def _hear_one(self, arrival: Arrival) -> Fault | None:
        t, message = arrival
        if message.is_error_frame:
            return Fault("bus_off", "The bus reports an error frame.", t)
        for node in self.all:
            try:
                update = node.master.decode(message)
            except ProtocolError as error:
                return Fault("corrupt", f"{node.name}: {error}", t)
            if update is None:
                continue
            node.mode = update.mode or node.mode
            if update.error is not None:
                node.error, node.text = update.error, update.text
            return self._note(node, arrival, update.channels) if update.channels else None
        return None

    def _note(self, node: Node, arrival: Arrival, channels: Mapping[str, float]) -> Fault | None:
        period = math.inf
        for name, value in channels.items():
            latest = self.latest.get(name)
            if latest is not None:
                period = latest.period if latest.period < period else period
                if latest.node == node.name:
                    latest.value, latest.t = value, arrival.t
        if node.is_excess(arrival, period, self.oldest(period)):
            often, remedy = f"every {period * 1e3:.3g} ms", "set cycle_ms to the node's own cycle"
            if node.is_asked:
                often, remedy = "per poll", "stop other programs that poll it"
            text = f"Frames {arrival.message.arbitration_id:#x} of {node.name} must come once "
            text += f"{often}, got more. Give each node an address of its own, or {remedy}."
            return Fault("repeated", text, arrival.t)
        return None

    def oldest(self, period: float) -> float:
        """Return the age above which a report with that period counts as missing [s]."""
        return (1.0 + self.missed) * period + 0.5 * self.dt

    def missing(self, now: float) -> list[Latest]:
        """Return the channels whose latest value is too old at a time [s]."""
        return [each for each in self.latest.values() if now - each.t > each.oldest]

    def values(self) -> dict[str, float]:
        """Return the latest value of every channel."""
        return {name: latest.value for name, latest in self.latest.items()}

    def trouble(self, is_on: bool, now: float) -> Fault | None:
        """Return the drive's error, that it is off while it should be on, or a late report.

        Args:
            is_on: Whether the drive should be on.
            now: The time [s].
        """
        for node in self.all:
            if node.mode is Mode.FAULT or node.error:
                return Fault("drive", f"{node.name} reports {node.text or 'a fault'}.")
        if is_on and self.drive.mode in (Mode.DISABLED, Mode.BOOTING):
            return Fault("drive", f"The drive is {self.drive.mode.value}, no longer enabled.")
        for late in self.missing(now):
            return Fault(
                "missing",
                f"The latest report of {late.label} must be younger than {late.oldest * 1e3:.3g} "
                f"ms, got {(now - late.t) * 1e3:.3g} ms. {REMEDY} missed.",
            )
        return None

    def poll(self) -> list[can.Message]:
        """Return the frames that poll all nodes."""
        return [frame for node in self.all for frame in self._asking(node)]

    def command(self, tau_m: float) -> list[can.Message]:
        """Return the frames that command a motor torque [N m] and poll the sensors."""
        frames = list(self.drive.master.command(tau_m))
        self.drive.asked()
        for node in self.all[1:]:
            frames += self._asking(node)
        return frames

    def _asking(self, node: Node) -> Sequence[can.Message]:
        frames = node.master.poll()
        if frames:
            node.asked()
        return frames
