"""Any drive or sensor with a DBC file, through a mapping of its signals.

A node without a command (`tau_cmd` or `i_cmd`) in its mapping is a sensor, and is never commanded
or enabled. Torque sensor, second encoder and drive may be different nodes, each with its own
mapping. Rolling counters and checksums in commands are not supported; a drive that needs them needs
its own protocol.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from math import inf, isfinite
from typing import Any, Final

import cantools

from cjt_gym.canbus.protocols.contract import (
    Master,
    Message,
    Mode,
    Settings,
    Step,
    Update,
    frame_of,
)
from cjt_gym.canbus.protocols.dbc_mapping import DbcMapping, Signal, load_dbc_mapping
from cjt_gym.errors import ConfigurationError, ProtocolError

DAMAGED: Final = (cantools.Error, ValueError, KeyError, OverflowError)
AS_NUMBERS: Final = {"decode_choices": False}


def mapping_of(settings: Settings) -> DbcMapping:
    """Return the mapping that the settings name."""
    mapping = load_dbc_mapping(settings.options["file"], settings.scaling.gear_ratio)
    if mapping.is_current and settings.scaling.torque_constant is None:
        raise ConfigurationError(
            "torque_constant must be given [N m/A, motor's shaft] where the drive is commanded a "
            "current (i_cmd)."
        )
    return mapping


def torque_of_command(mapping: DbcMapping, settings: Settings) -> float:
    """Return the link-side motor torque per unit of the commanded column."""
    if not mapping.is_current:
        return 1.0
    return (settings.scaling.torque_constant or 0.0) * settings.scaling.gear_ratio


def range_of(signal: Any) -> tuple[float, float]:
    """Return the range of a signal, from its bits and its declared range."""
    if signal.is_float:
        low, high = -inf, inf
    else:
        bits = signal.length - bool(signal.is_signed)
        raw = (-(1 << bits) if signal.is_signed else 0, (1 << bits) - 1)
        low, high = sorted(each * signal.scale + signal.offset for each in raw)
    least = low if signal.minimum is None else max(low, signal.minimum)
    most = high if signal.maximum is None else min(high, signal.maximum)
    return least, most


class Codec:
    """Encodes and decodes the messages of a DBC file."""

    def __init__(self, mapping: DbcMapping) -> None:
        self.messages = {each.name: each for each in mapping.database.messages}
        self.by_frame = {
            (each.frame_id, each.is_extended_frame): each for each in mapping.database.messages
        }
        self.defaults = {
            name: {each.name: _default(each) for each in message.signals}
            for name, message in self.messages.items()
        }

    def signal(self, where: Signal) -> Any:
        """Return a signal of the DBC file."""
        return self.messages[where[0]].get_signal_by_name(where[1])

    def encode(self, name: str, values: Mapping[str, float]) -> Message:
        """Return a message; signals not given have their initial value."""
        message = self.messages[name]
        try:
            data = message.encode({**self.defaults[name], **values}, strict=True)
        except DAMAGED as error:
            raise ProtocolError(f"{name} cannot be sent: {error}.") from error
        return frame_of(
            message.frame_id, data, extended=message.is_extended_frame, fd=message.is_fd
        )

    def decode(
        self, frame: Message, names: Iterable[str]
    ) -> tuple[str, Mapping[str, float]] | None:
        """Return name and values of a frame, or None if it is none of the named messages."""
        message = self.by_frame.get((frame.arbitration_id, frame.is_extended_id))
        if message is None or message.name not in names:
            return None
        if frame.is_remote_frame or frame.is_error_frame or frame.is_fd > message.is_fd:
            return None
        try:
            return message.name, message.decode(bytes(frame.data), **AS_NUMBERS)  # type: ignore[return-value]
        except DAMAGED as error:
            raise ProtocolError(f"{message.name} breaks its DBC file: {error}.") from error


def _default(signal: Any) -> float:
    low, high = range_of(signal)
    start = signal.initial if isinstance(signal.initial, int | float) else 0.0
    return float(min(max(start, low), high))


class DbcMaster(Master):
    """Commands one drive, or reads one sensor; see the contract's `Master`."""

    def __init__(self, settings: Settings) -> None:
        self._mapping = mapping = mapping_of(settings)
        periods = {
            name: mapping.cycles.get(where[0], settings.period)
            for name, (where, _) in mapping.channels.items()
        }
        super().__init__(settings, periods, 0.0)
        self.shows_stop = mapping.state is not None or mapping.error is not None
        self._codec = Codec(mapping)
        self._heard = {where[0] for where, _ in mapping.channels.values()}
        self._heard |= {where[0] for where in (mapping.state, mapping.error) if where}
        self._per_unit = torque_of_command(mapping, settings)
        if mapping.command is not None:
            where, column = mapping.command
            ends = [
                self._per_unit * column.gain * (end - column.offset)
                for end in range_of(self._codec.signal(where))
            ]
            self.torque_range = (min(ends), max(ends))

    def configure(self) -> Sequence[Step]:
        """Return the step that waits for a report."""
        return [Step("Wait for a report", (), self._reports, 1.0, self.poll())]

    def clear(self) -> Sequence[Step]:
        """Return the step with the signals of `clear`."""
        if not self._mapping.phases["clear"]:
            return []
        frames = self._send("clear", 0.0)
        return [Step("Clear the fault", frames, self._shows(Mode.FAULT, False), 1.0, frames)]

    def enable(self) -> Sequence[Step]:
        """Return the step with the signals of `enabled` and zero torque."""
        if self._mapping.command is None:
            return []
        frames = self._send("enabled", 0.0)
        confirmed = self._shows(Mode.ENABLED, True) if self._mapping.state else None
        return [Step("Zero torque", frames, confirmed, 1.0, frames)]

    def command(self, tau_m: float) -> Sequence[Message]:
        """Return the frames with the torque and the signals of `enabled`; none for a sensor."""
        return self._send("enabled", tau_m)

    def commanded(self, frame: Message) -> float | None:
        """Return the torque in a command."""
        if self._mapping.command is None:
            return None
        (message, signal), column = self._mapping.command
        found = self._codec.decode(frame, (message,))
        if found is None or signal not in found[1]:
            return None
        return self._per_unit * column.gain * (found[1][signal] - column.offset)

    def poll(self) -> Sequence[Message]:
        """Return the frames with zero torque and the signals of `disabled`; none for a sensor."""
        return self._send("disabled", 0.0)

    def disable(self) -> Sequence[Message]:
        """Return the frames with zero torque and the signals of `disabled`."""
        return self._send("disabled", 0.0)

    def decode(self, frame: Message) -> Update | None:
        """Decode a mapped message."""
        found = self._codec.decode(frame, self._heard)
        if found is None:
            return None
        message, values = found
        channels = {}
        for name, ((where, signal), column) in self._mapping.channels.items():
            if where == message and signal in values:
                channels[name] = column.gain * (values[signal] - column.offset)
        error = _of(self._mapping.error, message, values)
        text = f"error {error}" if error else ""
        mode = self._mode(message, values)
        if error and self._mapping.state is None:
            mode = Mode.FAULT
        return Update(channels, mode, error, text)

    def _mode(self, message: str, values: Mapping[str, float]) -> Mode | None:
        shown = _of(self._mapping.state, message, values)
        if shown is None:
            return None
        modes = (mode for mode, numbers in self._mapping.modes.items() if shown in numbers)
        return next(modes, Mode.FAULT)

    def _send(self, phase: str, tau_m: float) -> list[Message]:
        if self._mapping.command is None:
            return []
        (message, signal), column = self._mapping.command
        if not isfinite(tau_m):
            raise ProtocolError(f"{signal} must be a finite number, got {tau_m}.")
        made: dict[str, dict[str, float]] = defaultdict(dict)
        made[message][signal] = tau_m / self._per_unit / column.gain + column.offset
        for (name, fixed), value in self._mapping.phases[phase].items():
            made[name][fixed] = value
        return [self._codec.encode(name, values) for name, values in made.items()]

    def _shows(self, mode: Mode, wanted: bool) -> Any:
        def confirmed(frame: Message) -> bool:
            update = self.decode(frame)
            return (
                update is not None and update.mode is not None and (update.mode is mode) == wanted
            )

        return confirmed

    def _reports(self, frame: Message) -> bool:
        return self.decode(frame) is not None


def _of(where: Signal | None, message: str, values: Mapping[str, float]) -> int | None:
    if where is None or where[0] != message or where[1] not in values:
        return None
    return int(values[where[1]])
