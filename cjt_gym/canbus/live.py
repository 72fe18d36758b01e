"""Live view of a run for Foxglove: a WebSocket server with channels, limits and faults.

Each row of the record is sent after the frames of its control period, in the topic that an MCAP
file of the record uses, so the same viewer layout works for both.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, Self, final

import foxglove
from foxglove.channels import LogChannel
from foxglove.messages import Log, LogLevel, Timestamp

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.safety import SafetyLimits
from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.records.columns import JOINT_MARK
from cjt_gym.records.tables.mcap_table import RECORD

HERE: Final = "127.0.0.1"
LIMITS: Final = "/cjt_gym/limits"
FAULTS: Final = "/cjt_gym/faults"
AGAIN: Final = 0.5
"""Time after which the limits are sent again, for viewers that connect later [s]."""
FAREWELL: Final = 0.3
"""Time for which the server outlives the runs, so that the last frames go out [s]."""


@final
class LiveView:
    """A `Watcher` that shows records to connected viewers.

    Attributes:
        context: Context of the topics; further sinks of Foxglove's SDK may be added to it.
        address: Address for viewers.
        link: Link that opens it in Foxglove.
    """

    def __init__(self, configs: Sequence[HardwareConfig], port: int) -> None:
        """Start the server."""
        check_range("The port of --live", port, low=0, high=65535)
        self.context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name="cjt-gym", host=HERE, port=port, context=self.context
            )
        except Exception as error:  # of a kind that the SDK does not name
            raise ConfigurationError(
                f"The live view cannot be served at port {port}: {error}. Give another: --live "
                "PORT."
            ) from error
        self._channels: dict[str, foxglove.Channel] = {}
        self.address, self.link = f"ws://{HERE}:{self._server.port}", self._server.app_url()
        names = [config.name for config in configs] if len(configs) > 1 else [""]
        self._limits = []
        for name, config in zip(names, configs, strict=True):
            limits = limits_of(config.limits)
            self._limits.append((self._channel(_topic(LIMITS, name), limits), limits))
        self._faults = LogChannel(FAULTS, context=self.context)
        self._fields: list[tuple[foxglove.Channel, list[tuple[int, str]]]] = []
        self._begun, self._last, self._told = 0, 0.0, -math.inf

    def begin(self, columns: Sequence[str], facts: Mapping[str, Any]) -> None:
        """Take the columns of a run; each joint gets its own topic."""
        topics: dict[str, list[tuple[int, str]]] = {}
        for k, column in enumerate(columns):
            name, _, plain = column.rpartition(JOINT_MARK)
            if k > 0:
                topics.setdefault(_topic(RECORD, name), []).append((k, plain))
        self._fields = [
            (self._channel(topic, ["t", *(name for _, name in fields)]), fields)
            for topic, fields in topics.items()
        ]
        self._begun, self._told = time.time_ns(), -math.inf
        self._say(0.0, LogLevel.Info, str(facts.get("joint") or "all joints"), "The run begins.")

    def see(self, row: Sequence[float]) -> None:
        """Send a row, and the limits from time to time."""
        t = row[0]
        stamp = self._begun + round(t * 1e9)
        for channel, fields in self._fields:
            message = {name: row[k] for k, name in fields if math.isfinite(row[k])}
            channel.log({"t": t, **message}, log_time=stamp)
        if t >= self._told + AGAIN:
            self._told = t
            for channel, limits in self._limits:
                channel.log(limits, log_time=stamp)
        self._last = t

    def end(self, known: Mapping[str, Any]) -> None:
        """Send the end of a run."""
        fault = known.get("fault")
        if fault is None:
            self._say(self._last, LogLevel.Info, "", "The run has ended.")
        else:
            text = f"{fault['kind']}: {fault['text']}"
            self._say(self._last, LogLevel.Error, str(fault.get("joint", "")), text)

    def _say(self, t: float, level: LogLevel, name: str, text: str) -> None:
        stamp = self._begun + round(t * 1e9)
        self._last = t
        at = Timestamp(sec=stamp // 10**9, nsec=stamp % 10**9)
        self._faults.log(Log(timestamp=at, level=level, name=name, message=text), log_time=stamp)

    def _channel(self, topic: str, fields: Iterable[str]) -> foxglove.Channel:
        """Return the channel of a topic, and close that of an earlier run."""
        if topic in self._channels:
            self._channels[topic].close()
        kind = {"type": "object", "additionalProperties": {"type": "number"}}
        number = kind if topic.startswith(LIMITS) else {"type": "number"}
        schema = {"type": "object", "properties": dict.fromkeys(fields, number)}
        self._channels[topic] = foxglove.Channel(topic, schema=schema, context=self.context)
        return self._channels[topic]

    def close(self) -> None:
        """Stop the server once everything has been sent."""
        time.sleep(FAREWELL)
        self._server.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()


def _topic(base: str, name: str) -> str:
    return f"{base}/{name}" if name else base


def limits_of(limits: SafetyLimits) -> dict[str, dict[str, float]]:
    """Return the limits "low" and "high" by the column that they bound.

    Example:
        >>> from cjt_gym.canbus.config import load_hardware
        >>> limits_of(load_hardware("examples/hardware/joint.toml").limits)["tau_cmd"]
        {'low': -60.0, 'high': 60.0}
    """
    ranges = {name: (low, high) for name, low, high, *_ in limits.ranges(("temperature",))}
    del ranges["deflection"]  # which records do not have
    found = {}
    for name, ends in {"tau_cmd": (-limits.tau, limits.tau), **ranges}.items():
        named = zip(("low", "high"), ends, strict=True)
        found[name] = {key: end for key, end in named if math.isfinite(end)}
    return {name: ends for name, ends in found.items() if ends}
