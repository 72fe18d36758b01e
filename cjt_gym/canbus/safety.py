"""Safety of a real joint under any controller: states, limits, faults.

It is always on. `Guard` has neither bus nor clock: it is given measurements and wanted commands,
and returns allowed commands or the fault that ends the run.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import final

from cjt_gym.errors import HardwareError

FAULTS: Mapping[str, str] = {
    "missing": "reports of a node stayed away, or were late",
    "repeated": "a node sent more reports than it was asked for",
    "corrupt": "a frame that no node sends, or a value that cannot be",
    "out_of_range": "a measured value left its limits",
    "bus_off": "the bus does not take frames, or reports an error",
    "drive": "the drive reported an error, or left its mode",
    "overrun": "the control loop did not come back in time",
    "command": "a command or an action that is no number or out of its space",
    "record": "the record could not be written: the disk is full, or gone",
    "neighbour": "another joint on the bus ended with a fault",
    "exception": "the controller, policy or program raised an exception",
    "interrupt": "the run was interrupted from the keyboard or by a signal",
}
"""Every fault that ends a run, and what it means."""


class State(enum.Enum):
    """States of a joint on a bus."""

    DISCONNECTED = "disconnected"
    IDLE = "idle"
    ARMED = "armed"
    RUNNING = "running"
    FAULT = "fault"


MOVES: Mapping[State, frozenset[State]] = {
    State.DISCONNECTED: frozenset({State.IDLE}),
    State.IDLE: frozenset({State.ARMED, State.DISCONNECTED}),
    State.ARMED: frozenset({State.RUNNING, State.IDLE, State.FAULT, State.DISCONNECTED}),
    State.RUNNING: frozenset({State.ARMED, State.FAULT}),
    State.FAULT: frozenset({State.DISCONNECTED}),
}
"""Which state may follow which."""


@dataclass(frozen=True)
class Fault:
    """The reason for which a run ended.

    Attributes:
        kind: A name of `FAULTS`.
        text: What happened, with values and units.
        t: Time at which it was found, on the clock of the link [s].
    """

    kind: str
    text: str
    t: float = math.nan

    def __post_init__(self) -> None:
        assert self.kind in FAULTS


class HardwareFault(HardwareError):
    """A fault ended the run; the joint is disabled and without torque.

    Attributes:
        fault: The fault.
    """

    fault: Fault

    def __init__(self, fault: Fault) -> None:
        super().__init__(f"Fault '{fault.kind}': {fault.text} Torque is off.")
        self.fault = fault


Range = tuple[str, float, float, str, str, str]
"""Channel, lowest and highest value, name in words, what is allowed in words, unit."""


@dataclass(frozen=True)
class SafetyLimits:
    """Limits of commands and measurements, all on the link side."""

    tau: float  # largest commanded motor torque [N m]
    tau_rate: float  # largest rate of the commanded torque [N m/s]
    dq_m: float  # largest motor speed [rad/s]
    q_low: float  # lowest motor angle [rad]
    q_high: float  # highest motor angle [rad]
    tau_joint: float  # largest joint torque [N m]
    deflection: float  # largest spring deflection [rad]
    temperature: float  # highest reported temperature [degC]
    current: float  # largest measured motor current [A]

    def ranges(self, reported: Collection[str]) -> list[Range]:
        """Return the ranges of measured channels; temperature has one where it is reported."""
        found: list[Range] = []
        for name, limit, words, unit in RANGES:
            top = float(getattr(self, limit))
            found.append((name, -top, top, words, f"within +-{top:.4g}", unit))
        span = f"from {self.q_low:.4g} to {self.q_high:.4g}"
        found.append(("q_m", self.q_low, self.q_high, "motor angle", span, "rad"))
        if "temperature" in reported:
            top, text = self.temperature, f"<= {self.temperature:.4g}"
            found.append(("temperature", -math.inf, top, "temperature", text, "degC"))
        return found


RANGES = (
    ("dq_m", "dq_m", "motor speed", "rad/s"),
    ("tau", "tau_joint", "joint torque", "N m"),
    ("deflection", "deflection", "spring deflection", "rad"),
    ("i", "current", "motor current", "A"),
)
"""Channel, limit on its magnitude, name in words, unit."""
JUMP = 3.0
"""Factor on the largest speed above which a change of angle is no motion but a corrupt value."""
WANTED, MADE, DEAF = 0.05, 0.1, 10
"""A drive is deaf if it makes less than the share `MADE` of a commanded current that is more than
the share `WANTED` of the limit, for so many control steps in a row, besides those by which reports
may be old."""
REMEDY = (
    "Where other programs hold the loop up: lower rate_hz, give it real-time priority or a quieter "
    "machine, or allow more in [control] with"
)
"""What helps against a loop that is late, but for the name of the allowance."""
OUT_OF_SPACE = 1e-6
"""Rounding that an action may be out of its space by."""


@final
class Guard:
    """Limits commands and detects faults.

    Attributes:
        limits: The limits.
        dt: Control step [s].
        soft: Time over which torque fades in at the start and out at the end [s].
        overrun: Time by which a command may be late [s].
        missed: Number of control steps without reports that are tolerated.
        reported: Channels that nodes report, whose values must be numbers.
        state: State of the joint.
        fault: The fault that ended the run, or None.
        commanded: Latest allowed motor torque [N m].
    """

    def __init__(
        self,
        limits: SafetyLimits,
        dt: float,
        soft: float,
        overrun: float,
        missed: int,
        reported: Collection[str] = (),
    ) -> None:
        self.limits, self.dt, self.soft, self.overrun = limits, dt, soft, overrun
        self.missed = missed
        self.state = State.DISCONNECTED
        self.fault: Fault | None = None
        self.commanded = 0.0
        self._steps = 0
        self._angle = math.nan
        self._deaf = 0
        self._ranges = limits.ranges(reported)
        self._reported = tuple(reported)

    def move(self, state: State) -> None:
        """Change the state.

        Raises:
            HardwareError: It cannot follow the present one.
        """
        if state not in MOVES[self.state]:
            able = ", ".join(sorted(s.value for s in MOVES[self.state]))
            raise HardwareError(
                f"A joint that is {self.state.value} cannot become {state.value}; it can become "
                f"{able}."
            )
        self.state = state
        if state is State.RUNNING:
            self._steps, self.commanded, self._deaf = 0, 0.0, 0
        if state is State.ARMED:
            self._angle = math.nan

    def trip(self, fault: Fault) -> None:
        """Note the fault that ends a run."""
        self.fault, self.state = fault, State.FAULT

    def allowed(self, command: float) -> float | Fault:
        """Return the allowed motor torque [N m], or a fault.

        Magnitude and rate are limited; at the start the torque fades in.
        """
        if not math.isfinite(command):
            return Fault("command", f"The command must be a finite torque in N m, got {command}.")
        top = self.limits.tau
        share = min(1.0, (self._steps + 1) * self.dt / self.soft) if self.soft > 0.0 else 1.0
        wanted = share * min(max(command, -top), top)
        step = self.limits.tau_rate * self.dt
        self.commanded = min(max(wanted, self.commanded - step), self.commanded + step)
        self._steps += 1
        return self.commanded

    def late(self, lateness: float) -> Fault | None:
        """Return the fault of a command that is too late [s], or None."""
        if lateness <= self.overrun:
            return None
        return Fault(
            "overrun",
            f"The loop must be back within {self.overrun * 1e3:.3g} ms of its deadline, it was "
            f"{lateness * 1e3:.3g} ms late. {REMEDY} overrun and watchdog.",
        )

    def fading(self) -> Iterator[float]:
        """Yield motor torques that fade from the last one to zero, one per control step [N m]."""
        begin, steps = self.commanded, max(1, round(self.soft / self.dt))
        for k in range(steps):
            self.commanded = begin * (1.0 - (k + 1) / steps)
            yield self.commanded

    def check(self, values: Mapping[str, float], elapsed: float) -> Fault | None:
        """Return the fault in a measurement, or None.

        Args:
            values: Channels such as "q_m" [rad], "tau" [N m], "temperature" [degC], by name; those
                that no node reports may be NaN.
            elapsed: Time since the report before of the motor's angle, at least a control step [s].
        """
        return (
            self._not_finite(values)
            or self._jumped(values["q_m"], elapsed)
            or self._beyond(values)
            or self._ignored(values["tau_m"])
        )

    def _not_finite(self, values: Mapping[str, float]) -> Fault | None:
        for name in self._reported:
            if not math.isfinite(values[name]):
                text = f"{name} must be a number that its node can report, got {values[name]}."
                return Fault("corrupt", text)
        return None

    def _jumped(self, angle: float, elapsed: float) -> Fault | None:
        moved, self._angle = angle - self._angle, angle
        step = JUMP * self.limits.dq_m * (elapsed + self.dt)
        if abs(moved) > step:
            return Fault(
                "corrupt",
                f"q_m cannot move by more than {step:.3g} rad within {1e3 * elapsed:.3g} ms, got "
                f"{moved:.3g} rad.",
            )
        return None

    def _beyond(self, values: Mapping[str, float]) -> Fault | None:
        for name, low, high, words, allowed, unit in self._ranges:
            value = values[name]
            if value > high or value < low:
                return Fault(
                    "out_of_range",
                    f"The {words} must be {allowed} {unit}, got {value:.4g} {unit}.",
                )
        return None

    def _ignored(self, torque: float) -> Fault | None:
        """Return the fault of a drive that is silently off, as it makes no torque."""
        made, wanted = abs(torque), abs(self.commanded)
        is_deaf = wanted > WANTED * self.limits.tau and made < MADE * wanted
        self._deaf = self._deaf + 1 if is_deaf else 0
        if self._deaf < DEAF + self.missed:
            return None
        return Fault(
            "drive",
            f"The drive must make the {self.commanded:.3g} N m that are commanded, it makes "
            f"{made:.3g} N m.",
        )


def check_action(action: float) -> Fault | None:
    """Return the fault of an action outside [-1, 1], or None."""
    if math.isfinite(action) and abs(action) <= 1.0 + OUT_OF_SPACE:
        return None
    return Fault("command", f"The action must be within [-1, 1], got {action}.")
