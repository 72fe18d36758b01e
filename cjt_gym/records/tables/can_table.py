"""Tables out of traces of a CAN bus: every signal of every message that a DBC file describes.

A column is called ``/Message:Signal``, and ``/Message:log_time`` is the time at which the frames of
a message were logged [ns]. The DBC file has the name of the trace, or is the only one beside it.
Traces are those that python-can reads: candump's ``.log``, Vector's ``.asc`` and ``.blf``, PEAK's
``.trc``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk import BYTES_OF_TEXT, COLUMNS, NUMBERS, parsed_each, parsing
from cjt_gym.errors import RecordError
from cjt_gym.records.tables import blf_size
from cjt_gym.records.tables.libraries import library
from cjt_gym.records.tables.mcap_table import LOG_TIME

LATEST = 2**63 / 1e9
"""Time whose nanoseconds a whole number can hold [s]."""


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Return every signal of the messages; frames that break the DBC file are NaN."""
    dbc = _dbc_of(path)
    cantools = library("cantools", path, "can")
    BYTES_OF_TEXT.check(dbc.stat().st_size, dbc, RecordError)
    with parsing(f"{dbc} must be a DBC file", RecordError):
        database = cantools.database.load_file(str(dbc), database_format="dbc")
    messages = {(each.frame_id, each.is_extended_frame): each for each in database.messages}
    COLUMNS.check(sum(len(m.signals) + 1 for m in messages.values()), dbc, RecordError)
    stamps: dict[str, list[int]] = defaultdict(list)
    values: dict[str, list[dict[str, float]]] = defaultdict(list)
    count = 0
    for frame in frames(path):
        message = messages.get((frame.arbitration_id, frame.is_extended_id))
        if message is None or frame.is_remote_frame or frame.is_error_frame:
            continue
        try:
            decoded = message.decode(bytes(frame.data), decode_choices=False)
        except Exception:  # cantools has no common class for what a frame can be
            decoded = {}
        stamps[message.name].append(round(frame.timestamp * 1e9))
        values[message.name].append(decoded)
        count += 1 + len(message.signals)
        NUMBERS.check(count, path, RecordError)
    if not stamps:
        raise RecordError(f"No frame of {path} is in {dbc}. Give the DBC file of this bus.")
    table: dict[str, NDArray[Any]] = {}
    for name, rows in values.items():
        table[f"/{name}:{LOG_TIME}"] = np.array(stamps[name], dtype=np.int64)
        for signal in {signal: None for row in rows for signal in row}:
            column = [float(row.get(signal, np.nan)) for row in rows]
            table[f"/{name}:{signal}"] = np.array(column)
    return table


def frames(path: Path) -> Iterator[Any]:
    """Yield the frames of a trace, as python-can's messages."""
    can, what = library("can", path, "can"), f"{path} must be a trace of a CAN bus"
    if not path.is_file():
        raise RecordError(f"There is no trace {path}.")
    if path.suffix.lower() == ".blf":
        blf_size.check_size(path)
    yield from parsed_each(_messages(can, path), what, RecordError)


def _messages(can: Any, path: Path) -> Iterator[Any]:
    with can.LogReader(path) as reader:
        for message in reader:
            if not abs(message.timestamp) < LATEST:
                raise ValueError(f"a frame was logged at {message.timestamp} s")
            yield message


def _dbc_of(path: Path) -> Path:
    own = path.with_suffix(".dbc")
    found = [own] if own.is_file() else sorted(path.parent.glob("*.dbc"))
    if len(found) != 1:
        raise RecordError(
            f"{path} needs the DBC file of its bus: put it beside as {own.name}. "
            f"DBC files there: {', '.join(each.name for each in found) or 'none'}."
        )
    return found[0]
