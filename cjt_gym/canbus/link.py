"""Connection to the nodes: frames out, frames in with their arrival times, and a clock."""

from __future__ import annotations

import contextlib
import gc
import os
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol, final

import can
from threadpoolctl import threadpool_limits

from cjt_gym.canbus.settings import BusSettings
from cjt_gym.canbus.stamps import RECEPTION, StampClock, clock_of
from cjt_gym.errors import ConfigurationError, HardwareError

SPIN = 3e-5
"""Time before a deadline from which it is awaited without sleeping [s]."""
SWITCH = 2e-4
"""Time after which the interpreter lets another thread run while the loop runs [s]."""

KEPT = 20_000
"""Frames that are kept while none is fetched; a loop fetches them at every control step."""
PTYS = "/dev/pts/"
"""Where pseudo-terminals are, behind which no adapter has to boot."""


Supervisor = Callable[[float], float | None]
"""Looks at a loop at a time [s]; returns when it is to look again, if it knows."""


class Arrival(NamedTuple):
    """A frame and its arrival time on the clock of its link [s]."""

    t: float
    message: can.Message


class Line(Protocol):
    """A bus with its clock, as a joint sees it."""

    @property
    def stamps(self) -> str:
        """Clock of the arrival times."""

    def now(self) -> float:
        """Return the time [s]."""

    def wait_until(self, t: float) -> None:
        """Wait until a time [s]; return at once if it has passed."""

    def send(self, messages: Sequence[can.Message]) -> None:
        """Send frames.

        Raises:
            HardwareError: The bus rejects them.
        """

    def receive(self) -> list[Arrival]:
        """Return all frames since the last call, in order of arrival.

        Raises:
            HardwareError: The bus is lost.
        """


class Link(Line, Protocol):
    """A bus with its clock and a look at the loop."""

    def watch(self, supervise: Supervisor, every: float) -> None:
        """Call `supervise(now)` at the time that it returned, or once in `every` seconds.

        Whatever the loop does.
        """

    def close(self) -> None:
        """Release the bus."""


@final
class BusLink:
    """A link over a python-can bus, with a receiving thread and the machine's clock.

    The thread takes every frame as it arrives and notes the time, so that none is lost or seems too
    recent while the loop computes. If the interface stamps frames, its stamps give the time.
    """

    def __init__(self, bus: can.BusABC, clock: StampClock | None = None) -> None:
        """Begin to receive; without a clock, frames count as arrived when they are received."""
        self._bus = bus
        self._clock = clock or StampClock(RECEPTION)
        self._inbox: deque[Arrival] = deque(maxlen=KEPT)
        self._failure: Exception | None = None
        self._supervise: Supervisor = lambda now: None
        self._every = 0.05
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="can-receive", daemon=True)
        self._thread.start()

    @property
    def stamps(self) -> str:
        """Clock of the arrival times, from the frames so far."""
        return self._clock.kind

    def now(self) -> float:
        """Return the machine's monotonic time [s]."""
        return time.perf_counter()

    def wait_until(self, t: float) -> None:
        """Sleep until shortly before a time [s], then busy-wait."""
        remaining = t - time.perf_counter()
        if remaining > SPIN:
            time.sleep(remaining - SPIN)
        while time.perf_counter() < t:
            pass

    def send(self, messages: Sequence[can.Message]) -> None:
        """Send frames."""
        try:
            for message in messages:
                self._bus.send(message)
        except (can.CanError, OSError, ValueError) as error:
            raise HardwareError(f"The bus does not take a frame: {error}.") from error

    def receive(self) -> list[Arrival]:
        """Return all frames since the last call, in order of arrival."""
        if self._failure is not None:
            raise HardwareError(f"The bus is lost: {_reason(self._failure)}.") from self._failure
        inbox = self._inbox
        return [inbox.popleft() for _ in range(len(inbox))]

    def watch(self, supervise: Supervisor, every: float) -> None:
        """Call `supervise(now)` when it is due, from the receiving thread."""
        self._every, self._supervise = every, supervise

    def close(self) -> None:
        """Stop the thread and shut the bus down."""
        self._stopped.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(1.0)
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()

    def _run(self) -> None:
        look = now = time.perf_counter()
        while not self._stopped.is_set():
            try:
                message = self._bus.recv(max(look - now, 0.0))
            except Exception as error:  # whatever a driver raises, the bus is lost
                self._failure = error
                message = None
                self._stopped.wait(self._every)
            now = time.perf_counter()
            if message is not None:
                self._inbox.append(Arrival(self._clock.arrived(message.timestamp, now), message))
            if now >= look:
                look = self._supervise(now) or now + self._every


def _reason(error: Exception) -> str:
    """Return why a driver failed, without the traceback that some of them make of it."""
    cause = error.__cause__ or error.__context__ or error
    return str(cause).strip().splitlines()[-1] if str(cause).strip() else type(cause).__name__


def open_link(settings: BusSettings) -> BusLink:
    """Return the link over the bus that a configuration describes; see `open_bus`."""
    return BusLink(open_bus(settings), clock_of(settings.interface, settings.stamps))


def open_bus(settings: BusSettings) -> can.BusABC:
    """Return the python-can bus that a configuration describes."""
    options = dict(settings.options)
    if settings.interface == "socketcand":
        host, port = settings.host, settings.port
        _probe(host, port)
        options = {"host": host, "port": port, "tcp_tune": sys.platform == "linux"} | options
    if settings.interface == "slcan" and os.path.realpath(settings.channel).startswith(PTYS):
        options = {"sleep_after_open": 0.0} | options
    if settings.fd:
        options["fd"] = True
    if settings.bitrate is not None:
        options["bitrate"] = settings.bitrate
    try:
        return can.Bus(interface=settings.interface, channel=settings.channel, **options)
    except (
        can.CanError,
        OSError,
        ValueError,
        TypeError,
        ImportError,
        NotImplementedError,
    ) as error:
        raise ConfigurationError(
            f"The bus {settings.interface} {settings.channel} of {settings.owner} cannot be "
            f"opened: {error}. Check [bus], and that it is there."
        ) from error


def _probe(host: str, port: int) -> None:
    """Raise an error if no server listens; python-can's client would try for ten seconds."""
    try:
        socket.create_connection((host, port), timeout=2.0).close()
    except OSError as error:
        raise ConfigurationError(
            f"No socketcand server answers at {host}:{port}: {error}. Start the daemon, or  "
            "cjt-gym emulate CONFIG.toml  in another terminal."
        ) from error


@contextlib.contextmanager
def quiet_machine(priority: int | None) -> Iterator[None]:
    """Disable the garbage collector within, and run at real-time priority.

    Args:
        priority: Priority of SCHED_FIFO from 1 to 99; None changes nothing.

    Raises:
        ConfigurationError: The priority is not permitted.
    """
    if priority is not None:
        try:
            _schedule(os.SCHED_FIFO, priority)
        except (AttributeError, OSError) as error:
            raise ConfigurationError(
                f"priority {priority} of [control] is not permitted: {error}. Grant it (ulimit -r, "
                "CAP_SYS_NICE), or leave it out."
            ) from error
    collects, interval = gc.isenabled(), sys.getswitchinterval()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(SWITCH)
    try:
        with threadpool_limits(1):  # small matrices are not worth waking other threads
            yield
    finally:
        sys.setswitchinterval(interval)
        gc.unfreeze()
        if collects:
            gc.enable()
        if priority is not None:
            _schedule(os.SCHED_OTHER, 0)


def _schedule(policy: int, priority: int) -> None:
    for thread in threading.enumerate():
        os.sched_setscheduler(thread.native_id or 0, policy, os.sched_param(priority))
