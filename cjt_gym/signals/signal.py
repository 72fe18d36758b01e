"""References and disturbances: step, chirp, multisine, smooth random, and from a file."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cjt_gym.errors import (
    ConfigurationError,
    UnknownNameError,
    check_name,
    check_range,
    unknown_name,
)
from cjt_gym.joint.border import checked_array
from cjt_gym.records import Record, read_record
from cjt_gym.signals import evaluate as ev
from cjt_gym.signals.evaluate import Floats

KINDS = {
    "zero": ev.ZERO,
    "step": ev.STEP,
    "chirp": ev.CHIRP,
    "multisine": ev.MULTISINE,
    "smooth": ev.SMOOTH,
    "file": ev.TABLE,
}
RANDOM_KINDS = ("step", "chirp", "multisine", "smooth")


@dataclass(frozen=True)
class Signal:
    """A signal over time: a torque reference [N m], or a load's torque or velocity.

    Attributes:
        kind: "zero", "step" (random levels), "chirp" (linear, to and fro), "multisine"
            (logarithmically spaced, random phases), "smooth" (random levels joined by
            quintics) or "file".
        amplitude: Largest magnitude, in the unit of what it drives; a factor for "file".
        low: Lowest frequency [Hz] of chirp and multisine.
        high: Highest frequency [Hz] of chirp and multisine.
        period: Hold time of a step, spacing of the smooth levels, duration of a sweep [s].
        count: Tones of a multisine.
        table: Rows [t, value] of a file, shape (rows, 2); a multisine sets it to rows [f, 0].
        key: Seed of the random parts; `reset` draws it.

    Example:
        >>> chirp = Signal("chirp", amplitude=10.0, low=0.1, high=60.0, period=60.0)
        >>> float(chirp.torque(0.0))
        0.0
    """

    kind: str
    amplitude: float = 1.0
    low: float = 0.5
    high: float = 20.0
    period: float = 0.5
    count: int = 12
    table: Floats = field(default_factory=lambda: np.zeros((1, 2)), compare=False, repr=False)
    key: int = 0

    def __post_init__(self) -> None:
        check_name("signal", self.kind, KINDS)
        check_range(f"amplitude of the {self.kind} signal", self.amplitude)
        for name, unit in (("low", "Hz"), ("high", "Hz"), ("period", "s")):
            check_range(f"{name} of the {self.kind} signal", getattr(self, name), unit, above=0.0)
        check_range("count of the signal", self.count, low=1)
        if self.kind == "multisine":
            tones = np.zeros((self.count, 2))
            tones[:, 0] = np.geomspace(self.low, self.high, self.count)
            object.__setattr__(self, "table", tones)
        table = checked_array(f"table of the {self.kind} signal", self.table, (None, 2))
        object.__setattr__(self, "table", table)
        if self.kind == "file" and (np.diff(table[:, 0]) < 0.0).any():
            raise ConfigurationError("The times in the table of a file signal must not decrease.")

    def reset(self, rng: np.random.Generator) -> Signal:
        """Return the signal with its random parts drawn from `rng`."""
        return replace(self, key=int(rng.integers(2**63)))

    def torque(self, t: float | Floats) -> Floats:
        """Return the value at time t [s], of the shape of t."""
        times = np.asarray(t, dtype=np.float64)
        values = ev.evaluate_all(self.row(), np.uint64(self.key), self.table, times.ravel())
        return np.asarray(values).reshape(times.shape)

    def row(self) -> Floats:
        """Return the numbers that the compiled evaluation reads, shape (6,)."""
        return np.array(
            [KINDS[self.kind], self.amplitude, self.low, self.high, self.period, self.count],
            dtype=np.float64,
        )


def signal_from_file(path: str | Path) -> Signal:
    """Return `signal_of_record` for a record file, or the name of a record that ships."""
    return signal_of_record(read_record(path))


def signal_of_record(record: Record) -> Signal:
    """Return the signal in a record's column `tau_ref`, or else `tau_cmd`, or else `tau_l`.

    Raises:
        ConfigurationError: It has none of these columns.
    """
    for name in ("tau_ref", "tau_cmd", "tau_l"):
        if name in record:
            return sampled_signal(record.t, record[name])
    raise ConfigurationError(
        f"Record {record.owner} must have a column tau_ref, tau_cmd or tau_l [N m] to serve as a "
        f"reference, got {', '.join(record.columns)}."
    )


def sampled_signal(t: Floats, values: Floats) -> Signal:
    """Return the signal through samples, the last of which holds for as long as the one before.

    Args:
        t: Times [s], increasing, shape (n,).
        values: Values, shape (n,).
    """
    last = 2.0 * t[-1] - t[-2] if len(t) > 1 else t[-1]
    table = np.column_stack([np.append(t, last) - t[0], np.append(values, values[-1])])
    return Signal("file", table=table)


def make_signals(spec: object, amplitude: float, high: float = 20.0) -> tuple[Signal, ...]:
    """Return the signals from which each episode draws one.

    Args:
        spec: A name of `RANDOM_KINDS`, "mixed" for all of them, "zero", the path of a record,
            a Signal, or a list of these.
        amplitude: Amplitude of those that are only named.
        high: Highest frequency of those that are only named [Hz].

    Raises:
        UnknownNameError: No such kind, and no such file.
    """
    if isinstance(spec, Signal):
        return (spec,)
    if isinstance(spec, (list, tuple)):
        return tuple(s for item in spec for s in make_signals(item, amplitude, high))
    if spec == "mixed":
        return make_signals(list(RANDOM_KINDS), amplitude, high)
    if spec in ("zero", *RANDOM_KINDS):
        periods = {"chirp": 1.0, "step": 0.25, "smooth": 0.1}
        period = periods.get(str(spec), 0.5)
        return (Signal(str(spec), amplitude=amplitude, high=high, period=period),)
    if isinstance(spec, (str, Path)) and os.path.exists(spec):
        return (signal_from_file(spec),)
    told = unknown_name("signal", str(spec), ["mixed", "zero", *RANDOM_KINDS])
    raise UnknownNameError(f"{told} Or give the path of a record.")
