"""The file that describes a joint on a bus; `cjt-gym emulate` and `cjt-gym hardware` share it.

```toml
[bus]
interface = "socketcand"
channel = "can0"
host = "127.0.0.1"
port = 29536
[drive]
protocol = "odrive"
node = 1
[joint]
file = "orange_80_6000"
structure = "output_fixed_rigid_gearbox"
effects = ["coulomb_asym", "cogging"]
[control]
rate_hz = 500
[limits]
tau = { value = 40.0, unit = "N m" }
```
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from cjt_gym.canbus.protocols import protocol_of, settings_of
from cjt_gym.canbus.protocols.contract import Limits as DriveLimits
from cjt_gym.canbus.protocols.contract import Settings
from cjt_gym.canbus.safety import SafetyLimits
from cjt_gym.canbus.tables import Table, check_keys, flag, number, quantity, text, whole
from cjt_gym.disk import read_toml
from cjt_gym.errors import ConfigurationError, MissingFileError, unknown_name
from cjt_gym.joint import Joint, load_joint, load_joint_file
from cjt_gym.joint.configure import EffectSpec
from cjt_gym.plant import limits_of

TABLES = ("bus", "drive", "sensors", "joint", "control", "limits", "emulator")
SHARED = ("bus", "control", "emulator", "joints")
OWN = ("name", "drive", "sensors", "joint", "limits")
"""What the joints of a list share, and what each has of its own."""
BUS = ("interface", "channel", "host", "port", "bitrate", "fd", "options")
JOINT = ("file", "structure", "effects")
CONTROL = ("rate_hz", "priority", "missed", "overrun", "watchdog", "soft", "torque")
LIMITS = ("tau", "tau_rate", "dq_m", "q_m", "tau_joint", "deflection", "temperature", "current")
EMULATOR = ("latency", "jitter", "loss", "load", "speed", "seed", "watchdog")
HEADROOM = 1.5
"""Measured values may pass the nominal peak current by this factor before that is a fault."""
RAMP = 0.01
"""Time from zero to the joint's peak torque, where no rate is given [s]."""
WATCHDOG = 1.75
"""Control steps without a command after which a drive stops by itself, where none is given."""
TORQUES = ("auto", "sensor", "spring")


@dataclass(frozen=True)
class BusSettings:
    """Where the bus is.

    Attributes:
        interface: A name of python-can's interfaces.
        channel: Its channel.
        host: Host of a socketcand server.
        port: Its TCP port.
        bitrate: [bit/s]; None leaves it to the interface.
        fd: Whether frames may be CAN FD.
        options: Whatever else python-can's interface takes.
        owner: What messages call the table.
    """

    interface: str
    channel: str
    host: str = "127.0.0.1"
    port: int = 29536
    bitrate: int | None = None
    fd: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    owner: str = "[bus]"

    @property
    def identity(self) -> str:
        """What tells the bus from others on this machine."""
        server = f"-{self.host}-{self.port}" if self.interface == "socketcand" else ""
        return f"{self.interface}{server}-{self.channel}"


@dataclass(frozen=True)
class NodeSettings:
    """A node of the bus.

    Attributes:
        name: "drive", or the name of a sensor.
        protocol: A name of the table of protocols.
        settings: What the protocol needs.
    """

    name: str
    protocol: str
    settings: Settings


@dataclass(frozen=True)
class EmulatorSettings:
    """How an emulated bus and clock behave.

    Attributes:
        latency: Time that a frame takes [s].
        jitter: Mean of a further random time, exponentially distributed [s].
        loss: Share of frames that are lost.
        load: Share of the bus that others take, who let a frame wait.
        speed: Time of the joint over that of the clock on the wall.
        seed: Of the sensors' noise and of latency and loss.
        watchdog: Time without a command after which the drive stops, as set in it beforehand [s];
            0: as it leaves the factory.
    """

    latency: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    load: float = 0.0
    speed: float = 1.0
    seed: int = 0
    watchdog: float = 0.0


@dataclass(frozen=True)
class HardwareConfig:
    """A joint on a bus.

    Attributes:
        bus: Where the bus is.
        nodes: The drive, then the sensors.
        joint: The nominal joint, without effects.
        joint_name: Its name, or the path of its file.
        effects: What the emulated joint has.
        dt: Control step [s].
        priority: Real-time priority of the loop, or None.
        missed: Reports of a node that may be missing in a row.
        overrun: Time by which a command may be late before the loop has overrun [s].
        soft: Time over which torque is given and taken at start and end of a run [s].
        torque: Where joint torque comes from: "sensor", "spring", "auto" for what there is.
        limits: What keeps the joint safe.
        emulator: How an emulated bus behaves.
        origin: The file.
        name: The joint's name where the file lists several.
    """

    bus: BusSettings
    nodes: tuple[NodeSettings, ...]
    joint: Joint
    joint_name: str
    effects: EffectSpec
    dt: float
    priority: int | None
    missed: int
    overrun: float
    soft: float
    torque: str
    limits: SafetyLimits
    emulator: EmulatorSettings
    origin: str
    name: str = ""

    @property
    def drive(self) -> NodeSettings:
        """The node that moves the joint."""
        return self.nodes[0]


def load_hardware(path: str | Path, joint: str | None = None) -> HardwareConfig:
    """Read and check the file of a joint on a bus.

    Args:
        path: The file.
        joint: Which of the joints that it lists; needed where it lists more than one.

    Raises:
        MissingFileError: There is no such file.
        ConfigurationError: It breaks the format, or a limit is looser than the joint file's.
        UnknownNameError: It does not list that joint.
        CjtGymError: Joint, structure, effect or protocol are not known or not valid.
    """
    found = load_joints(path, joint)
    if len(found) > 1:
        raise ConfigurationError(
            f"{path} lists the joints {', '.join(config.name for config in found)}, and one is "
            "meant. Name it: --joint NAME."
        )
    return found[0]


def load_joints(path: str | Path, joint: str | None = None) -> tuple[HardwareConfig, ...]:
    """Read and check the file of one joint on a bus, or of several; one configuration for each.

    Args:
        path: The file.
        joint: The only one of the joints that it lists which is wanted.

    Raises:
        UnknownNameError: It does not list that joint.
        CjtGymError: See `load_hardware`.
    """
    found = {config.name: config for config in _listed(path)}
    if joint is not None and joint not in found:
        raise unknown_name(f"joint of {path}", joint, found)
    return tuple(found.values()) if joint is None else (found[joint],)


def _listed(path: str | Path) -> tuple[HardwareConfig, ...]:
    file = Path(path)
    try:
        document = read_toml(file, ConfigurationError)
    except FileNotFoundError:
        raise MissingFileError(f"The hardware configuration {path} does not exist.") from None
    except OSError as error:
        raise ConfigurationError(f"{path} must be a TOML file in UTF-8: {error}.") from error
    if "joints" not in document:
        return (parse_hardware(document, str(path), file.parent),)
    return parse_joints(document, str(path), file.parent)


def parse_joints(document: Table, origin: str, folder: Path) -> tuple[HardwareConfig, ...]:
    """Return the configurations of a parsed file that lists joints; see `parse_hardware`."""
    shared = {k: v for k, v in check_keys(document, SHARED, origin).items() if k != "joints"}
    listed = document["joints"]
    if not isinstance(listed, list) or not listed:
        raise ConfigurationError(f"joints of {origin} must be tables [[joints]], got {listed!r}.")
    found: list[HardwareConfig] = []
    for k, table in enumerate(listed, 1):
        own = dict(check_keys(table, OWN, f"joint {k} of {origin}"))
        name = text(own, "name", f"joint {k} of {origin}")
        if not name.isidentifier():
            raise ConfigurationError(
                f"The name of joint {k} of {origin} must be letters, digits and _, got {name!r}."
            )
        del own["name"]
        config = parse_hardware(shared | own, f"joint {name} of {origin}", folder)
        for other in found:
            if name == other.name or config.drive.settings.node == other.drive.settings.node:
                raise ConfigurationError(
                    f"Joints of {origin} must differ in name and node, but {other.name} and {name} "
                    f"have the nodes {other.drive.settings.node} and {config.drive.settings.node}."
                )
        found.append(replace(config, name=name))
    return tuple(found)


def parse_hardware(document: Table, origin: str, folder: Path) -> HardwareConfig:
    """Return the configuration of a parsed file.

    Args:
        document: Its tables.
        origin: What messages call it.
        folder: What paths in it are relative to.

    Raises:
        ConfigurationError: See `load_hardware`.
    """
    check_keys(document, TABLES, origin)
    for name in ("bus", "drive", "joint", "control"):
        if name not in document:
            raise ConfigurationError(f"{origin} lacks the table [{name}]. Add it.")
    joint, joint_name, effects = _joint(document["joint"], f"[joint] of {origin}", folder)
    owner = f"[control] of {origin}"
    control = check_keys(document["control"], CONTROL, owner)
    dt = 1.0 / number(control, "rate_hz", owner, "Hz", high=20e3)
    watchdog = quantity(control, "watchdog", owner, "s", low=dt, high=1.0, default=WATCHDOG * dt)
    overrun = quantity(control, "overrun", owner, "s", low=0.0, high=1.0, default=dt)
    if overrun > watchdog:
        raise ConfigurationError(
            f"overrun of {owner} must be <= watchdog, {watchdog:.4g} s, after which the drive "
            f"stops by itself, got {overrun:g} s. Give a longer watchdog, too."
        )
    torque = text(control, "torque", owner, "auto")
    if torque not in TORQUES:
        raise ConfigurationError(f"torque of {owner} must be one of {TORQUES}, got {torque!r}.")
    limits = _limits(document.get("limits", {}), f"[limits] of {origin}", joint)
    emulator = _emulator(document.get("emulator", {}), f"[emulator] of {origin}")
    node = partial(
        _node, folder=folder, joint=joint, dt=dt, watchdog=watchdog, stored=emulator.watchdog
    )
    nodes = [node("drive", document["drive"], f"[drive] of {origin}")]
    sensors = document.get("sensors", {})
    for name, table in check_keys(sensors, list(sensors), f"[sensors] of {origin}").items():
        nodes.append(node(name, table, f"[sensors.{name}] of {origin}"))
    return HardwareConfig(
        bus=_bus(document["bus"], f"[bus] of {origin}"),
        nodes=tuple(nodes),
        joint=joint,
        joint_name=joint_name,
        effects=effects,
        dt=dt,
        priority=whole(control, "priority", owner, 1, 99, default=None),
        missed=whole(control, "missed", owner, 0, 100, default=1),
        overrun=overrun,
        soft=quantity(control, "soft", owner, "s", low=0.0, high=10.0, default=0.1),
        torque=torque,
        limits=limits,
        emulator=emulator,
        origin=origin,
    )


def _bus(table: object, owner: str) -> BusSettings:
    given = check_keys(table, BUS, owner)
    options = given.get("options", {})
    return BusSettings(
        interface=text(given, "interface", owner),
        channel=text(given, "channel", owner),
        host=text(given, "host", owner, "127.0.0.1"),
        port=whole(given, "port", owner, 1, 65535, default=29536),
        bitrate=whole(given, "bitrate", owner, 10_000, 8_000_000, default=None),
        fd=flag(given, "fd", owner, False),
        options=dict(check_keys(options, list(options), f"options of {owner}")),
        owner=owner,
    )


def _joint(table: object, owner: str, folder: Path) -> tuple[Joint, str, EffectSpec]:
    given = check_keys(table, JOINT, owner)
    name = text(given, "file", owner)
    beside = folder / name
    known = str(beside) if name.endswith(".toml") and beside.is_file() else name
    usual = load_joint_file(known).structure or "output_fixed_rigid_gearbox"
    structure = text(given, "structure", owner, usual)
    effects = given.get("effects", [])
    if not isinstance(effects, list | Mapping):
        raise ConfigurationError(
            f"effects of {owner} must be a list of names or a table of effects, got {effects!r}."
        )
    return load_joint(known, structure, effects=[]), known, effects


def _node(
    name: str,
    table: object,
    owner: str,
    *,
    folder: Path,
    joint: Joint,
    dt: float,
    watchdog: float,
    stored: float,
) -> NodeSettings:
    given = dict(check_keys(table, list(table) if isinstance(table, Mapping) else (), owner))
    protocol = text(given, "protocol", owner)
    if "file" in given and (folder / text(given, "file", owner)).is_file():
        given["file"] = str(folder / given["file"])
    p, limits = joint.parameters, limits_of(joint)
    settings = settings_of(
        protocol_of(protocol),
        given,
        n=p.n,
        period=dt,
        watchdog=watchdog,
        limits=DriveLimits(
            tau_m=limits.tau,
            dq_m=HEADROOM * limits.dq_m,
            temperature=p.get("Tmp_WMax", math.inf),
            watchdog=stored,
        ),
        owner=owner,
    )
    return NodeSettings(name, protocol, settings)


def _limits(table: object, owner: str, joint: Joint) -> SafetyLimits:
    """Return the limits of the joint file, tightened by the table."""
    given = check_keys(table, LIMITS, owner)
    p, most = joint.parameters, limits_of(joint)

    def tightened(key: str, unit: str, top: float) -> float:
        value = quantity(given, key, owner, unit, low=0.0, default=top)
        if value > top:
            raise ConfigurationError(
                f"{key} of {owner} must be <= {top:.6g} {unit}, the limit of {p.name}, got "
                f"{value:g}. Limits here are tighter than the joint's, never looser."
            )
        return float(value)

    tau = tightened("tau", "N m", most.tau)
    tau_joint = tightened("tau_joint", "N m", most.tau_joint)
    low, high = _span(given, owner)
    return SafetyLimits(
        tau=tau,
        tau_rate=quantity(given, "tau_rate", owner, "N m/s", low=0.0, default=most.tau / RAMP),
        dq_m=tightened("dq_m", "rad/s", most.dq_m),
        q_low=low,
        q_high=high,
        tau_joint=tau_joint,
        deflection=tightened("deflection", "rad", tau_joint / p.get("k_b", 1.0)),
        temperature=tightened("temperature", "degC", p.get("Tmp_WMax", math.inf)),
        current=tightened("current", "A", HEADROOM * p.get("i_p", math.inf)),
    )


def _span(table: Table, owner: str) -> tuple[float, float]:
    """Return lowest and highest motor angle: `q_m = { low = -1.0, high = 1.0, unit = "rad" }`."""
    if "q_m" not in table:
        return -math.inf, math.inf
    place = f"q_m of {owner}"
    given = check_keys(table["q_m"], ("low", "high", "unit"), place)
    if text(given, "unit", place) != "rad":
        raise ConfigurationError(f"{place} must be in rad, got {given['unit']!r}.")
    low = number(given, "low", place, "rad", low=-math.inf)
    return low, number(given, "high", place, "rad", low=low)


def _emulator(table: object, owner: str) -> EmulatorSettings:
    given = check_keys(table, EMULATOR, owner)
    share = {
        key: number(given, key, owner, "(share)", low=-1e-300, high=0.95, default=0.0)
        for key in ("loss", "load")
    }
    times = {
        key: quantity(given, key, owner, "s", low=0.0, high=1.0, default=0.0)
        for key in ("latency", "jitter", "watchdog")
    }
    return EmulatorSettings(
        **share,
        **times,
        speed=number(given, "speed", owner, "", default=1.0),
        seed=whole(given, "seed", owner, 0, 2**31, default=0),
    )
