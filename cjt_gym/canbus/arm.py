"""One loop that runs the joints of a bus in step."""

from __future__ import annotations

import contextlib
import gc
import math
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Self, final

import numpy as np

from cjt_gym.canbus.can_joint import CanJoint
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.dialogue import AFTERWARDS, LOOKS
from cjt_gym.canbus.journal import Watcher
from cjt_gym.canbus.link import BusLink, Link, open_link, quiet_machine
from cjt_gym.canbus.lock import NodeLock, bus_identity
from cjt_gym.canbus.run_record import RunRecord
from cjt_gym.canbus.safety import Fault, HardwareFault, State
from cjt_gym.canbus.shared_bus import SharedLink
from cjt_gym.canbus.timing import Timing
from cjt_gym.errors import HardwareError
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant.measurement import Measurement

REHEARSAL = 100
"""Control steps for which the delay of the loop is measured before a run."""


@final
class CanArm:
    """The joints of a CAN bus.

    Nothing moves before `arm`. A run starts with `reset`, which measures; the first `step` switches
    the drives on, and every `step` takes one control period, with absolute deadlines. Each joint is
    a `CanJoint` with its own limits, state and watchdog. In each period all commands are sent
    together; the loop then waits for the deadline once and reads what has arrived, never for a
    single joint. A fault of any joint removes the torque of all, switches the drives off, completes
    the record and raises `HardwareFault`. So does an exception or interrupt in the body of a `with`
    statement, and an interrupt while the drives are on.

    Attributes:
        configs: Configuration of each joint.
        dt: Control step [s].
        joints: The joints, in the order of the configuration.
        fault: The fault that ended a run, with the name of its joint; None if there was none.
    """

    def __init__(
        self,
        configs: Sequence[HardwareConfig],
        link: Link | None = None,
        record: str | Path | None = None,
        watcher: Watcher | None = None,
    ) -> None:
        """Prepare without touching the bus.

        Args:
            configs: Configuration of each joint, from `load_joints`.
            link: Connection to the bus; python-can's bus as configured by default.
            record: File for the record of all joints, or None.
            watcher: Receives every row of the record during the run, or None.

        Raises:
            ConfigurationError: The record exists.
            RecordError: The TOML file beside the record belongs to something else.
        """
        self.configs = tuple(configs)
        self.dt = configs[0].dt
        self.fault: tuple[str, Fault] | None = None
        self._given, self._lock = link, threading.RLock()
        self._held: list[NodeLock] = []
        self._begin = self._due = math.inf
        self._k = 0
        self._quiet = contextlib.ExitStack()
        self._shared = SharedLink(len(configs), self.dt, link)
        shared = None if record is None else RunRecord(record, len(configs), self.dt, watcher)
        self.joints = tuple(
            CanJoint(config, tap, self._lock, shared)
            for config, tap in zip(configs, self._shared.taps, strict=True)
        )
        for joint, tap in zip(self.joints, self._shared.taps, strict=True):
            tap.claims = joint.nodes.claims
            joint.on_fault = partial(self._spread, joint.config.name)

    @property
    def link(self) -> Link:
        """Connection to the bus."""
        return self._shared.link

    # ---- before a run
    def connect(self) -> None:
        """Open the bus, configure all nodes, and wait for a value of every channel.

        Raises:
            HardwareError: Another process uses a drive, or a node does not answer.
            ConfigurationError: The bus cannot be opened.
        """
        bus = self.configs[0].bus
        self.fault = None
        try:
            if self._given is None:
                for config in self.configs:
                    self._held.append(NodeLock(bus_identity(bus), config.drive.settings.node))
                self._shared.open(open_link(bus))
            self.link.watch(self._supervise, self.dt / LOOKS)
            for joint in self.joints:
                joint.connect()
        except BaseException:
            self._release()
            raise

    def measured_delays(self) -> list[dict[str, float]]:
        """Return the delays of bus and loop for each joint, measured without moving them [s].

        All are polled together for `REHEARSAL` control periods, as in a run. The keys are the
        simulator's effects; see `Timing.delay`.

        Raises:
            HardwareError: A joint is neither idle nor armed.
        """
        for joint in self.joints:
            if joint.state not in (State.IDLE, State.ARMED):
                raise HardwareError(
                    "Delays are measured before a run, while the joints are idle or armed; one is "
                    f"{joint.state.value}."
                )
        timings = [Timing() for _ in self.joints]
        due = self.link.now()
        for _ in range(REHEARSAL):
            self._shared.gather()
            for joint in self.joints:
                joint.link.send(joint.nodes.poll())
            self._shared.flush()
            sent = self.link.now()
            lateness = max(sent - due, 0.0)
            due += self.dt
            self._shared.wait_until(due)
            for joint, timing in zip(self.joints, timings, strict=True):
                timing.lateness.append(lateness)
                joint.rehearse(timing, sent)
        return [timing.delay(self.dt) for timing in timings]

    def arm(self) -> None:
        """Arm the joints one after another, without moving them.

        Unless the configuration declares a drive unwatched, it is switched on with zero torque to
        prove that its watchdog stops it when commands cease.

        Raises:
            HardwareError: A joint is not connected or is outside its limits, or its watchdog
                failed.
        """
        if isinstance(self.link, BusLink):
            gc.collect()  # now, for it is kept out of the run
        for joint in self.joints:
            joint.arm()

    def reset(self, seed: int | None = None) -> list[Measurement]:
        """End the current run softly, and return the measurements for the start of the next.

        Raises:
            HardwareError: A joint is not armed, or is in fault.
        """
        self.stop()
        return [joint.reset() for joint in self.joints]

    # ---- a run
    def step(self, commands: Floats, tau_ref: Floats | None = None) -> list[Measurement]:
        """Command motor torques for one control period and return the next measurements.

        The first step after `reset` switches the drives on.

        Args:
            commands: Motor torque of each joint [N m], shape (joints,); magnitude and rate are
                limited.
            tau_ref: Reference torque of each joint [N m], for the record.

        Raises:
            HardwareFault: A joint failed; all torques are off.
            HardwareError: The joints are not armed.
        """
        wanted = np.full(len(self.joints), np.nan) if tau_ref is None else np.asarray(tau_ref)
        torques = np.asarray(commands, dtype=np.float64).reshape(len(self.joints)).tolist()
        with self._all_off_on_fault():
            if all(joint.state is State.ARMED for joint in self.joints):
                self._start(wanted)
            late = self.joints[0].guard.late(self.link.now() - self._due)
            for joint, followed in zip(self.joints, wanted.tolist(), strict=True):
                joint.follow(followed)
            return self._exchange(
                [
                    joint.allowed(torque, late)
                    for joint, torque in zip(self.joints, torques, strict=True)
                ]
            )

    def stop(self) -> None:
        """End a run: fade all torques out and switch the drives off. The joints stay armed."""
        if not any(joint.state is State.RUNNING for joint in self.joints):
            return
        with self._all_off_on_fault():
            for torques in zip(*(joint.guard.fading() for joint in self.joints), strict=True):
                self._exchange(torques)
            for joint in self.joints:
                joint.end()
        self._quiet.close()

    def fail(self, kind: str, text: str, k: int = 0) -> None:
        """End the run with a fault of the k-th joint that the caller found."""
        with self._all_off_on_fault():
            self.joints[k].fail(kind, text)

    def close(self) -> None:
        """End a run, complete the record and release the bus.

        The run ends softly, or at once if an exception is being handled.
        """
        error = sys.exc_info()[1]
        try:
            if error is None and self.fault is None:
                self.stop()
        except BaseException as raised:
            error = raised
            raise
        finally:
            self._quiet.close()
            with contextlib.ExitStack() as closing:
                closing.callback(self._release)
                for joint in self.joints:
                    closing.callback(joint.close, error)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    # ---- within a run
    def _start(self, wanted: Floats) -> None:
        """Switch the drives on one by one, and keep feeding those that are on."""
        if isinstance(self.link, BusLink):
            self._quiet.enter_context(quiet_machine(self.configs[0].priority))
        self._due = math.inf
        try:
            for joint, tau_ref in zip(self.joints, wanted.tolist(), strict=True):
                joint.start(tau_ref)
                self._shared.keep_alive(partial(joint.nodes.command, 0.0))
            with self._lock:
                for joint in self.joints:
                    joint.begin()
                self._k, self._begin = 0, self.link.now()
                self._due = self._begin
        except BaseException as error:
            self._quiet.close()
            if not isinstance(error, HardwareFault):
                for joint in self.joints:
                    joint.abandon(error)
            raise
        finally:
            self._shared.let_go()

    def _exchange(self, torques: Sequence[float]) -> list[Measurement]:
        """Send motor torques [N m], wait for the deadline, and return the measurements then."""
        with self._lock:  # nobody else may send between them
            self.joints[0].raise_if_tripped()  # as all are where one is
            self._shared.gather()
            try:
                for joint, torque in zip(self.joints, torques, strict=True):
                    joint.send(torque)
            finally:
                try:
                    self._shared.flush()
                except HardwareError as error:
                    self.joints[0].fail("bus_off", str(error))
            sent = self.link.now()
            lateness = max(sent - self._due, 0.0)
            for joint in self.joints:
                joint.went_out(sent, lateness)
            self._k += 1
            t = self._k * self.dt
            self._due = self._begin + t
        self._shared.wait_until(self._due)
        with self._lock:
            self.joints[0].raise_if_tripped()
            now = self.link.now()
            return [joint.hear(now, t) for joint in self.joints]

    def _supervise(self, now: float) -> float | None:
        """Remove the torque if the loop does not return; return when to look again [s]."""
        joint = self.joints[0]
        if joint.state is not State.RUNNING or math.isinf(self._due):
            return None
        late = joint.guard.late(now - self._due)
        if late is not None:
            joint.trip(late)
        return self._due + self.configs[0].overrun

    @contextlib.contextmanager
    def _all_off_on_fault(self) -> Iterator[None]:
        """After a fault, command all drives off again and raise the original fault."""
        try:
            yield
        except HardwareFault:
            for _ in range(AFTERWARDS):
                for joint in self.joints:
                    joint.switch_off()
                self._shared.wait_until(self.link.now() + self.dt)
            if self.fault is None:
                raise
            name, fault = self.fault
            text = f"{name}: {fault.text}" if name else fault.text
            raise HardwareFault(replace(fault, text=text)) from None

    def _spread(self, name: str, fault: Fault) -> None:
        """Remove the torque of all joints because one has failed."""
        if self.fault is not None:
            return
        self.fault = name, fault
        self._shared.let_go()  # for many a drive a command of zero torque switches it on
        for joint in self.joints:
            joint.trip(Fault("neighbour", f"{name}: {fault.text}", fault.t))

    def _release(self) -> None:
        if self._given is None:
            self._shared.close()
        while self._held:
            self._held.pop().release()
