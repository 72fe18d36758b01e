"""The tables of a hardware configuration."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can
import numpy as np

from cjt_gym.canbus.protocols import protocol_of, settings_of
from cjt_gym.canbus.protocols.contract import Limits as DriveLimits
from cjt_gym.canbus.protocols.contract import Settings
from cjt_gym.canbus.safety import SafetyLimits
from cjt_gym.canbus.stamps import STAMPS
from cjt_gym.canbus.tables import Section
from cjt_gym.errors import ConfigurationError, ParameterError, check_name
from cjt_gym.joint import Joint, load_joint, load_joint_file
from cjt_gym.joint.configure import EffectSpec
from cjt_gym.joint.effect_words import parse_effects
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.files.units import in_usual_unit
from cjt_gym.plant import limits_of

BUS = ("interface", "channel", "host", "port", "bitrate", "fd", "stamps", "options")
JOINT = ("file", "structure", "effects")
LIMITS = ("tau", "tau_rate", "dq_m", "q_m", "tau_joint", "deflection", "temperature", "current")
EMULATOR = ("latency", "jitter", "loss", "load", "speed", "seed", "watchdog")
HEADROOM = 1.5
"""Measured values may pass the nominal peak current by this factor before that is a fault."""
RAMP = 0.01
"""Time from zero to the joint's peak torque, where no rate is given [s]."""


@dataclass(frozen=True)
class BusSettings:
    """The bus."""

    interface: str  # name of a python-can interface
    channel: str  # its channel
    host: str = "127.0.0.1"  # host of a socketcand server
    port: int = 29536  # its TCP port
    bitrate: int | None = None  # bit rate [bit/s]; None leaves it to the interface
    fd: bool = False  # whether frames may be CAN FD
    stamps: str = STAMPS[0]  # clock of the arrival times; one of `STAMPS`
    # further arguments of python-can's interface
    options: Mapping[str, Any] = field(default_factory=dict)
    owner: str = "[bus]"  # name of the table in messages

    @property
    def identity(self) -> str:
        """Identity of the bus on this machine."""
        server = f"-{self.host}-{self.port}" if self.interface == "socketcand" else ""
        return f"{self.interface}{server}-{self.channel}"


@dataclass(frozen=True)
class NodeSettings:
    """A node of the bus: "drive" or the name of a sensor, and the settings for its protocol."""

    name: str
    protocol: str
    settings: Settings


@dataclass(frozen=True)
class EmulatorSettings:
    """How an emulated bus and clock behave."""

    latency: float = 0.0  # transit time of a frame [s]
    jitter: float = 0.0  # mean of an additional, exponentially distributed time [s]
    loss: float = 0.0  # share of frames that are lost
    load: float = 0.0  # share of the bus that other nodes take; frames wait for them
    speed: float = 1.0  # speed of simulated time relative to the clock
    seed: int = 0  # seed of sensor noise, latency and loss
    watchdog: float = 0.0  # watchdog time stored in the drive [s]; 0 is the factory setting


def read_bus(table: object, owner: str) -> BusSettings:
    """Return the table [bus]."""
    given = Section(table, owner, BUS)
    interface = given.text("interface")
    check_name(f"interface of {owner}", interface, can.VALID_INTERFACES)
    options = Section(given.table.get("options", {}), f"options of {owner}")
    return BusSettings(
        interface=interface,
        channel=given.text("channel"),
        host=given.text("host", BusSettings.host),
        port=given.whole("port", 1, 65535, default=BusSettings.port),
        bitrate=given.whole("bitrate", 10_000, 8_000_000, default=None),
        fd=given.flag("fd", BusSettings.fd),
        stamps=given.choice("stamps", STAMPS),
        options=dict(options.table),
        owner=owner,
    )


def read_joint(table: object, owner: str, folder: Path) -> tuple[Joint, str, EffectSpec]:
    """Return the joint of the table [joint] without effects, its name or path, and the effects.

    Where the table gives none, the effects are those of the joint file.
    """
    given = Section(table, owner, JOINT)
    name = given.text("file")
    beside = folder / name
    known = str(beside) if name.endswith(".toml") and os.path.isfile(beside) else name
    usual = load_joint_file(known).structure or "output_fixed_rigid_gearbox"
    structure = given.text("structure", usual)
    effects = given.table.get("effects")
    if effects is None:
        effects = load_joint(known, structure).effects
    if isinstance(effects, list) and any("." in word or "=" in word for word in map(str, effects)):
        effects = parse_effects(map(str, effects))
    if not isinstance(effects, list | Mapping):
        raise ConfigurationError(
            f"effects of {owner} must be a list, as for --effect, or a table, got {effects!r}."
        )
    return load_joint(known, structure, effects=[]), known, effects


@dataclass(frozen=True)
class NodeReader:
    """Reads the tables [drive] and [sensors.NAME] of a joint; times in s."""

    folder: Path
    joint: Joint
    dt: float
    watchdog: float
    stored: float

    def read(self, name: str, table: object, owner: str) -> NodeSettings:
        """Return the table of a node."""
        given = Section(table, owner)
        protocol = given.text("protocol")
        known = dict(given.table)
        if "file" in known and os.path.isfile(self.folder / given.text("file")):
            known["file"] = str(self.folder / known["file"])
        p, limits = self.joint.parameters, limits_of(self.joint)
        settings = settings_of(
            protocol_of(protocol),
            known,
            n=p.n,
            period=self.dt,
            watchdog=self.watchdog,
            limits=DriveLimits(
                tau_m=limits.tau,
                dq_m=HEADROOM * limits.dq_m,
                temperature=p.get("Tmp_WMax", math.inf),
                watchdog=self.stored,
            ),
            owner=owner,
        )
        return NodeSettings(name, protocol, settings)


def read_limits(table: object, owner: str, joint: Joint) -> SafetyLimits:
    """Return the limits of the joint file, tightened by the table [limits].

    A tighter current tightens the torque that may be commanded, unless that is given.
    """
    given = Section(table, owner, LIMITS)
    p, most = joint.parameters, limits_of(joint)

    def tightened(key: str, unit: str, top: float) -> float:
        value = given.quantity(key, unit, low=0.0, default=top)
        if value > top:
            raise ConfigurationError(
                f"{key} of {owner} must be <= {top:.6g} {unit}, the limit of {p.name}, got "
                f"{value:g}. Limits here are tighter than the joint's, never looser."
            )
        return float(value)

    current = tightened("current", "A", HEADROOM * p.get("i_p", math.inf))
    tau = tightened("tau", "N m", most.tau)
    if "tau" not in given:
        tau = min(tau, current * p.k_t * p.n / HEADROOM)
    tau_joint = tightened("tau_joint", "N m", most.tau_joint)
    low, high = _span(given)
    return SafetyLimits(
        tau=tau,
        tau_rate=given.quantity("tau_rate", "N m/s", low=0.0, default=most.tau / RAMP),
        dq_m=tightened("dq_m", "rad/s", most.dq_m),
        q_low=low,
        q_high=high,
        tau_joint=tau_joint,
        deflection=tightened("deflection", "rad", tau_joint / p.get("k_b", 1.0)),
        temperature=tightened("temperature", "degC", p.get("Tmp_WMax", math.inf)),
        current=current,
    )


def _span(limits: Section) -> tuple[float, float]:
    """Return the range of the motor angle: `q_m = { low = -1.0, high = 1.0, unit = "rad" }`."""
    if "q_m" not in limits:
        return -math.inf, math.inf
    given = Section(limits.table["q_m"], f"q_m of {limits.owner}", ("low", "high", "unit"))
    low = given.number("low", "rad", above=-math.inf)
    high = given.number("high", "rad", above=low)
    written = Quantity((low, high), given.text("unit"))
    try:
        low, high = np.asarray(in_usual_unit(written, ("rad",), given.owner).value).tolist()
    except ParameterError as error:
        raise ConfigurationError(str(error)) from None
    return low, high


def read_emulator(table: object, owner: str) -> EmulatorSettings:
    """Return the table [emulator]."""
    given = Section(table, owner, EMULATOR)
    share = {
        key: given.number(key, "(share)", -math.inf, 0.95, default=0.0, low=0.0)
        for key in ("loss", "load")
    }
    times = {
        key: given.quantity(key, "s", low=0.0, high=1.0, default=0.0)
        for key in ("latency", "jitter", "watchdog")
    }
    return EmulatorSettings(
        **share,
        **times,
        speed=given.number("speed", "", default=1.0),
        seed=given.whole("seed", 0, 2**31, default=0),
    )
