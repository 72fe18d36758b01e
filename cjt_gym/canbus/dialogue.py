"""Exchanges with the nodes outside a run: configure, listen, switch off."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from typing import final

from cjt_gym.canbus.link import Arrival, Line
from cjt_gym.canbus.nodes import Node, Nodes
from cjt_gym.canbus.protocols.contract import Mode, Step
from cjt_gym.errors import HardwareError, ProtocolError

PATIENCE = 0.5
"""Time for which a first report of every channel is awaited [s]."""
GRACE = 0.005
"""Time by which bus and computers may make a drive's stop seem later than it was [s]."""
PROOFS = 3
"""Times that a drive is asked to show that it stops by itself: a machine may stand still once."""
AFTERWARDS = 2
"""Control steps for which switching off is repeated after a fault."""
STOPPED = {Mode.FAULT, Mode.DISABLED}
UNWATCHED = (
    "To arm it as it is, write  unwatched = true  in [drive]; nothing else will stop it then."
)
"""What remains where a drive cannot show that it stops by itself."""
LOOKS = 4
"""Looks per control step at what has arrived, and at whether a loop still runs."""


@final
class Dialogue:
    """Exchanges of several frames with the nodes of a joint."""

    def __init__(self, link: Line, nodes: Nodes) -> None:
        self.link = link
        self._nodes = nodes
        self._heard: set[int] = set()  # identifiers of the frames that came during a step

    def perform(self, node: Node, steps: Iterable[Step]) -> None:
        """Carry out steps one by one; the node must confirm each within two attempts."""
        for step in steps:
            self._heard.clear()
            if not (self._try(step) or step.optional or self._try(step)):
                heard = ", ".join(f"{identifier:#x}" for identifier in sorted(self._heard))
                raise HardwareError(
                    f"{node.name} (node {node.address}) did not confirm: {step.text}. Check that "
                    "it is powered, and its protocol, number and bit rate. Frames that came "
                    f"meanwhile: {heard or 'none'}."
                )

    def set_up(self) -> None:
        """Configure all nodes, and wait for a value of every channel."""
        for node in self._nodes.all:
            self.perform(node, node.master.configure())
        self.listen()

    def make_ready(self, watchdog: float) -> None:
        """Clear faults, test the drive's watchdog unless it is unwatched, and listen."""
        drive = self._nodes.drive
        for node in self._nodes.all:
            self.perform(node, node.master.clear())
        if not drive.is_unwatched:
            self.prove_watchdog(watchdog)
            self.perform(drive, drive.master.clear())
        self.listen()

    def switch_on(self) -> None:
        """Switch the drive on."""
        drive = self._nodes.drive
        self.perform(drive, [*drive.master.clear(), *drive.master.enable()])

    def listen(self) -> None:
        """Poll until every channel is fresh."""
        link, nodes = self.link, self._nodes
        nodes.hear(link.receive())  # what arrived before now
        end = link.now() + PATIENCE
        missing = list(nodes.latest.values())
        while missing and link.now() < end:
            link.send(nodes.poll())
            link.wait_until(link.now() + nodes.dt)
            nodes.hear(link.receive())
            missing = nodes.missing(link.now())
        if missing:
            raise HardwareError(
                f"No report of {', '.join(each.label for each in missing)} within {PATIENCE:g} s. "
                "Check that the nodes are powered and set to report it."
            )

    def prove_watchdog(self, watchdog: float) -> None:
        """Test that the drive stops by itself when commands cease.

        It is switched on with zero torque and gets no command for the watchdog's time; then it must
        be off.
        """
        node = self._nodes.drive
        if not node.master.shows_stop:
            raise HardwareError(
                f"The protocol of {node.name} (node {node.address}) does not show whether the "
                "drive stops by itself where no command comes; its torque might outlive this "
                f"program. {UNWATCHED}"
            )
        if not any(self._stops(node, watchdog, k == PROOFS - 1) for k in range(PROOFS)):
            raise HardwareError(
                f"{node.name} (node {node.address}) must stop by itself within {watchdog:.4g} s "
                "without a command, and no report in that time says so: its torque would outlive "
                "this program. Switch its watchdog on (docs/protocols.md says how), with at most "
                "that time; where reports come later than that, give [control] watchdog more. "
                f"{UNWATCHED}"
            )

    def _stops(self, node: Node, watchdog: float, is_last: bool) -> bool:
        """Switch the drive on, wait, and return whether it has stopped; leave it off."""
        link, nodes = self.link, self._nodes
        try:
            try:
                self.switch_on()
            except HardwareError:
                if is_last:
                    raise
                return False  # its watchdog may have expired while the machine stood still
            link.send(node.master.command(0.0))
            link.wait_until(link.now() + watchdog + GRACE)
            stopped = self._modes(node) & STOPPED
            end = link.now() + PATIENCE
            while not stopped and link.now() < end:
                link.send(node.master.command(0.0))  # what is on stays on, what stopped stays off
                link.wait_until(link.now() + nodes.dt)
                seen = self._modes(node)
                if Mode.ENABLED in seen:
                    break
                stopped = seen & STOPPED
            return bool(stopped)
        finally:
            self.switch_off()
            self.repeat_off()

    def _modes(self, node: Node) -> set[Mode]:
        found: set[Mode] = set()
        for arrival in self.link.receive():
            with contextlib.suppress(ProtocolError):
                update = node.master.decode(arrival.message)
                if update is not None:
                    found |= {update.mode} if update.mode else set()
                    found |= {Mode.FAULT} if update.error else set()
        return found

    def switch_off(self) -> None:
        """Command zero torque and switch the drive off, if the bus still works."""
        with contextlib.suppress(HardwareError, ProtocolError):
            self.link.send(self._nodes.drive.master.disable())

    def repeat_off(self) -> None:
        """Switch off a few more times in case a frame was lost."""
        for _ in range(AFTERWARDS):
            self.switch_off()
            self.link.wait_until(self.link.now() + self._nodes.dt)

    def _try(self, step: Step) -> bool:
        link, dt = self.link, self._nodes.dt
        self._nodes.hear(link.receive())
        link.send(step.frames)
        if step.confirmed is None:
            return True
        end = link.now() + step.timeout
        again = link.now() + dt
        while link.now() < end:
            if step.meanwhile and link.now() >= again:
                link.send(step.meanwhile)
                again += dt
            link.wait_until(link.now() + dt / LOOKS)
            arrivals = link.receive()
            self._heard |= {arrival.message.arbitration_id for arrival in arrivals}
            self._nodes.hear(arrivals)
            if _is_confirmed(step, arrivals):
                return True
        return False


def _is_confirmed(step: Step, arrivals: Sequence[Arrival]) -> bool:
    assert step.confirmed is not None
    try:
        return any(step.confirmed(arrival.message) for arrival in arrivals)
    except ProtocolError as error:
        raise HardwareError(f"{step.text}: {error}") from error
