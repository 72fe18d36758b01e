"""Predict the control rate that a bus can carry, from frames exchanged with emulated drives.

Every joint is run with its emulated drive at the configured rate and at half of it, and the time of
its frames on the wire is added up. The two runs separate what depends on the rate, such as
commands, from what does not, such as heartbeats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import can
import numpy as np

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.dialogue import Dialogue
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.frame_bits import bits_of, wire_time
from cjt_gym.canbus.nodes import Nodes
from cjt_gym.canbus.virtual import VirtualLink

BITRATE, DATA_BITRATE = 1e6, 5e6
"""Bit rates that are taken where the configuration gives none [bit/s]."""
TORQUE, FREQUENCY = 0.05, 3.0
"""Share of the largest torque that is commanded meanwhile, and how often it swings [Hz]."""
SECONDS: Final = 0.4
"""For how long the frames are counted [s of the joint]."""


@dataclass(frozen=True)
class JointLoad:
    """Load of one joint on the bus."""

    name: str  # name of the joint, or "drive" if it is the only one
    protocol: str  # protocol of its drive
    node: int  # address of its drive
    frames: float  # frames at the configured rate [1/s]
    bits: float  # bits at the configured rate, stuff bits included [bit/s]
    share: float  # share of the bus's time at the configured rate
    fixed: float  # share of the bus's time at any rate


@dataclass(frozen=True)
class BusLoad:
    """Load of all joints on the bus; rate in Hz, bit rates in bit/s."""

    joints: tuple[JointLoad, ...]
    rate_hz: float
    bitrate: float
    data_bitrate: float

    @property
    def share(self) -> float:
        """Share of the bus's time at the configured rate."""
        return sum(joint.share for joint in self.joints)

    @property
    def most_hz(self) -> float:
        """Rate at which the bus is fully loaded [Hz]; 0 if it is so without commands."""
        fixed = sum(joint.fixed for joint in self.joints)
        per_hz = (self.share - fixed) / self.rate_hz
        return max(0.0, 1.0 - fixed) / per_hz

    @property
    def saturating(self) -> tuple[str, ...]:
        """Names of the joints for which there is no room, in the order of the configuration."""
        filled = np.cumsum([joint.share for joint in self.joints])
        return tuple(j.name for j, at in zip(self.joints, filled, strict=True) if at > 1.0)


def bus_load(
    configs: Sequence[HardwareConfig],
    bitrate: float | None = None,
    data_bitrate: float | None = None,
) -> BusLoad:
    """Return the load of configured joints on their bus.

    Args:
        configs: Configuration of each joint; they share bus and rate.
        bitrate: Nominal bit rate that replaces the configured one [bit/s].
        data_bitrate: The same for CAN FD's data phase [bit/s].
    """
    bus = configs[0].bus
    nominal = float(bitrate or bus.bitrate or BITRATE)
    fast = float(data_bitrate or bus.options.get("data_bitrate", 0) or max(DATA_BITRATE, nominal))
    joints = []
    for config in configs:
        frames, bits, whole = _exchanged(config, nominal, fast)
        *_, half = _exchanged(_slower(config), nominal, fast)
        name = config.name or config.drive.name
        node = config.drive.settings.node
        fixed = max(0.0, 2.0 * half - whole)
        joints.append(JointLoad(name, config.drive.protocol, node, frames, bits, whole, fixed))
    return BusLoad(tuple(joints), 1.0 / configs[0].dt, nominal, fast)


def _slower(config: HardwareConfig) -> HardwareConfig:
    nodes = tuple(
        replace(
            node,
            settings=replace(
                node.settings,
                period=2.0 * node.settings.period,
                watchdog=2.0 * node.settings.watchdog,
                limits=replace(node.settings.limits, watchdog=2.0 * node.settings.limits.watchdog),
            ),
        )
        for node in config.nodes
    )
    return replace(config, nodes=nodes, dt=2.0 * config.dt)


def _exchanged(
    config: HardwareConfig, bitrate: float, data_bitrate: float
) -> tuple[float, float, float]:
    """Return frames and bits per second, and their share of the bus's time."""
    bus = replace(config.bus, bitrate=None)
    emulator = Emulator(replace(config, bus=bus))
    link = VirtualLink(emulator)
    counts = np.zeros(3)

    def count(message: can.Message) -> None:
        time = wire_time(message, bitrate, data_bitrate)
        counts[:] += 1.0, sum(bits_of(message)), time

    def pass_on(message: can.Message, node: str, t: float) -> list[can.Message]:
        count(message)
        return [message]

    nodes = Nodes(config)
    talk, drive = Dialogue(link, nodes), nodes.drive
    for node in nodes.all:
        talk.perform(node, node.master.configure())
    talk.perform(drive, [*drive.master.clear(), *drive.master.enable()])
    link.sent, emulator.tamper = lambda t, message: count(message), pass_on
    steps = max(1, round(SECONDS / config.dt))
    begin = link.now()
    top = min(config.limits.tau, drive.master.torque_range[1])
    for k in range(steps):
        torque = TORQUE * top * float(np.sin(2.0 * np.pi * FREQUENCY * k * config.dt))
        link.send(nodes.command(torque))
        link.wait_until(begin + (k + 1) * config.dt)
        nodes.hear(link.receive())
    frames, bits, time = counts / (steps * config.dt)
    return float(frames), float(bits), float(time)
