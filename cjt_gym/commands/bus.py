"""`cjt-gym bus`: which rate a bus can carry, before anything is armed."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from cjt_gym.canbus.bus_load import BITRATE, DATA_BITRATE, BusLoad, bus_load
from cjt_gym.canbus.config import load_joints
from cjt_gym.console import Answer
from cjt_gym.errors import check_range

LEAST, MOST = 10_000, 20_000_000
"""Bit rates that are taken [bit/s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the joints and the bit rates."""
    add = parser.add_argument
    add("config", type=Path, metavar="CONFIG.toml", help="the joints on their bus, as for hardware")
    text = f"[bit/s]; default: bitrate of [bus], or {BITRATE:g}"
    add("--bitrate", type=float, help=text)
    text = "bitrate of CAN FD's data phase [bit/s]; default: options.data_bitrate, or "
    text += f"{DATA_BITRATE:g}"
    add("--data-bitrate", type=float, help=text)


def run(options: argparse.Namespace) -> Answer:
    """Say what each joint asks of the bus, and which rate it carries. No bus is touched."""
    for name in ("bitrate", "data_bitrate"):
        if (value := getattr(options, name)) is not None:
            check_range(f"--{name.replace('_', '-')}", value, "bit/s", low=LEAST, high=MOST)
    load = bus_load(load_joints(options.config), options.bitrate, options.data_bitrate)
    form = "{:16}{:10}{:>6}{:>11}{:>11}{:>8}\n"
    text = form.format("joint", "protocol", "node", "frames/s", "kbit/s", "share")
    for joint in load.joints:
        cells = (f"{joint.frames:.0f}", f"{joint.bits / 1e3:.1f}", f"{100.0 * joint.share:.1f} %")
        text += form.format(joint.name, joint.protocol, joint.node, *cells)
    derived = {name: getattr(load, name) for name in ("share", "most_hz", "saturating")}
    return asdict(load) | derived, text + _words(load)


def _words(load: BusLoad) -> str:
    text = (
        f"At {load.rate_hz:g} Hz the bus of {load.bitrate / 1e6:g} Mbit/s is busy for "
        f"{100.0 * load.share:.1f} % of the time; it carries up to {load.most_hz:.0f} Hz."
    )
    if load.saturating:
        text += (
            f" Too much: {', '.join(load.saturating)} do not fit. Lower rate_hz, use a faster "
            "bus, or spread the joints over several."
        )
    return text
