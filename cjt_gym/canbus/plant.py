"""A real joint, or an emulated one, behind the contract of simulated plants."""

from __future__ import annotations

import contextlib
import gc
import math
import sys
import threading
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.canbus.bus_identity import bus_identity
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.dialogue import LOOKS, Dialogue
from cjt_gym.canbus.link import BusLink, Link, open_bus, quiet_machine
from cjt_gym.canbus.lock import NodeLock
from cjt_gym.canbus.measuring import Sense
from cjt_gym.canbus.nodes import Nodes
from cjt_gym.canbus.run_record import Beginning, BeginRecord, Recorder, RunRecord, Sample, versions
from cjt_gym.canbus.safety import Fault, Guard, HardwareFault, Seen, State
from cjt_gym.canbus.timing import Timing
from cjt_gym.errors import HardwareError, ProtocolError
from cjt_gym.plant import Limits, Measurement

Floats = NDArray[np.float64]
REHEARSAL = 100
"""Control steps for which the delay of the loop is measured before a run."""


@final
class CanPlant:
    """One joint on a CAN bus.

    Nothing moves before `arm`. A run begins with `reset`, which measures, and the first `step`,
    which switches the drive on; it goes on with one `step` per control step, at absolute deadlines.
    Any fault takes the torque away, switches off, completes the record and raises `HardwareFault`.
    Used as a context manager it also does so when the code within raises, or is interrupted; an
    interrupt while the drive is switched on does so anyway.

    Attributes:
        config: The joint on its bus.
        link: The way to it.
        guard: State, limits and faults.
        nodes: Latest values.
        timing: Regularity of the latest run.
        on_fault: Called once with the fault that ended a run, by whatever thread found it.
    """

    def __init__(
        self,
        config: HardwareConfig,
        link: Link | None = None,
        record: str | Path | BeginRecord | None = None,
        lock: threading.RLock | None = None,
        **facts: Any,
    ) -> None:
        """Prepare, without touching the bus.

        Args:
            config: The joint on its bus.
            link: The way to it; by default python-can's bus as configured.
            record: Where the record of the run is written, or what begins it; None for none.
            lock: Held by whoever decides on torque; joints that stop together share one.
            **facts: What else belongs to the record's provenance.
        """
        self.config = config
        self.nodes = Nodes.of(config)
        self.sense = Sense(config, frozenset(self.nodes.latest))
        self.guard = Guard(config.limits, config.dt, config.soft, config.overrun)
        self.timing = Timing()
        self._is_given = link is not None
        self._dialogue = None if link is None else Dialogue(link, self.nodes)
        self._path, self._facts = record, facts
        self._record: Recorder | None = None
        self.on_fault: Callable[[Fault], None] | None = None
        versions()
        self._node_lock: NodeLock | None = None
        self._lock = lock or threading.RLock()
        self._quiet: contextlib.ExitStack | None = None
        self._begin = self._due = math.inf
        self._k = 0
        self._full: dict[str, float] = {}
        self._sent = math.nan
        self._tau_ref = math.nan

    # ---- what a plant has
    @property
    def dt(self) -> float:
        """Control step [s]."""
        return self.config.dt

    @property
    def limits(self) -> Limits:
        """What may be commanded and borne."""
        s = self.config.limits
        low, high = self.nodes.drive.master.torque_range
        return Limits(tau=min(s.tau, -low, high), dq_m=s.dq_m, tau_joint=s.tau_joint)

    @property
    def link(self) -> Link:
        """The way to the nodes.

        Raises:
            HardwareError: It is not connected.
        """
        return self._talk.link

    @property
    def _talk(self) -> Dialogue:
        if self._dialogue is None:
            raise HardwareError("The joint is not connected. Call connect() first.")
        return self._dialogue

    @property
    def state(self) -> State:
        """State of the joint."""
        return self.guard.state

    @property
    def sent(self) -> float:
        """Motor torque that was commanded last [N m], 0 before a run and after a fault."""
        return self.guard.commanded if self.state is State.RUNNING else 0.0

    @property
    def lateness(self) -> float:
        """Time by which the last command was late [s]."""
        return self.timing.lateness[-1] if self.timing.lateness else 0.0

    def note(self, **facts: Any) -> None:
        """Add what is known to the provenance of records that are not begun yet."""
        self._facts = self._facts | facts

    # ---- before a run
    def connect(self) -> None:
        """Open the bus, set the nodes up, and wait until every channel was heard.

        Raises:
            HardwareError: Another process commands the drive, or a node does not answer.
            ConfigurationError: The bus cannot be opened.
        """
        if not self._is_given:
            self._node_lock = NodeLock(
                bus_identity(self.config.bus), self.config.drive.settings.node
            )
            try:
                self._dialogue = Dialogue(BusLink(open_bus(self.config.bus)), self.nodes)
            except BaseException:
                self._node_lock.release()
                raise
        self.link.watch(self._supervise, self.dt / LOOKS)
        try:
            for node in self.nodes.all:
                self._talk.perform(node, node.master.configure())
            self._talk.listen()
        except BaseException:
            self._release()
            raise
        self.guard.move(State.IDLE)

    def measured_delay(self) -> dict[str, float]:
        """Return the delays of bus and loop as they are now, without moving the joint [s].

        For `REHEARSAL` control steps the nodes are asked as in a run. The keys are those of the
        simulator's effects, as in a record; see `Timing.delay`.

        Raises:
            HardwareError: It is not connected, or moves.
        """
        if self.state not in (State.IDLE, State.ARMED):
            raise HardwareError(
                f"The delay is measured before a run, while the joint is idle or armed; it is "
                f"{self.state.value}."
            )
        timing, link = Timing(), self.link
        due = link.now()
        for _ in range(REHEARSAL):
            link.send(self.nodes.poll())
            sent = link.now()
            timing.lateness.append(max(sent - due, 0.0))
            due += self.dt
            link.wait_until(due)
            arrivals = link.receive()
            timing.answered(sent, [arrival.t for arrival in arrivals[:1]])
            self.nodes.hear(arrivals)
            timing.ages.append(self.age())
        return timing.delay(self.dt)

    def arm(self) -> None:
        """Allow the joint to be moved; it still is not.

        The drive is switched on once, with zero torque, to show that it stops by itself where no
        command comes, unless the configuration says that it is unwatched.

        Raises:
            HardwareError: It is not connected, what it shows is not within its limits, or its
                torque might outlive this program.
        """
        if isinstance(self.link, BusLink):
            gc.collect()  # now, for it is kept out of the run
        for node in self.nodes.all:
            self._talk.perform(node, node.master.clear())
        drive = self.nodes.drive
        if not drive.is_unwatched:
            self._talk.prove_watchdog(self.config.drive.settings.watchdog)
            self._talk.perform(drive, drive.master.clear())
        self._talk.listen()
        seen = self._seen(self._completed(), 0.0)
        trouble = self.nodes.trouble(is_on=False) or self.guard.check(seen)
        if trouble is not None:
            raise HardwareError(f"The joint cannot be armed: {trouble.text}")
        self.guard.move(State.ARMED)

    def reset(self, seed: int | None = None) -> Measurement:
        """End a run that is on, softly, and return the measurement with which another begins.

        Args:
            seed: Not used: a real joint draws nothing.

        Raises:
            HardwareError: The joint is not armed, or ended with a fault.
        """
        if self.state is State.RUNNING:
            self.stop()
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
    def step(self, command: Floats, tau_ref: float = math.nan) -> Measurement:
        """Command a motor torque for one control step and return the next measurement.

        The first step after `reset` switches the drive on.

        Args:
            command: Motor torque [N m], shape (1,); it is limited, and so is its rate.
            tau_ref: Joint torque that was wanted [N m], for the record.

        Raises:
            HardwareFault: Something went wrong; the torque is off.
            HardwareError: The joint is not armed.
        """
        if self.state is State.ARMED:
            self.start(tau_ref)
            self.begin(self.link.now())
        self.send(float(np.asarray(command).reshape(-1)[0]), tau_ref)
        self.link.wait_until(self._due)
        return self.hear()

    def start(self, tau_ref: float = math.nan) -> None:
        """Switch the drive on, with zero torque; `begin` has to follow.

        Args:
            tau_ref: First joint torque that is wanted [N m], for the record.

        Raises:
            HardwareFault: The drive does not switch on.
            HardwareError: The joint is not armed.
        """
        self._tau_ref = tau_ref if math.isfinite(tau_ref) else self._tau_ref
        self._start()

    def begin(self, t: float) -> None:
        """Count control steps from a time on [s]."""
        with self._lock:
            self.nodes.hear(self.link.receive())
            for node in self.nodes.all:
                node.forgive()
            self._begin = self._due = t

    def send(self, command: float, tau_ref: float = math.nan) -> None:
        """Command a motor torque [N m] now; `hear` ends the control step.

        Raises:
            HardwareFault: Something went wrong; the torque is off.
            HardwareError: The joint is not running.
        """
        self._tau_ref = tau_ref if math.isfinite(tau_ref) else self._tau_ref
        if self.state is not State.RUNNING:
            self._raise()
        lateness = self.link.now() - self._due
        late = self.guard.late(lateness)
        allowed = late or self.guard.allowed(command)
        with self._lock:
            if isinstance(allowed, Fault):
                self.trip(allowed)
            self._raise_if_tripped()
            assert isinstance(allowed, float)
            self._command(allowed, lateness)

    @property
    def due(self) -> float:
        """When the next command is due [s]."""
        return self._due

    def stop(self) -> None:
        """End a run softly: fade the torque out and switch the drive off; the joint stays armed.

        Raises:
            HardwareFault: Something went wrong on the way.
        """
        if self.state is not State.RUNNING:
            return
        for torque in self.guard.fading():
            self.fade(torque)
            self.link.wait_until(self._due)
            self.hear()
        self.end()

    def switch_off(self) -> None:
        """Tell the drive once more to be off; nothing else changes."""
        self._talk.switch_off()

    def fade(self, torque: float) -> None:
        """Send a torque on the way to zero [N m]; see `Guard.fading`."""
        with self._lock:
            self._raise_if_tripped()
            self._command(torque, self.link.now() - self._due)

    def end(self) -> None:
        """Switch the drive off at the end of a run, and complete the record."""
        with self._lock:
            self._raise_if_tripped()
            self.link.send(self.nodes.drive.master.disable())
            self.guard.move(State.ARMED)
            self._end()

    def fail(self, kind: str, text: str) -> None:
        """End the run with a fault that was found elsewhere.

        Raises:
            HardwareFault: Always, where a run was on.
        """
        self.trip(Fault(kind, text, self.link.now()))
        self._raise_if_tripped()

    def close(self) -> None:
        """End a run, complete the record and release the bus.

        The run ends softly; while an exception is on its way it ends at once, as with any fault.
        """
        if self.state is State.DISCONNECTED or self._dialogue is None:
            return
        error = sys.exc_info()[1]
        try:
            if error is None:
                self._stop_or_abandon()
            elif not isinstance(error, HardwareFault):
                self.abandon(error)
        finally:
            try:
                self._end()
            finally:
                self._release()
                if self.state is not State.FAULT:
                    self.guard.state = State.DISCONNECTED

    def _stop_or_abandon(self) -> None:
        try:
            self.stop()
        except HardwareFault:
            raise
        except BaseException as error:
            self.abandon(error)
            raise

    def abandon(self, error: BaseException) -> None:
        """End a run at once because of an exception from elsewhere, as often as after a fault."""
        interrupted = isinstance(error, KeyboardInterrupt | SystemExit)
        kind = "interrupt" if interrupted else "exception"
        text = f"{type(error).__name__}: {error}".rstrip(".")
        self.trip(Fault(kind, f"{text}.", self._now()))
        self._talk.repeat_off()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    # ---- within a run
    def _start(self) -> None:
        """Switch the drive on and begin to count."""
        self.timing = Timing()
        try:
            self._prepare()
        except BaseException:
            self._end()
            raise
        self.guard.move(State.RUNNING)
        self._due = math.inf
        try:
            master = self.nodes.drive.master
            self._talk.perform(self.nodes.drive, [*master.clear(), *master.enable()])
        except HardwareError as error:
            self.trip(Fault("drive", str(error), self._now()))
            self._raise()
        except BaseException as error:  # Ctrl-C: the drive may be on already
            self.abandon(error)
            raise

    def _prepare(self) -> None:
        """Make the machine quiet and begin the record."""
        self._quiet = contextlib.ExitStack()
        if isinstance(self.link, BusLink):
            self._quiet.enter_context(quiet_machine(self.config.priority))
        if self._path is not None and self._record is None:
            hot = "temperature" in self.nodes.latest
            begin = self._path if callable(self._path) else partial(RunRecord, self._path)
            self._record = begin(
                Beginning(self.config, self.sense, self._tau_ref, hot, self._facts)
            )

    def _command(self, torque: float, lateness: float) -> None:
        """Send a torque [N m], note it, and set the next deadline."""
        try:
            low, high = self.nodes.drive.master.torque_range
            self.link.send(self.nodes.command(min(max(torque, low), high)))
        except (HardwareError, ProtocolError) as error:
            self.trip(Fault("bus_off", str(error), self._now()))
            self._raise()
        self._sent = self.link.now()
        self.timing.lateness.append(max(lateness, 0.0))
        self.timing.ages.append(self.age())
        try:
            self._note(torque, max(lateness, 0.0))
        except OSError as error:
            self.trip(Fault("record", f"The record cannot be written: {error}.", self._now()))
            self._raise()
        self._k += 1
        self._due = self._begin + self._k * self.dt

    def hear(self) -> Measurement:
        """Take what has arrived; return the measurement, or raise what is wrong with it.

        Raises:
            HardwareFault: Something is; the torque is off.
        """
        with self._lock:
            self._raise_if_tripped()
            try:
                arrivals = self.link.receive()
            except HardwareError as error:
                self.trip(Fault("bus_off", str(error), self._now()))
                self._raise()
            self.timing.answered(self._sent, [arrival.t for arrival in arrivals[:1]])
            trouble = self.nodes.hear(arrivals)
            full = self._completed()
            seen = self._seen(full, self.dt)
            trouble = trouble or self.nodes.trouble(is_on=True) or self.guard.check(seen)
            finite = all(math.isfinite(full[name]) for name in self.sense.measured)
            if trouble is None or (finite and trouble.kind != "corrupt"):
                self._full = full  # what is corrupt stays out of the record
            if trouble is not None:
                self.trip(trouble)
                self._raise()
            return self.sense.measurement(self._full, self._k * self.dt)

    def age(self) -> float:
        """Return the age of the motor's angle [s]."""
        return self._now() - self.nodes.latest["q_m"].t

    def _completed(self) -> dict[str, float]:
        return self.sense.complete(self.nodes.values(), self.nodes.latest["q_m"].t)

    def _seen(self, full: Mapping[str, float], elapsed: float) -> Seen:
        known = {
            name: value
            for name, value in full.items()
            if name in self.nodes.latest or math.isfinite(value)
        }
        return Seen(known, self.nodes.ages(self._now()), elapsed)

    # ---- faults
    def _supervise(self, now: float) -> None:
        """Take the torque away where the loop does not come back; called all the time."""
        late = self.guard.late(now - self._due)
        if self.state is State.RUNNING and late is not None:
            self.trip(late)

    def trip(self, fault: Fault) -> None:
        """Switch off because of a fault, once, and complete the record."""
        with self._lock:
            if self.state not in (State.ARMED, State.RUNNING):
                return
            self._talk.switch_off()
            self.guard.trip(fault)
            if self._full:
                with contextlib.suppress(OSError):
                    self._note(0.0, 0.0)
            with contextlib.suppress(HardwareError):  # the fault matters more
                self._end(fault={"kind": fault.kind, "text": fault.text})
            if self.on_fault is not None:
                self.on_fault(fault)

    def _raise_if_tripped(self) -> None:
        if self.state is State.FAULT:
            self._raise()

    def _raise(self) -> None:
        """Repeat that the drive is to be off, and raise the fault."""
        fault = self.guard.fault
        if fault is None:
            raise HardwareError(
                f"A joint that is {self.state.value} does not take commands. Call connect(), "
                "arm() and reset() first."
            )
        self._talk.repeat_off()
        raise HardwareFault(fault)

    def _now(self) -> float:
        return self.link.now()

    # ---- the record
    def _note(self, torque: float, lateness: float) -> None:
        """Append a row to the record."""
        if self._record is not None:
            now = Sample(self._k, self._full, torque, self._tau_ref, self.age(), lateness)
            self._record.note(now)

    def _end(self, **known: Any) -> None:
        """Complete the record of a run and let the machine be as it was."""
        if self._quiet is not None:
            quiet, self._quiet = self._quiet, None
            quiet.close()
        if self._record is not None:
            record, self._record, self._path = self._record, None, None
            try:
                record.close(self.timing, **known)
            except OSError as error:
                raise HardwareError(
                    f"The record {record.path} could not be completed: {error}. Its rows are "
                    f"there, as far as they were written, in {record.rows_path}."
                ) from error

    def _release(self) -> None:
        if not self._is_given and self._dialogue is not None:
            self._dialogue.link.close()
            self._dialogue = None
        if self._node_lock is not None:
            self._node_lock.release()
            self._node_lock = None
