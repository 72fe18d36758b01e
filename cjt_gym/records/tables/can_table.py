"""Tables out of traces of a CAN bus: every signal of every message that a DBC file describes.

A column is called ``/Message:Signal``, and ``/Message:log_time`` is the time at which the frames of
a message were logged [ns]. The DBC file has the name of the trace, or is the only one beside it.
Traces are those that python-can reads: candump's ``.log``, Vector's ``.asc`` and ``.blf``, PEAK's
``.trc``.
"""

from __future__ import annotations

import importlib
import struct
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import RecordError
from cjt_gym.records.tables.flat import sliced
from cjt_gym.records.tables.mcap_table import LOG_TIME

BLF = b"LOGG"
DAMAGED = (ValueError, KeyError, IndexError, EOFError, OSError, struct.error)


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Return every signal of the messages; frames that break the DBC file are NaN.

    Raises:
        RecordError: python-can or cantools is not installed, the trace or the DBC file cannot be
            read, or no frame is in the DBC file.
    """
    dbc = _dbc_of(path)
    cantools = _import("cantools", path)
    messages = {
        (message.frame_id, message.is_extended_frame): message
        for message in _database(cantools, dbc).messages
    }
    stamps: dict[str, list[int]] = defaultdict(list)
    values: dict[str, list[dict[str, float]]] = defaultdict(list)
    for frame in frames(path):
        message = messages.get((frame.arbitration_id, frame.is_extended_id))
        if message is None or frame.is_remote_frame or frame.is_error_frame:
            continue
        try:
            decoded = message.decode(bytes(frame.data), decode_choices=False)
        except (cantools.Error, *DAMAGED):
            decoded = {}
        stamps[message.name].append(round(frame.timestamp * 1e9))
        values[message.name].append(decoded)
    if not stamps:
        raise RecordError(f"No frame of {path} is in {dbc}. Give the DBC file of this bus.")
    table: dict[str, NDArray[Any]] = {}
    for name, rows in values.items():
        table[f"/{name}:{LOG_TIME}"] = np.array(stamps[name], dtype=np.int64)
        for signal in {signal: None for row in rows for signal in row}:
            column = [float(row.get(signal, np.nan)) for row in rows]
            table[f"/{name}:{signal}"] = np.array(column)
    return table


def stream(path: Path, rows: int) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield the columns; messages have clocks of their own, so the file is read as a whole."""
    return sliced(read(path), rows)


def frames(path: Path) -> Iterator[Any]:
    """Yield the frames of a trace, as python-can's messages.

    Raises:
        RecordError: python-can is not installed, or the trace cannot be read.
    """
    can = _import("can", path)
    if not path.is_file():
        raise RecordError(f"There is no trace {path}.")
    with path.open("rb") as file:
        if path.suffix.lower() == ".blf" and file.read(4) != BLF:
            raise RecordError(f"{path} must be a trace of a CAN bus; it does not begin as BLF.")
    try:
        with can.LogReader(path) as reader:
            yield from reader
    except DAMAGED as error:
        raise RecordError(f"{path} must be a trace of a CAN bus: {error!r}.") from error


def _dbc_of(path: Path) -> Path:
    own = path.with_suffix(".dbc")
    found = [own] if own.is_file() else sorted(path.parent.glob("*.dbc"))
    if len(found) != 1:
        raise RecordError(
            f"{path} needs the DBC file of its bus: put it beside as {own.name}. "
            f"DBC files there: {', '.join(each.name for each in found) or 'none'}."
        )
    return found[0]


def _database(cantools: Any, dbc: Path) -> Any:
    try:
        return cantools.database.load_file(str(dbc), database_format="dbc")
    except (cantools.Error, *DAMAGED) as error:
        raise RecordError(f"{dbc} must be a DBC file: {error}.") from error


def _import(name: str, path: Path) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = {"can": "python-can"}.get(name, name)
        raise RecordError(
            f"{path} needs {package}, which is not installed: pip install cjt-gym[can]."
        ) from error
