"""Reads traces of a bus as records, by the protocols of its nodes.

:func:`read_log` reads traces with a DBC file and a mapping beside them like any other log.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.canbus.protocols.contract import Master, Settings
from cjt_gym.canbus.protocols.row import DriveProtocol
from cjt_gym.errors import ProtocolError, RecordError
from cjt_gym.records import COLUMNS, Record, Repair, load_mapping
from cjt_gym.records.repair import make_records
from cjt_gym.records.sources import clock, mapped
from cjt_gym.records.tables.can_table import frames
from cjt_gym.records.tables.mcap_table import LOG_TIME

COMMAND: Final = "tau_cmd"
Node = tuple[DriveProtocol, Settings]


def read_trace(
    path: str | Path, nodes: Sequence[Node], **facts: Any
) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    """Return the reports and commands of a joint's nodes.

    The time base is that of the commands, or of the most frequent channel.

    Args:
        path: A trace that python-can reads: ``.log`` of candump, ``.asc``, ``.blf``, ``.trc``.
        nodes: Protocol and settings of drive and sensors.
        facts: Further arguments of :class:`Record`: `joint`, `structure`, `sensors`, `provenance`.

    Returns:
        A record per piece of the trace, and what was repaired or noticed: frames that break their
        protocol are counted.

    Raises:
        RecordError: The trace cannot be read, or no frame is from these nodes.
    """
    path = Path(path)
    stamps: dict[str, list[int]] = defaultdict(list)
    values: dict[str, list[float]] = defaultdict(list)
    masters = [row.master(settings) for row, settings in nodes]
    broken = 0
    for frame in frames(path):
        stamp = round(frame.timestamp * 1e9)
        for master in masters:
            try:
                said = _said(master, frame)
            except ProtocolError:
                said, broken = {}, broken + 1
            for name, value in said.items():
                stamps[name].append(stamp)
                values[name].append(value)
    if not stamps:
        raise RecordError(
            f"No frame of {path} is from these nodes. Check their protocols and addresses."
        )
    table: dict[str, NDArray[Any]] = {}
    for name, shown in values.items():
        table[f"/{name}:value"] = np.array(shown)
        table[f"/{name}:{LOG_TIME}"] = np.array(stamps[name], dtype=np.int64)
    records, repairs = _records(path, table, facts)
    if broken:
        text = f"{broken} frames break the protocol of their node and were left out."
        repairs = (Repair("unreadable", None, broken, True, text), *repairs)
    return records, repairs


def _said(master: Master, frame: Any) -> Mapping[str, float]:
    torque = master.commanded(frame)
    if torque is not None:
        return {COMMAND: torque}
    update = master.decode(frame)
    channels = update.channels if update is not None else {}
    return {name: value for name, value in channels.items() if name in COLUMNS}


def _records(
    path: Path, table: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]
) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    names = [name.removesuffix(":value")[1:] for name in table if name.endswith(":value")]
    columns = {name: {"source": f"/{name}:value"} for name in names}
    if COMMAND in columns:
        columns["t"] = {"source": f"/{COMMAND}:{LOG_TIME}", "unit": "ns"}
    mapping = load_mapping({"columns": columns, **facts})
    base = clock(mapping, table, str(path))
    columns_si = mapped(mapping, table, base, str(path))
    units = {"t": "s", **mapping.units}
    made = {**mapping.facts, "units": units, "origin": path}
    return make_records(columns_si, made, {})
