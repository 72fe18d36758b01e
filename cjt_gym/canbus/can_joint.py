"""A joint in the loop: its states, its part of every control period, its faults."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable
from typing import NoReturn, final

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.dialogue import Dialogue
from cjt_gym.canbus.link import Line
from cjt_gym.canbus.measuring import Sense
from cjt_gym.canbus.nodes import Nodes
from cjt_gym.canbus.run_record import JointRecord, RunRecord
from cjt_gym.canbus.safety import Fault, Guard, HardwareFault, State
from cjt_gym.canbus.timing import Timing
from cjt_gym.errors import CommandError, HardwareError, ProtocolError
from cjt_gym.plant import Limits, Measurement


@final
class CanJoint:
    """One joint on a bus, run by the loop of `CanArm`.

    A control period is `allowed`, `send`, `went_out` once the frames of all joints are on the bus,
    and `hear` at the deadline.

    Attributes:
        config: Configuration of the joint.
        nodes: Its nodes with their latest values.
        sense: Completes what is measured.
        guard: State, limits and faults.
        timing: Timing of the latest run.
        record: Its part of the record.
        on_fault: Called once with the fault that ended a run, from the thread that found it.
    """

    def __init__(
        self,
        config: HardwareConfig,
        link: Line,
        lock: threading.RLock,
        record: RunRecord | None = None,
    ) -> None:
        """Prepare, without touching the bus."""
        self.config, self.link = config, link
        self.nodes = Nodes(config)
        self.sense = Sense(config, frozenset(self.nodes.latest))
        self.guard = Guard(
            config.limits,
            config.dt,
            config.soft,
            config.overrun,
            config.missed,
            self.nodes.latest.keys(),
        )
        self.timing = Timing()
        self.on_fault: Callable[[Fault], None] | None = None
        self._talk = Dialogue(link, self.nodes)
        self._angle = self.nodes.latest["q_m"]
        self._angle_before = -math.inf  # time of the report before [s]
        self._lock = lock
        self.record = JointRecord(config, self.sense, record)
        self._full: dict[str, float] = {}
        self._sent = self._tau_ref = math.nan
        self._torque = self._round_trip = 0.0

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
        return self.link.now() - self._angle.t

    # ---- before a run
    def connect(self) -> None:
        """Configure the nodes, and wait for a value of every channel."""
        self._talk.set_up()
        self.guard.move(State.IDLE)

    def rehearse(self, timing: Timing, sent: float) -> None:
        """Read the answers to a poll that went out at a time [s], and note their timing."""
        arrivals = self.link.receive()
        timing.answered(sent, arrivals)
        self.nodes.hear(arrivals)
        timing.ages.append(self.age())

    def arm(self) -> None:
        """Arm the joint without moving it; see `CanArm.arm`."""
        self._talk.make_ready(self.config.drive.settings.watchdog)
        trouble = self.nodes.trouble(False, self.link.now())
        trouble = trouble or self.guard.check(self._completed(), 0.0)
        self._angle_before = self._angle.t
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
        return self.sense.measurement(self._full, 0.0)

    # ---- a run
    def start(self, tau_ref: float) -> None:
        """Start the record and switch the drive on with zero torque; `begin` must follow."""
        self.follow(tau_ref)
        self.timing, self._round_trip = Timing(), 0.0
        hot = "temperature" in self.nodes.latest
        self.record.begin(self._tau_ref, hot, self.link.stamps)
        self.guard.move(State.RUNNING)
        try:
            self._talk.switch_on()
        except HardwareError as error:
            self.fail("drive", str(error))
        except BaseException as error:  # Ctrl-C: the drive may be on already
            self.abandon(error)
            raise

    def begin(self) -> None:
        """Forget what was reported while the drives were switched on."""
        self.nodes.hear(self.link.receive())
        for node in self.nodes.all:
            node.forgive()

    def follow(self, tau_ref: float) -> None:
        """Take a reference torque for the record [N m]; NaN leaves it as it is."""
        if math.isfinite(tau_ref):
            self._tau_ref = tau_ref

    def allowed(self, command: float, late: Fault | None) -> float:
        """Return the motor torque that may be sent for a command [N m], which may be too late."""
        if self.guard.state is not State.RUNNING:
            self._raise()
        allowed = late or self.guard.allowed(command)
        if isinstance(allowed, Fault):
            self._end(allowed)
        return allowed

    def send(self, torque: float) -> None:
        """Send a torque without limiting it [N m]."""
        try:
            low, high = self.nodes.drive.master.torque_range
            self.link.send(self.nodes.command(min(max(torque, low), high)))
        except (HardwareError, ProtocolError) as error:
            self.fail("bus_off", str(error))
        self._torque = torque

    def went_out(self, sent: float, lateness: float) -> None:
        """Note what was sent, when and how late [s]."""
        self._sent, age = sent, sent - self._angle.t
        self.timing.lateness.append(lateness)
        self.timing.ages.append(age)
        try:
            self._note(self._torque, age, lateness)
        except OSError as error:
            self.fail("record", f"The record cannot be written: {error}.")

    def hear(self, now: float, t: float) -> Measurement:
        """Read what has arrived by now and return the measurement for a time, checked [s]."""
        try:
            arrivals = self.link.receive()
        except HardwareError as error:
            self.fail("bus_off", str(error))
        self._round_trip = self.timing.answered(self._sent, arrivals)
        trouble = self.nodes.hear(arrivals) or self.nodes.trouble(True, now)
        full = self._completed()
        elapsed, self._angle_before = self._angle.t - self._angle_before, self._angle.t
        trouble = trouble or self.guard.check(full, max(elapsed, self.config.dt))
        if trouble is not None:
            finite = all(math.isfinite(full[name]) for name in self.sense.measured)
            if finite and trouble.kind != "corrupt":  # which stays out of the record
                self._full = full
            self._end(trouble)
        self._full = full
        return self.sense.measurement(full, t)

    def _completed(self) -> dict[str, float]:
        return self.sense.complete(self.nodes.values(), self._angle.t)

    # ---- how it ends
    def end(self) -> None:
        """Switch the drive off at the end of a run, and complete the record."""
        with self._lock:
            self.raise_if_tripped()
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
        kind = "command" if isinstance(error, CommandError) else "exception"
        kind = "interrupt" if interrupted else kind
        text = f"{type(error).__name__}: {error}".rstrip(".")
        self.trip(Fault(kind, f"{text}.", self.link.now()))
        self._talk.repeat_off()

    def fail(self, kind: str, text: str) -> None:
        """End the run with a fault."""
        self.trip(Fault(kind, text, self.link.now()))
        self.raise_if_tripped()

    def trip(self, fault: Fault) -> None:
        """Switch off because of a fault and complete the record; only the first call acts."""
        with self._lock:
            if self.state not in (State.ARMED, State.RUNNING):
                return
            self._talk.switch_off()
            self.guard.trip(fault)
            if self._full:
                with contextlib.suppress(OSError):
                    self._note(0.0, self.age(), 0.0)
            with contextlib.suppress(HardwareError):  # the fault matters more
                self.record.end(self.timing, fault={"kind": fault.kind, "text": fault.text})
            if self.on_fault is not None:
                self.on_fault(fault)

    def _end(self, fault: Fault) -> NoReturn:
        self.trip(fault)
        self._raise()

    def raise_if_tripped(self) -> None:
        """Raise the fault that ended the run, if one has."""
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

    def _note(self, torque: float, age: float, lateness: float) -> None:
        self.record.note(
            self._full,
            tau_cmd=torque,
            tau_ref=self._tau_ref,
            age=age,
            lateness=lateness,
            round_trip=self._round_trip,
        )
