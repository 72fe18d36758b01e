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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cjt_gym.canbus.safety import SafetyLimits
from cjt_gym.canbus.settings import (
    BusSettings,
    EmulatorSettings,
    NodeReader,
    NodeSettings,
    read_bus,
    read_emulator,
    read_joint,
    read_limits,
)
from cjt_gym.canbus.tables import Section
from cjt_gym.disk import read_toml
from cjt_gym.errors import ConfigurationError, MissingFileError, unknown_name
from cjt_gym.joint import Joint
from cjt_gym.joint.configure import EffectSpec

TABLES = ("bus", "drive", "sensors", "joint", "control", "limits", "emulator")
SHARED = ("bus", "control", "emulator", "joints")
OWN = ("name", "drive", "sensors", "joint", "limits")
"""What the joints of a list share, and what each has of its own."""
CONTROL = ("rate_hz", "priority", "missed", "overrun", "watchdog", "soft", "torque")
LATE = 0.02
"""By how much a command may be late where nothing else is asked for [s].

An ordinary computer without a real-time kernel holds a loop up by up to 15 ms now and then,
even where nothing else runs. For comparison, a moteus as delivered stops by itself after 100 ms.
"""
SPARE = 0.75
"""Control steps by which a drive's watchdog outlasts the latest command that is no fault."""
TORQUES = ("auto", "sensor", "spring")
Table = Mapping[str, Any]


@dataclass(frozen=True)
class HardwareConfig:
    """A joint on a bus."""

    bus: BusSettings  # where the bus is
    nodes: tuple[NodeSettings, ...]  # the drive, then the sensors
    joint: Joint  # the nominal joint, without effects
    joint_name: str  # its name, or the path of its file
    effects: EffectSpec  # what the emulated joint has
    dt: float  # control step [s]
    priority: int | None  # real-time priority of the loop, or None
    missed: int  # reports of a node that may be missing in a row
    overrun: float  # time by which a command may be late before the loop has overrun [s]
    soft: float  # time over which torque is given and taken at start and end of a run [s]
    torque: str  # where joint torque comes from: "sensor", "spring", "auto" for what there is
    limits: SafetyLimits  # what keeps the joint safe
    emulator: EmulatorSettings  # how an emulated bus behaves
    origin: str  # the file
    name: str = ""  # the joint's name where the file lists several

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
    file = Path(path)
    try:
        document = read_toml(file, ConfigurationError)
    except FileNotFoundError:
        raise MissingFileError(f"The hardware configuration {path} does not exist.") from None
    except OSError as error:
        raise ConfigurationError(f"{path} must be a TOML file in UTF-8: {error}.") from error
    if "joints" in document:
        configs = parse_joints(document, str(path), file.parent)
    else:
        configs = (parse_hardware(document, str(path), file.parent),)
    found = {config.name: config for config in configs}
    if joint is not None and joint not in found:
        raise unknown_name(f"joint of {path}", joint, found)
    return configs if joint is None else (found[joint],)


def parse_joints(document: Table, origin: str, folder: Path) -> tuple[HardwareConfig, ...]:
    """Return the configurations of a parsed file that lists joints; see `parse_hardware`."""
    shared = {k: v for k, v in Section(document, origin, SHARED).table.items() if k != "joints"}
    listed = document["joints"]
    if not isinstance(listed, list) or not listed:
        raise ConfigurationError(f"joints of {origin} must be tables [[joints]], got {listed!r}.")
    found: list[HardwareConfig] = []
    for k, table in enumerate(listed, 1):
        given = Section(table, f"joint {k} of {origin}", OWN)
        name = given.text("name")
        if not name.isidentifier():
            raise ConfigurationError(
                f"The name of joint {k} of {origin} must be letters, digits and _, got {name!r}."
            )
        own = {key: value for key, value in given.table.items() if key != "name"}
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
    Section(document, origin, TABLES)
    for name in ("bus", "drive", "joint", "control"):
        if name not in document:
            raise ConfigurationError(f"{origin} lacks the table [{name}]. Add it.")
    joint, joint_name, effects = read_joint(document["joint"], f"[joint] of {origin}", folder)
    control = Section(document["control"], f"[control] of {origin}", CONTROL)
    dt = 1.0 / control.number("rate_hz", "Hz", high=20e3)
    overrun, watchdog, missed = _allowances(control, dt)
    if overrun > watchdog:
        raise ConfigurationError(
            f"overrun of {control.owner} must be <= watchdog, {watchdog:.4g} s, after which the "
            f"drive stops by itself, got {overrun:g} s. Give a longer watchdog, too."
        )
    limits = read_limits(document.get("limits", {}), f"[limits] of {origin}", joint)
    emulator = read_emulator(document.get("emulator", {}), f"[emulator] of {origin}")
    reader = NodeReader(folder, joint, dt, watchdog, emulator.watchdog)
    nodes = [reader.read("drive", document["drive"], f"[drive] of {origin}")]
    sensors = Section(document.get("sensors", {}), f"[sensors] of {origin}").table
    nodes += [reader.read(k, v, f"[sensors.{k}] of {origin}") for k, v in sensors.items()]
    return HardwareConfig(
        bus=read_bus(document["bus"], f"[bus] of {origin}"),
        nodes=tuple(nodes),
        joint=joint,
        joint_name=joint_name,
        effects=effects,
        dt=dt,
        priority=control.whole("priority", 1, 99, default=None),
        missed=missed,
        overrun=overrun,
        soft=control.quantity("soft", "s", low=0.0, high=10.0, default=0.1),
        torque=control.choice("torque", TORQUES),
        limits=limits,
        emulator=emulator,
        origin=origin,
    )


def _allowances(control: Section, dt: float) -> tuple[float, float, int]:
    """Return how late a command may be, the drive's watchdog [s], and reports that may be missing.

    What is not given follows from what is: no command may come later than the watchdog allows, and
    while the loop is held up no reports are read.
    """
    given = control.quantity("watchdog", "s", low=dt, high=1.0, default=None)
    late = max(LATE, dt) if given is None else min(max(LATE, dt), given)
    overrun = control.quantity("overrun", "s", low=0.0, high=1.0, default=late)
    watchdog = min(1.0, overrun + (1.0 + SPARE) * dt) if given is None else given
    missed = max(1, min(100, math.ceil(overrun / dt)))
    return overrun, watchdog, control.whole("missed", 0, 100, default=missed)
