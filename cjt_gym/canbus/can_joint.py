"""A joint in the loop: its states, its part of every control period, its faults."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Mapping
from typing import NoReturn, final

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.dialogue import LOOKS, Dialogue
from cjt_gym.canbus.link import Link
from cjt_gym.canbus.measuring import Sense
from cjt_gym.canbus.nodes import Nodes
from cjt_gym.canbus.run_record import JointRecord, RunRecord, Sample
from cjt_gym.canbus.safety import Fault, Guard, HardwareFault, Seen, State
from cjt_gym.canbus.timing import Timing
from cjt_gym.errors import HardwareError, ProtocolError
from cjt_gym.plant import Limits, Measurement


@final
class CanJoint:
    """One joint on a bus, run by the loop of `CanArm`.

    A control period is `send`, `went_out` once the frames of all joints are on the bus, and `hear`
    at the deadline.

    Attributes:
        config: Configuration of the joint.
        nodes: Its nodes with their latest values.
        sense: Completes what is measured.
        guard: State, limits and faults.
        timing: Timing of the latest run.
        record: Its part of the record.
        due: Time at which the next command is due [s].
        on_fault: Called once with the fault that ended a run, from the thread that found it.
    """

    def __init__(
        self,
        config: HardwareConfig,
        link: Link,
        lock: threading.RLock,
        record: RunRecord | None = None,
    ) -> None:
        """Prepare, without touching the bus."""
        self.config, self.link = config, link
        self.nodes = Nodes(config)
        self.sense = Sense(config, frozenset(self.nodes.latest))
        self.guard = Guard(config.limits, config.dt, config.soft, config.overrun, config.missed)
        self.timing = Timing()
        self.on_fault: Callable[[Fault], None] | None = None
        self._talk = Dialogue(link, self.nodes)
        self._lock = lock
        self.record = JointRecord(config, self.sense, record)
        self._begin = self.due = math.inf
        self._k = 0
        self._full: dict[str, float] = {}
        self._sent = self._tau_ref = math.nan
        self._now_sent = self._round_trip = 0.0

    # ---- what it is
    @property
    def limits(self) -> Limits:
        """Limits of commands and measurements."""
        s = self.config.limits
        low, high = self.nodes.drive.master.torque_range
        return Limits(tau=min(s.tau, -low, high), dq_m=s.dq_m, tau_joint=s.tau_joint)

    @property
    def state(self) -> State:
        """State of the joint."""
        return self.guard.state

    @property
    def sent(self) -> float:
        """Latest commanded motor torque [N m]; 0 before a run and after a fault."""
        return self.guard.commanded if self.state is State.RUNNING else 0.0

    @property
    def lateness(self) -> float:
        """Lateness of the last command [s]."""
        return self.timing.lateness[-1] if self.timing.lateness else 0.0

    def age(self) -> float:
        """Return the age of the motor's angle [s]."""
        return self.link.now() - self.nodes.latest["q_m"].t

    # ---- before a run
    def connect(self) -> None:
        """Configure the nodes, and wait for a value of every channel."""
        self.link.watch(self._supervise, self.config.dt / LOOKS)
        self._talk.set_up()
        self.guard.move(State.IDLE)

    def measured_delay(self) -> dict[str, float]:
        """Measure the delays of bus and loop without moving the joint [s].

        The keys are the simulator's effects; see `Timing.delay`.
        """
        if self.state not in (State.IDLE, State.ARMED):
            raise HardwareError(
                f"The delay is measured before a run, while the joint is idle or armed; it is "
                f"{self.state.value}."
            )
        return self._talk.rehearse().delay(self.config.dt)

    def arm(self) -> None:
        """Arm the joint without moving it; see `CanArm.arm`."""
        self._talk.make_ready(self.config.drive.settings.watchdog)
        seen = self._seen(self._completed(), 0.0)
        trouble = self.nodes.trouble(is_on=False) or self.guard.check(seen)
        if trouble is not None:
            raise HardwareError(f"The joint cannot be armed: {trouble.text}")
        self.guard.move(State.ARMED)

    def reset(self) -> Measurement:
        """Return the measurement for the start of a run."""
        if self.state is not State.ARMED:
            raise HardwareError(
                f"The joint must be armed before it is moved, it is {self.state.value}. Call "
                "arm(), or give --arm."
            )
        self._talk.listen()
        self.sense.zero(self.nodes.values())
        self._full = self._completed()
        self._k = 0
        return self.sense.measurement(self._full, 0.0)

    # ---- a run
    def start(self, tau_ref: float) -> None:
        """Start the record and switch the drive on with zero torque; `begin` must follow."""
        self._tau_ref = tau_ref if math.isfinite(tau_ref) else self._tau_ref
        self.timing, self._round_trip = Timing(), 0.0
        hot = "temperature" in self.nodes.latest
        self.record.begin(self._tau_ref, hot, self.link.stamps)
        self.guard.move(State.RUNNING)
        self.due = math.inf
        try:
            self._talk.switch_on()
        except HardwareError as error:
            self.fail("drive", str(error))
        except BaseException as error:  # Ctrl-C: the drive may be on already
            self.abandon(error)
            raise

    def begin(self, t: float) -> None:
        """Start counting control steps at a time [s]."""
        with self._lock:
            self.nodes.hear(self.link.receive())
            for node in self.nodes.all:
                node.forgive()
            self._begin = self.due = t

    def send(self, command: float, tau_ref: float) -> None:
        """Send a motor torque [N m], limited; the reference torque goes to the record."""
        self._tau_ref = tau_ref if math.isfinite(tau_ref) else self._tau_ref
        if self.state is not State.RUNNING:
            self._raise()
        allowed = self.guard.late(self.link.now() - self.due) or self.guard.allowed(command)
        if isinstance(allowed, Fault):
            self._end(allowed)
        self.fade(allowed)

    def fade(self, torque: float) -> None:
        """Send a torque without limiting it, such as one that fades to zero [N m]."""
        with self._lock:
            self._raise_if_tripped()
            self.timing.lateness.append(max(self.link.now() - self.due, 0.0))
            try:
                low, high = self.nodes.drive.master.torque_range
                self.link.send(self.nodes.command(min(max(torque, low), high)))
            except (HardwareError, ProtocolError) as error:
                self.fail("bus_off", str(error))
            self._now_sent = torque

    def went_out(self) -> None:
        """Note what was sent and set the next deadline."""
        with self._lock:
            self._raise_if_tripped()
            self._sent = self.link.now()
            self.timing.ages.append(self.age())
            try:
                self._note(self._now_sent, self.lateness)
            except OSError as error:
                self.fail("record", f"The record cannot be written: {error}.")
            self._k += 1
            self.due = self._begin + self._k * self.config.dt

    def hear(self) -> Measurement:
        """Read what has arrived and return the measurement, checked."""
        with self._lock:
            self._raise_if_tripped()
            try:
                arrivals = self.link.receive()
            except HardwareError as error:
                self.fail("bus_off", str(error))
            self._round_trip = self.timing.answered(self._sent, arrivals)
            trouble = self.nodes.hear(arrivals)
            full = self._completed()
            seen = self._seen(full, self.config.dt)
            trouble = trouble or self.nodes.trouble(is_on=True) or self.guard.check(seen)
            finite = all(math.isfinite(full[name]) for name in self.sense.measured)
            if trouble is None or (finite and trouble.kind != "corrupt"):
                self._full = full  # what is corrupt stays out of the record
            if trouble is not None:
                self._end(trouble)
            return self.sense.measurement(self._full, self._k * self.config.dt)

    def _completed(self) -> dict[str, float]:
        return self.sense.complete(self.nodes.values(), self.nodes.latest["q_m"].t)

    def _seen(self, full: Mapping[str, float], elapsed: float) -> Seen:
        reported = self.nodes.latest
        known = {k: v for k, v in full.items() if k in reported or math.isfinite(v)}
        return Seen(known, self.nodes.ages(self.link.now()), elapsed)

    # ---- how it ends
    def end(self) -> None:
        """Switch the drive off at the end of a run, and complete the record."""
        with self._lock:
            self._raise_if_tripped()
            self.link.send(self.nodes.drive.master.disable())
            self.guard.move(State.ARMED)
            self.record.end(self.timing)

    def switch_off(self) -> None:
        """Command the drive off once more."""
        self._talk.switch_off()

    def close(self, error: BaseException | None) -> None:
        """Complete the record; a run in progress ends at once, as on an exception."""
        if self.state is State.DISCONNECTED:
            return
        try:
            if error is not None and self.state is not State.FAULT:
                self.abandon(error)
        finally:
            self.record.end(self.timing)
            if self.state is not State.FAULT:
                self.guard.state = State.DISCONNECTED

    def abandon(self, error: BaseException) -> None:
        """End a run at once because of an exception, as after a fault."""
        interrupted = isinstance(error, KeyboardInterrupt | SystemExit)
        kind = "interrupt" if interrupted else "exception"
        text = f"{type(error).__name__}: {error}".rstrip(".")
        self.trip(Fault(kind, f"{text}.", self.link.now()))
        self._talk.repeat_off()

    def fail(self, kind: str, text: str) -> None:
        """End the run with a fault."""
        self.trip(Fault(kind, text, self.link.now()))
        self._raise_if_tripped()

    def trip(self, fault: Fault) -> None:
        """Switch off because of a fault and complete the record; only the first call acts."""
        with self._lock:
            if self.state not in (State.ARMED, State.RUNNING):
                return
            self._talk.switch_off()
            self.guard.trip(fault)
            if self._full:
                with contextlib.suppress(OSError):
                    self._note(0.0, 0.0)
            with contextlib.suppress(HardwareError):  # the fault matters more
                self.record.end(self.timing, fault={"kind": fault.kind, "text": fault.text})
            if self.on_fault is not None:
                self.on_fault(fault)

    def _supervise(self, now: float) -> None:
        """Remove the torque if the loop does not return; called regularly."""
        late = self.guard.late(now - self.due)
        if self.state is State.RUNNING and late is not None:
            self.trip(late)

    def _end(self, fault: Fault) -> NoReturn:
        self.trip(fault)
        self._raise()

    def _raise_if_tripped(self) -> None:
        if self.state is State.FAULT:
            self._raise()

    def _raise(self) -> NoReturn:
        """Raise the fault that ended the run; `CanArm` then commands the drives off again."""
        if self.guard.fault is not None:
            raise HardwareFault(self.guard.fault)
        raise HardwareError(
            f"A joint that is {self.state.value} does not take commands. Call connect(), arm() and "
            "reset() first."
        )

    def _note(self, torque: float, lateness: float) -> None:
        self.record.note(
            Sample(self._full, torque, self._tau_ref, self.age(), lateness, self._round_trip)
        )
