"""A bus that only collects frames, for libraries that send on a bus."""

from __future__ import annotations

from dataclasses import dataclass, field

from can import Message


@dataclass
class _Cycle:
    frame: Message
    period: float
    due: float
    on: bool = True

    def stop(self) -> None:
        self.on = False

    def modify_data(self, frame: Message) -> None:
        self.frame = frame


@dataclass
class Outbox:
    """A bus for `canopen`, in which frames wait until the firmware sends them."""

    now: float = 0.0
    waiting: list[Message] = field(default_factory=list)
    cycles: list[_Cycle] = field(default_factory=list)

    def send(self, frame: Message) -> None:
        """Keep a frame."""
        self.waiting.append(frame)

    def send_periodic(self, frame: Message, period: float) -> _Cycle:
        """Keep a frame to be sent every `period` [s]."""
        self.cycles.append(_Cycle(frame, period, self.now + period))
        return self.cycles[-1]

    def take(self) -> list[Message]:
        """Return the frames that are waiting or due."""
        self.cycles = [cycle for cycle in self.cycles if cycle.on]
        for cycle in self.cycles:
            if self.now >= cycle.due:
                cycle.due = max(cycle.due + cycle.period, self.now)
                self.waiting.append(cycle.frame)
        taken, self.waiting = self.waiting, []
        return taken
