"""One bus for several joints, each with its own link."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import final

import can

from cjt_gym.canbus.link import KEPT, Arrival, Link
from cjt_gym.errors import HardwareError

Frames = Sequence[can.Message]


@final
class SharedLink:
    """A link that several joints share; each has a tap."""

    def __init__(self, joints: int, dt: float, link: Link | None = None) -> None:
        """Share a link."""
        self._link = link
        self.taps = tuple(Tap(self) for _ in range(joints))
        self._dt = dt
        self._owners: dict[tuple[int, bool, bytes], tuple[Tap, ...]] = {}
        self._kept: list[Callable[[], Frames]] = []
        self._fed = -float("inf")
        self._waiting: list[can.Message] | None = None

    @property
    def link(self) -> Link:
        """Connection to the bus."""
        if self._link is None:
            raise HardwareError("The joint is not connected. Call connect() first.")
        return self._link

    def open(self, link: Link) -> None:
        """Share a link."""
        self._link = link

    def close(self) -> None:
        """Close the shared link, if there is one."""
        if self._link is not None:
            self._link.close()
        self._link = None

    def keep_alive(self, frames: Callable[[], Frames]) -> None:
        """Send these frames once per control period during waits, until `let_go`."""
        self._kept.append(frames)

    def let_go(self) -> None:
        """Stop sending during waits."""
        self._kept.clear()

    def gather(self) -> None:
        """Hold all frames back until `flush`."""
        self._waiting = []

    def flush(self) -> None:
        """Send the frames held back; those for all nodes, such as SYNC, once and last."""
        waiting, self._waiting = self._waiting or [], None
        self.link.send(_once(waiting))

    def send(self, messages: Frames) -> None:
        """Send frames, or hold them back."""
        if self._waiting is None:
            self.link.send(messages)
        else:
            self._waiting += messages

    def wait_until(self, t: float) -> None:
        """Wait until a time [s], keeping drives alive meanwhile."""
        while self._kept and (due := max(self._fed + self._dt, self.link.now())) <= t:
            self.link.wait_until(due)
            self.link.send(_once([frame for frames in self._kept for frame in frames()]))
            self._fed = due
        self.link.wait_until(t)

    def deliver(self) -> None:
        """Deliver what has arrived to the joints that it is from, or to all if that is unknown."""
        for arrival in self.link.receive():
            for tap in self._takers(arrival.message):
                tap.inbox.append(arrival)

    def _takers(self, message: can.Message) -> tuple[Tap, ...]:
        """Return the joints a frame is from; in some protocols the first byte names the drive."""
        if message.is_error_frame or len(self.taps) == 1:
            return self.taps
        key = (message.arbitration_id, message.is_extended_id, bytes(message.data[:1]))
        known = self._owners.get(key)
        if known is None:
            known = tuple(tap for tap in self.taps if tap.claims(message))
            if not known:
                return self.taps
            self._owners[key] = known
        return known


@final
class Tap:
    """The link of one of several joints.

    Attributes:
        inbox: Frames that this joint has not read yet.
        claims: Returns whether a frame is from a node of this joint.
    """

    def __init__(self, shared: SharedLink) -> None:
        self._shared = shared
        self.wait_until, self.send = shared.wait_until, shared.send
        self.inbox: deque[Arrival] = deque(maxlen=KEPT)
        self.claims: Callable[[can.Message], bool] = lambda message: True

    @property
    def stamps(self) -> str:
        """Clock of the arrival times."""
        return self._shared.link.stamps

    def now(self) -> float:
        """Return the time [s]."""
        return self._shared.link.now()

    def receive(self) -> list[Arrival]:
        """Return all frames since the last call of this joint."""
        self._shared.deliver()
        found = list(self.inbox)
        self.inbox.clear()
        return found


def _once(messages: Frames) -> Frames:
    """Return frames without those that are repeated later."""
    last = {_key(message): k for k, message in enumerate(messages)}
    return [messages[k] for k in sorted(last.values())]


def _key(message: can.Message) -> tuple[object, ...]:
    """Return a key that repeated frames share; only frames for all nodes are ever the same."""
    return (
        message.arbitration_id,
        message.is_extended_id,
        message.is_remote_frame,
        bytes(message.data),
    )
