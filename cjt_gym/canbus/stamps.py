"""Arrival times of frames, by the clock of the interface or else the machine's."""

from __future__ import annotations

import math
from typing import Final, final

RECEPTION: Final = "reception"
STAMPS: Final = ("auto", "interface", RECEPTION)
"""What may be asked for: `interface` takes the stamps of any, `auto` those of `CLOCKS`."""
CLOCKS: Final = {
    **dict.fromkeys(
        ("etas", "gs_usb", "ixxat", "kvaser", "neovi", "nican", "nixnet", "pcan", "vector"),
        "hardware",
    ),
    "socketcan": "kernel",
}
"""Whose clock stamps the frames of python-can's interfaces, finer than 0.1 ms; others stamp late,
coarsely, or with the time at which the program fetches a frame."""
WINDOW: Final = 0.25
"""Time over which two clocks are held against each other [s]: a deviation of 100 ppm moves them by
25 us within it."""
JUMP: Final = 0.1
"""A frame that seems to have waited for longer tells of a clock that was set [s]."""


def clock_of(interface: str, asked: str) -> StampClock:
    """Return the clock of an interface's stamps if they are asked for; see `STAMPS`."""
    own = CLOCKS.get(interface, "interface" if asked == "interface" else RECEPTION)
    return StampClock(RECEPTION if asked == RECEPTION else own)


@final
class StampClock:
    """Converts stamps of another clock to the machine's.

    A frame is never received before it is stamped. So the least difference seen recently is the
    offset between the clocks, and any excess is the time a frame waited to be received.

    Attributes:
        kind: Kind of the clock; `RECEPTION` until its first stamp.

    Example:
        >>> clock = StampClock("hardware")
        >>> [round(clock.arrived(*times), 6) for times in ((5.0, 2.0), (5.001, 2.003))]
        [2.0, 2.001]
    """

    def __init__(self, kind: str) -> None:
        self.kind = RECEPTION
        self._kind = kind
        self._before = self._least = math.inf
        self._begun = -math.inf

    def arrived(self, stamp: float, received: float) -> float:
        """Return the arrival time of a frame on the machine's clock [s].

        Args:
            stamp: Time on the other clock [s]; NaN or <= 0 if there is none.
            received: Time of reception [s].
        """
        if self._kind == RECEPTION or not stamp > 0.0:
            return received
        self.kind = self._kind
        apart = received - stamp
        least, since = min(self._least, self._before), received - self._begun
        if since > 2.0 * WINDOW or abs(apart - least) > JUMP:
            self._before = self._least = apart
            self._begun = received
        elif since > WINDOW:
            self._before, self._least, self._begun = self._least, apart, received
        self._least = min(self._least, apart)
        return stamp + min(self._least, self._before)
