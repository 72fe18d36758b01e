"""A joint on a bus for tests: its configuration, and a plant in virtual time."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from cjt_gym.canbus.config import HardwareConfig, parse_hardware
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.virtual import VirtualLink

DRIVES: dict[str, dict[str, Any]] = {
    "mit": {"protocol": "mit", "node": 1, "model": "AK80-64", "unwatched": True},
    "odrive": {"protocol": "odrive", "node": 3, "reports": "cyclic", "cycle_ms": 1},
    "moteus": {"protocol": "moteus", "node": 3},
    "cia402": {
        "protocol": "cia402",
        "node": 3,
        "rated_torque": 0.5,
        "rated_current": 6.4,
        "increments": 1 << 20,
    },
    "dbc": {"protocol": "dbc", "file": "example_drive"},
}
"""A drive of each protocol."""
SET_BEFORE = ("mit", "dbc")
"""Protocols that cannot set a drive's watchdog: what is emulated here had it set before."""

SHARP = {"missed": 1, "overrun": 1.0, "watchdog": 1.75}
"""What a control step of virtual time, in which nothing is ever late, can keep [steps]."""
PATIENT = 0.0235
"""A drive's watchdog where nothing else is asked for, at 500 Hz [s]."""

BASE: dict[str, Any] = {
    "bus": {"interface": "virtual", "channel": "bench"},
    "drive": DRIVES["odrive"],
    "joint": {"file": "orange_80_6000", "structure": "output_fixed_rigid_gearbox"},
    "control": {"rate_hz": 500},
}


def document(**changes: dict[str, Any]) -> dict[str, Any]:
    """Return a configuration's tables, some of their keys changed; a drive is replaced."""
    tables = copy.deepcopy(BASE)
    for name, table in changes.items():
        tables[name] = table if name == "drive" else tables.get(name, {}) | table
    if tables["drive"]["protocol"] in SET_BEFORE:
        time = tables["control"].get("watchdog", {"value": PATIENT, "unit": "s"})
        tables["emulator"] = {"watchdog": time} | tables.get("emulator", {})
    return tables


def sharp(**control: Any) -> dict[str, Any]:
    """Return the table [control] with allowances that only virtual time can keep."""
    control = BASE["control"] | control
    step = 1.0 / max(control["rate_hz"], 1.0)
    times = {k: {"value": SHARP[k] * step, "unit": "s"} for k in ("overrun", "watchdog")}
    return {"missed": SHARP["missed"]} | times | control


def config(**changes: dict[str, Any]) -> HardwareConfig:
    """Return a configuration with some of its tables changed, as sharp as virtual time allows."""
    changes["control"] = sharp(**changes.get("control", {}))
    return parse_hardware(document(**changes), "bench.toml", Path())


def virtual_plant(given: HardwareConfig, record: Path | None = None) -> tuple[CanPlant, Emulator]:
    """Return a connected and armed plant in virtual time, and its emulator."""
    emulator = Emulator(given)
    plant = CanPlant(given, VirtualLink(emulator), record)
    plant.connect()
    plant.arm()
    return plant, emulator
