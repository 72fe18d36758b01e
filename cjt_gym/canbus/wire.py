"""An emulated bus between a master and its nodes: latency, jitter, loss and load."""

from __future__ import annotations

import heapq
from typing import NamedTuple, final

import can
import numpy as np

from cjt_gym.canbus.frame_bits import wire_time
from cjt_gym.canbus.settings import EmulatorSettings

OVERHEAD_BITS = 67
"""Bits of a frame with extended identifier besides its data, without stuff bits (ISO 11898-1)."""
BITRATE = 1e6
"""Bit rate by which the time of a frame is reckoned where other nodes load the bus [bit/s]."""


class Due(NamedTuple):
    """A frame on its way: arrival time [s], and what orders frames of the same time."""

    t: float
    order: int
    message: can.Message


@final
class Medium:
    """The wire that all frames of a bus share: one at a time, each for as long as its bits take."""

    def __init__(self, bitrate: float, data_bitrate: float) -> None:
        self.bitrate, self.data_bitrate = bitrate, data_bitrate
        self.free = 0.0

    def carry(self, t: float, message: can.Message) -> float:
        """Return when a frame that is ready at a time [s] has been sent."""
        time = wire_time(message, self.bitrate, self.data_bitrate)
        self.free = max(self.free, t) + time
        return self.free


@final
class Wire:
    """One direction of a bus; frames keep their order."""

    def __init__(self, settings: EmulatorSettings, seed: int, medium: Medium | None = None) -> None:
        """Make an empty wire."""
        self.settings = settings
        self._medium = medium
        self._random = np.random.default_rng(seed)
        self._on_way: list[Due] = []
        self._order = 0
        self._latest = 0.0

    def put(self, t: float, message: can.Message) -> None:
        """Send a frame at a time [s], unless it is lost."""
        s = self.settings
        if s.loss and self._random.random() < s.loss:
            return
        delay = s.latency
        if s.jitter:
            delay += self._random.exponential(s.jitter)
        if s.load:
            delay += self._waiting(message)
        if self._medium is not None:
            t = self._medium.carry(t, message)
        self._latest = max(self._latest, t + delay)
        self._order += 1
        heapq.heappush(self._on_way, Due(self._latest, self._order, message))

    def _waiting(self, message: can.Message) -> float:
        """Return the time a frame waits for others [s]: a queue with constant service time.

        Its mean is that of an M/D/1 queue, load / (2 (1 - load)) frames.
        """
        frame = (OVERHEAD_BITS + 8 * len(message.data)) / BITRATE
        load = self.settings.load
        return float(frame + self._random.exponential(frame * load / (2.0 * (1.0 - load))))

    def next(self) -> float:
        """Return when the next frame arrives [s]; infinity without one."""
        return self._on_way[0].t if self._on_way else np.inf

    def take(self, t: float) -> list[Due]:
        """Return the frames that have arrived by a time [s]."""
        found = []
        while self._on_way and self._on_way[0].t <= t:
            found.append(heapq.heappop(self._on_way))
        return found
