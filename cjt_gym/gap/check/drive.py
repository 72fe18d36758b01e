"""What a record shows of the drive, between command and current or command and motion."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.check.balance import RELIABLE
from cjt_gym.gap.check.verdicts import Seen, Unseen, Verdict, only_from
from cjt_gym.gap.check.view import View
from cjt_gym.joint.kernel.arrays import Floats

LEAST_DELAY = 0.25
"""Share of a sample below which no delay is identifiable."""
LATEST = 0.03
"""Upper limit on the smallest identifiable delay [s]."""
FEWEST_VALUES = 20
"""Number of distinct values of a command below which its rounding cannot be evaluated."""
NEAR_LIMIT = 0.1
"""Least share of the largest current that a command must reach if the current is not measured."""
MEASURE = "Record the measured current."
NO_CURRENT = Unseen("the drive takes a voltage, not a current", MEASURE)
CHANGES = "Record steps of different sizes in the command, and the measured current."


def no_command(view: View) -> Unseen | None:
    """Return why the drive cannot be evaluated, or None if it can."""
    if view.command is None and (view.drive == "v" or "v" in view):
        return Unseen(NO_CURRENT.why, "Record the command of its current loop, if it has one.")
    if view.command is None:
        return Unseen("no command is recorded", "Record the command i_cmd beside the current.")
    if view.command not in view:
        return Unseen("the command never changes", CHANGES)
    if not _responses(view):
        return Unseen("neither the current nor any motion is recorded", CHANGES)
    return None


def command_delay(view: View) -> Verdict:
    """Judge a delay, which requires a changing command and a quick response."""
    return _late(view, LEAST_DELAY)


def current_lag(view: View) -> Verdict:
    """Judge a lag of the current, which has the same requirements."""
    return _late(view, 2.0 * LEAST_DELAY)


def _late(view: View, least: float) -> Verdict:
    if (none := no_command(view)) is not None:
        return none
    size = min(_least_delay(view, name) for name in _responses(view))
    if size <= LATEST:
        return Seen(max(size, least * view.dt), "s")
    return Unseen(f"in the response to the command {only_from(1e3 * size, 'ms')}", CHANGES)


def current_saturation(view: View) -> Verdict:
    """Judge a current limit, which shows where the command exceeds it."""
    if (none := no_command(view)) is not None:
        return none
    if view.command == "v":
        return NO_CURRENT
    assert view.command is not None
    known = view.channels[view.command]
    most, limit = max(abs(known.low), abs(known.high)), view.value("i_p")
    far = view.command == "i_cmd" and known.unit == "A" and 0.0 < most < NEAR_LIMIT * limit
    if far and "i" not in view:
        why = f"the command reaches {most:.2g} A of the {limit:.3g} A that the drive allows"
        return Unseen(why, "Record steps up to the largest current.")
    return Seen(most, known.unit)


def command_quantization(view: View) -> Verdict:
    """Judge a coarse command, which requires many distinct values."""
    if (none := no_command(view)) is not None:
        return none
    if view.command == "v":
        return NO_CURRENT
    assert view.command is not None
    known = view.channels[view.command]
    values = len(np.unique(np.round(view.stretches[0][view.command], 12)))
    if values < FEWEST_VALUES:
        return Unseen(f"the command takes only {values} values", CHANGES.replace("steps", "ramps"))
    if "i" not in view or known.unit != view.channels["i"].unit:
        why = "the current is not measured: motion hardly shows how a command was rounded"
        return Unseen(why, MEASURE)
    size = RELIABLE * view.channels["i"].noise / np.sqrt(np.sqrt(values))
    if size < 0.5 * known.span:
        return Seen(float(max(size, known.resolution)), known.unit)
    return Unseen(f"{only_from(size, known.unit)}, and the command spans {known.span:.2g}", CHANGES)


def _gain(view: View) -> float:
    if view.command == "v":
        return view.torque_per_input
    return 1.0 if view.command == "tau_cmd" else view.value("k_t", 1.0) * view.ratio


def _responses(view: View) -> tuple[str, ...]:
    """Return the signals that respond to the command."""
    found = ["i"] if "i" in view and view.command == "i_cmd" else []
    if view.motor is not None and view.drive == view.command:
        found.append("motion")
    return tuple(found)


def _least_delay(view: View, response: str) -> float:
    """Return the smallest delay identifiable from a response [s]."""
    assert view.command is not None
    if response == "i":
        rates = [np.gradient(piece["i_cmd"], view.dt) for piece in view.stretches]
        power = sum(float(x @ x) for x in rates)
        gain = _follows(view)
        return float(RELIABLE * view.channels["i"].noise / max(gain * np.sqrt(power), 1e-300))
    balance = view.motor
    assert balance is not None
    return balance.least(_rate(view), ("a", "v", "s", "one"))


def _follows(view: View) -> float:
    """Return the gain with which the current follows the command, at most 1."""
    x = np.concatenate([piece["i_cmd"] for piece in view.stretches])
    y = np.concatenate([piece["i"] for piece in view.stretches])
    x, y = x - x.mean(), y - y.mean()
    late = [float(x[: len(x) - k] @ y[k:]) for k in range(8)]
    return min(max(max(late), 0.0) / max(float(x @ x), 1e-300), 1.0)


def _rate(view: View) -> Floats:
    """Return how fast the command changes while the motor moves [N m/s]."""
    assert view.motor is not None
    half = 0.5 * view.motor.width * view.dt
    ahead, behind = (
        view.at_motion(lambda piece: _gain(view) * piece[view.command or ""], earlier)
        for earlier in (-half, half)
    )
    return np.asarray((ahead - behind) / (2.0 * half))
