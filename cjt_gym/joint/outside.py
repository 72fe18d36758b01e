"""Warns, once per joint, when a simulation leaves the ranges in which the joint was identified."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from weakref import WeakValueDictionary

import numpy as np

from cjt_gym.errors import OutsideFoundWarning
from cjt_gym.joint.files.diagnosed import Range, ranges_of
from cjt_gym.joint.files.joint_file import JointFile
from cjt_gym.joint.kernel.arrays import Floats

Met = Mapping[str, tuple[float, float]]
MARGIN = 0.1
"""Share of the largest value found by which speed and torque may be exceeded."""
OCTAVE = 2.0
"""Factor by which a frequency may be; spectra are compared, which are hardly sharper."""
PERIODS = 3.0
"""Fewest periods of the highest frequency found in a simulation whose frequency is compared."""
POWER = 0.95
"""Share of a command's power that lies below its frequency."""

_told: WeakValueDictionary[int, JointFile] = WeakValueDictionary()


def is_told(file: JointFile) -> bool:
    """Return whether a joint has been warned about, or states no range."""
    return not file.found or _told.get(id(file)) is file


def tell_outside(file: JointFile, met: Met) -> None:
    """Warn, once, that a simulation leaves the ranges in which a joint was identified.

    Rest is always within; so is what goes beyond a range by a tenth of its largest value, and a
    frequency within an octave. `met` is in the units of the file, whose [found] states the ranges.
    """
    if is_told(file):
        return
    ranges = ranges_of(file)
    left = {name: known for name, known in ranges.items() if name in met}
    beyond = {n: x for n, known in left.items() if (x := _beyond(n, known, met[n])) is not None}
    if not beyond:
        return
    _told[id(file)] = file
    parts = [
        f"a {name} of {x:.3g} {ranges[name].unit} (found at {ranges[name].low:.3g} to "
        f"{ranges[name].high:.3g} {ranges[name].unit})"
        for name, x in beyond.items()
    ]
    p = file.parameters
    warnings.warn(
        f"A simulation of {p.name} reaches {', '.join(parts)}. How the joint behaves there was "
        f"not recorded: [found] of {p.origin}. Diagnose a record that goes there, or stay within.",
        OutsideFoundWarning,
        stacklevel=3,
    )


def frequency_of(x: Floats, dt: float) -> float:
    """Return the frequency below which 95 % of a signal's power lies [Hz]."""
    power = np.abs(np.fft.rfft(x - np.mean(x))) ** 2
    total = np.cumsum(power)
    if total[-1] == 0.0:
        return 0.0
    return float(np.fft.rfftfreq(len(x), dt)[np.searchsorted(total, POWER * total[-1])])


def _beyond(name: str, known: Range, met: tuple[float, float]) -> float | None:
    """Return the value farthest outside a range, or None."""
    if name == "frequency":
        return met[1] if met[1] > OCTAVE * known.high else None
    margin = MARGIN * max(abs(known.low), abs(known.high))
    below = min(known.low, 0.0) - margin - met[0]
    above = met[1] - max(known.high, 0.0) - margin
    if max(below, above) <= 0.0:
        return None
    return met[0] if below > above else met[1]
