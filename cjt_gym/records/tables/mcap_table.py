"""Tables out of MCAP files: every number of every message, by topic and field.

A column is called ``/topic:field``, and ``/topic:log_time`` is the time at which the messages of a
topic were logged [ns]. Messages are read where they are encoded as JSON or by ROS 2.

A record is written as one topic with a message in JSON per sample, whose fields are the columns.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk import COLUMNS, NUMBERS, parsing
from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.tables.flat import flat_numbers
from cjt_gym.records.tables.libraries import library

LOG_TIME: Final = "log_time"
RECORD: Final = "/cjt_gym/record"
"""Topic of a record that was written here."""
NOTHING: Final = re.compile(rb"\[\s*0+\s*\]")
Decode = Callable[[bytes], Any]


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Return every number of the messages; a field that a message lacks is NaN there.

    A file that ends too early, because its recorder was stopped, is read as far as it goes.
    """
    topics: dict[str, Topic] = {}
    decoders: dict[int, Decode | None] = {}
    encodings = set()
    for schema, channel, message in _messages(path):
        if channel.id not in decoders:
            decoders[channel.id] = _decoder(schema, channel, path)
            encodings.add(f"{channel.topic} ({channel.message_encoding or 'unknown'})")
        decode = decoders[channel.id]
        if decode is not None:
            topic = topics.setdefault(channel.topic, Topic([], defaultdict(list)))
            what = f"A message of {channel.topic} in {path} must be as its schema says"
            with parsing(what, RecordError):
                content = decode(message.data)
            topic.add(message.log_time, content)
            COLUMNS.check(sum(len(t.fields) + 1 for t in topics.values()), path, RecordError)
            NUMBERS.check(sum(t.size for t in topics.values()), path, RecordError)
    if not topics:
        raise RecordError(
            f"{path} must have a topic with messages in JSON or of ROS 2 (cdr), "
            f"found {', '.join(sorted(encodings)) or 'no messages'}. Convert the file, or export "
            "the topics you need as CSV."
        )
    if set(topics) == {RECORD}:
        return {name: values for name, values in topics[RECORD].columns() if name != LOG_TIME}
    return {
        f"{name}:{field}": values
        for name, topic in topics.items()
        for field, values in topic.columns()
    }


def write(columns: Mapping[str, FloatArray], path: Path) -> None:
    """Write columns as one topic; a sample that is missing is left out of its message."""
    writer = library("mcap.writer", path, "logs").Writer(str(path))
    writer.start()
    numbers = {name: {"type": "number"} for name in columns}
    schema = json.dumps({"type": "object", "properties": numbers}).encode()
    schema_id = writer.register_schema("cjt_gym.Record", "jsonschema", schema)
    channel = writer.register_channel(RECORD, "json", schema_id)
    samples = zip(*(values.tolist() for values in columns.values()), strict=True)
    for k, sample in enumerate(samples):
        message = {n: v for n, v in zip(columns, sample, strict=True) if math.isfinite(v)}
        stamp = max(0, round(message.get("t", float(k)) * 1e9))
        writer.add_message(channel, stamp, json.dumps(message).encode(), stamp, k)
    writer.finish()


def clock_of(source: str) -> str | None:
    """Return the column with the time of a column, or None where it is not one of a topic.

    Example:
        >>> clock_of("/joint_states:position[elbow]"), clock_of("q_m")
        ('/joint_states:log_time', None)
    """
    topic, colon, _ = source.rpartition(":")
    return f"{topic}:{LOG_TIME}" if colon and topic.startswith("/") else None


@dataclass(frozen=True)
class Topic:
    """What the messages of a topic hold: when each was logged [ns], and its numbers by message."""

    stamps: list[int]
    fields: dict[str, list[tuple[int, float]]]

    @property
    def size(self) -> int:
        """Numbers in its columns."""
        return len(self.stamps) * (len(self.fields) + 1)

    def add(self, stamp: int, content: Any) -> None:
        """Add a message."""
        for name, number in flat_numbers("", content):
            self.fields[name].append((len(self.stamps), number))
        self.stamps.append(stamp)

    def columns(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Yield the time, and every number, of shape (messages,)."""
        yield LOG_TIME, np.array(self.stamps, dtype=np.int64)
        for name, pairs in self.fields.items():
            values = np.full(len(self.stamps), np.nan)
            rows, numbers = zip(*pairs, strict=True)
            values[list(rows)] = numbers
            yield name, values


def _messages(path: Path) -> Iterator[tuple[Any, Any, Any]]:
    """Yield schema, channel and message, up to the end or to where the file is damaged."""
    mcap = library("mcap.records", path, "logs")
    schemas, channels, begun = {}, {}, False
    with path.open("rb") as file:
        try:
            for record in _records(file, path):
                if isinstance(record, mcap.Schema):
                    schemas[record.id] = record
                elif isinstance(record, mcap.Channel):
                    channels[record.id] = record
                elif isinstance(record, mcap.Message):
                    channel, begun = channels[record.channel_id], True
                    yield schemas.get(channel.schema_id), channel, record
        except RecordError:
            raise
        except Exception:  # a decompressor raises classes of its own
            if not begun:
                raise


def _records(file: IO[bytes], path: Path) -> Iterator[Any]:
    """Yield the records of a file, out of its chunks, whose size is checked before it is made."""
    stream, total = library("mcap.stream_reader", path, "logs"), 0
    for record in stream.StreamReader(file, emit_chunks=True).records:
        if not hasattr(record, "uncompressed_size"):
            yield record
            continue
        total += record.uncompressed_size
        NUMBERS.check(total // 8, path, RecordError)
        yield from stream.breakup_chunk(replace(record, compression="", data=_unpacked(record)))


def _unpacked(chunk: Any) -> bytes:
    """Return the content of a chunk, and not a byte more than it says."""
    size = chunk.uncompressed_size
    if chunk.compression == "zstd":
        unpack = importlib.import_module("zstandard").ZstdDecompressor()
        data: bytes = unpack.stream_reader(chunk.data).read(size + 1)
    elif chunk.compression == "lz4":
        unpack = importlib.import_module("lz4.frame").LZ4FrameDecompressor()
        data = unpack.decompress(chunk.data, max_length=size + 1)
    elif chunk.compression:
        raise ValueError(f"unknown compression {chunk.compression!r}")
    else:
        data = chunk.data
    if len(data) != size:
        raise ValueError(f"a chunk should hold {size} bytes")
    return data


class Bounded(bytes):
    """The bytes of a message; to read beyond them is an error, where Python would give none."""

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, slice) and key.stop is not None and key.stop > len(self):
            raise EOFError("it ends too early")
        return super().__getitem__(key)


def _decoder(schema: Any, channel: Any, path: Path) -> Decode | None:
    """Return what turns the messages of a channel into mappings; None where nothing can."""
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding == "cdr" and schema is not None:
        factory = library("mcap_ros2.decoder", path, "logs").DecoderFactory()
        if NOTHING.search(schema.data):
            return None  # any number of items that take no bytes
        with contextlib.redirect_stderr(io.StringIO()):  # where it also prints what it raises
            decode = factory.decoder_for(channel.message_encoding, schema)
        return None if decode is None else lambda data: _plain(decode(Bounded(data)))
    return None


def _plain(value: Any) -> Any:
    slots = getattr(value, "__slots__", None)
    if slots:
        return {name.lstrip("_"): _plain(getattr(value, name)) for name in slots}
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
