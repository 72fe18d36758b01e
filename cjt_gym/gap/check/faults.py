"""Faults of a record: contradictory channels, clock, noise, motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cjt_gym.gap.check.back_emf import faster_than_driven
from cjt_gym.gap.check.bus import LOOP, bus
from cjt_gym.gap.check.channels import FEW_COUNTS
from cjt_gym.gap.check.clock import clock, gaps
from cjt_gym.gap.check.contradictions import (
    angles,
    coarser,
    currents,
    magnitudes,
    miscounted,
    spring,
    torques,
    velocities,
)
from cjt_gym.gap.check.encoders import angles_apart, exchanged, mapped_twice
from cjt_gym.gap.check.energy import foreign
from cjt_gym.gap.check.friction import TURN, one_way, two_ways
from cjt_gym.gap.check.instants import current_and_command, motion_and_torque
from cjt_gym.gap.check.resonances import gear_resonance, resonance
from cjt_gym.gap.check.torque_sensor import at_rest, without_spring
from cjt_gym.gap.check.view import View
from cjt_gym.gap.digits import plain
from cjt_gym.gap.recorded.bridged import bridged
from cjt_gym.gap.recorded.orient import orient
from cjt_gym.gap.recorded.series import SLOW
from cjt_gym.records import clean_pieces
from cjt_gym.records.repair import NOTE

COUNTED = 50.0
"""Least range of an angle for whole numbers to be reported [rad]."""
AGAINST = "has the sign against"
NOISY = 1.5
"""Ratio of observed to specified noise above which it is reported."""
LOUD = 0.2
"""Largest acceptable noise of the current, relative to its deviation, if none is specified."""
GEARED, ABOUT = 10.0, 1.5
"""Least gear ratio of which a forgotten square is told, and factor within which it is seen: one of
336 real records, moved by hand, with a ratio of 6 and another load, looked alike by chance."""
TAIL = 0.2
"""Share of a record that is held out for testing."""
OFTEN, BEYOND, ASKED = 0.99, 1.2, 5.0
"""Quantile of the current, and its ratio to the peak current above which one of them is wrong; of a
command, which the drive may limit."""
AT_REST = 0.1
"""Speed in that part, relative to that before it, up to which it is at rest."""


def faults(view: View) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the faults of the records and their remedies, a sentence each."""
    said: dict[str, None] = {}
    remedies: dict[str, None] = {}
    for look, remedy in LOOKS:
        found = look(view)
        said |= dict.fromkeys(found)
        remedies |= dict.fromkeys([remedy] if found and remedy else [])
    return tuple(said), tuple(remedies)


def notes(view: View) -> tuple[str, ...]:
    """Return remarks on the records that are not faults, a sentence each."""
    return tuple(note for look in NOTES for note in look(view))


def _repairs(view: View) -> list[str]:
    """Return the findings of the record reader, and those on signs and units."""
    found: list[str] = []
    for record in view.logged:
        _, repairs = clean_pieces(record)
        noted = [str(text) for text in record.provenance.get(NOTE, [])]
        told = ("sampling", "lateness", "missing") if noted else ("sampling", "lateness")
        kept = [repair.text for repair in repairs if repair.kind not in told]
        if view.joint is not None:
            _, turned = orient(record, view.joint, view.structure)
            right = {f"d{one.channel}" for one in turned if one.kind == "sign"}
            noted, kept = (
                [t for t in some if AGAINST not in t or t.split(":")[0] not in right]
                for some in (noted, kept)
            )
            known = [text.split(":")[0] for text in kept if AGAINST in text]
            kept += [repair.text for repair in turned if repair.channel not in known]
        found += [text for text in [*noted, *kept] if not _known_better(view, text)]
    return found


def _known_better(view: View, text: str) -> bool:
    """Return whether the joint file settles a doubt, or another check reports it better."""
    turns = " spans " in text and view.joint is not None
    return turns or text.startswith(("Sampling is uneven", "No rows for up to"))


def _still(view: View) -> list[str]:
    may = (*LOOP, *(("q_l", "dq_l") if view.structure.output_fixed else ()))
    if view.motor is not None and view.motor.coasts:
        may += tuple(name for name in (view.drive, view.command) if name is not None)
    return [
        f"{name} never changes: {channel.low:.4g} throughout."
        for name, channel in view.channels.items()
        if channel.span == 0.0 and name not in may
    ]


def _beyond_peak(view: View) -> list[str]:
    """Return sentences on a current or voltage that the joint's largest one does not allow."""
    found = []
    for name, unit, symbol, what, most in (
        ("i", "A", "i_p", "peak current", BEYOND),
        ("i_cmd", "A", "i_p", "peak current", ASKED),
        ("v", "V", "v_0", "supply voltage", BEYOND),
    ):
        limit = view.value(symbol)
        if name not in view or not 0.0 < limit < np.inf:
            continue
        sizes = np.abs(np.concatenate([x[name] for x in view.stretches]))
        usual = float(np.nanquantile(sizes, OFTEN))
        if usual > most * limit:
            found.append(
                f"{name} reaches {plain(usual)} {unit}; the joint file gives a {what} {symbol} of "
                f"{plain(limit)} {unit}."
            )
    return found


def _not_reflected(view: View) -> list[str]:
    """Return a sentence on an inertia of the rotor that seems to lack the square of the ratio."""
    own, balance, square = view.value("I_m"), view.motor, view.ratio**2
    if own <= 0.0 or balance is None or balance.coasts or view.ratio < GEARED:
        return []
    shown = balance.inertia
    rest = sum(view.value(name) for name in view.inertias if name != "I_m")
    times = (shown - rest) / own
    if not square / ABOUT < times < ABOUT * square:
        return []
    return [
        f"The motor's torque shows an inertia of {plain(shown)} {view.inertia_unit}, as if I_m of "
        f"the joint file lacked the factor n^2 = {plain(square)}."
    ]


def _few_counts(view: View) -> list[str]:
    found = []
    for name, channel in view.channels.items():
        held = name in ("q_l", "q_ref") and view.structure.output_fixed
        if not name.startswith("q_") or not channel.resolution or not channel.span or held:
            continue
        steps = channel.span / channel.resolution
        if steps < FEW_COUNTS:
            found.append(f"{name} moves over only {steps:.0f} steps of its resolution.")
    return found


def _whole_numbers(view: View) -> list[str]:
    found = []
    for name, channel in view.channels.items():
        if not name.startswith("q_") or channel.span < COUNTED:
            continue
        known = [record[name] for record in view.records if name in record]
        x = np.concatenate(known)
        if np.all(np.equal(x, np.round(x)) | np.isnan(x)):
            found.append(f"{name} has only whole numbers, which look like encoder counts.")
    return found


def _noise(view: View) -> list[str]:
    found = []
    for name, channel in view.channels.items():
        if name == "i" and view.dt > SLOW:
            continue  # a loop changes it between the rows
        if name == "i" and not channel.specified and channel.observed:
            swing = float(np.std(np.concatenate([piece["i"] for piece in view.stretches])))
            if channel.observed > LOUD * swing:
                found.append(
                    f"i has noise of {channel.observed:.2g} {channel.unit}, against a total "
                    f"deviation of {swing:.2g} {channel.unit}, and the joint file specifies none."
                )
        elif channel.specified and channel.unshaken > NOISY * channel.specified:
            ratio = plain(channel.unshaken / channel.specified, 2)
            found.append(
                f"{name} has noise of {channel.unshaken:.2g} {channel.unit}, "
                f"{ratio} times what the joint file states."
            )
    return found


def _direction(view: View) -> list[str]:
    if view.motor is None or two_ways(view):
        return []
    return [f"Motion in one direction only: {one_way(view)}."]


def _tail(view: View) -> list[str]:
    """Return a sentence if the part used for testing is at rest."""
    angle = view.motor_angle
    if angle is None or len(view.records) > 1:
        return []
    record = view.records[0]
    x, t = _moved(record[angle], angle, record.t), record.t
    begin = t[0] + (1.0 - TAIL) * (t[-1] - t[0])
    before, after = x[t[1:] < begin].sum(), x[t[1:] >= begin].sum()
    if before <= 0.0 or after / before > AT_REST * TAIL / (1.0 - TAIL):
        return []
    return [
        f"The last fifth of the record, from {plain(begin)} s on, is at rest: findings from "
        "the other part cannot be tested on it."
    ]


def _moved(x: np.ndarray, angle: str, t: np.ndarray) -> np.ndarray:
    """Return how far a body moves between samples, without the noise of the angle."""
    x = np.nan_to_num(x, nan=float(np.nanmean(x)))
    if angle.startswith("dq_"):
        return np.asarray(np.abs(x[1:] * np.diff(t)))
    size = max(len(x) // 400, 1)
    smooth = np.convolve(np.pad(x, (size, size), mode="edge"), np.ones(2 * size + 1), "valid")
    return np.asarray(np.abs(np.diff(smooth / (2 * size + 1))))


def _swing(view: View) -> Sequence[str]:
    nyquist = 0.5 / view.dt
    found = []
    for swing, what in (
        (resonance(view), "The joint resonates on its spring"),
        (
            gear_resonance(view) if view.structure.has_gear else 0.0,
            "Motor and gear resonate on the gearbox",
        ),
    ):
        if swing > nyquist:
            found.append(
                f"{what} at {plain(swing)} Hz, above the log's Nyquist frequency of "
                f"{plain(nyquist)} Hz."
            )
    return found


UNITS = "Map each channel with its unit, sign and side: --mapping."
FACTOR = "Map that channel with its unit and side: --mapping."
LIMITS = "Correct i_p or v_0 in the joint file, or map current and voltage with their units."
REFLECTED = "Give the rotor's inertia times n squared as I_m: inertias are on the link side."
SCALES = "Correct k_t and n in the joint file, or map tau with its unit and side."
SLOPES = "Map the velocity with its unit and scale, or correct the times of the rows."
ONE_INSTANT = "Log command and measurement of the same instant in one row, or map samples_late."
OTHERS = "Map the torque of what else moves the joint as tau_l, or record its motor alone."
FINER = "Record more motion, or a finer angle."
SPECIFY = (
    "State the noise that these sensors have in the joint file, such as noise under [sensors.q_m]."
)
LOOKS: tuple[tuple[Callable[[View], Sequence[str]], str], ...] = (
    (_repairs, ""),
    (lambda view: gaps(view.logged), "Log without gaps."),
    (lambda view: clock(view.logged), "Log at an even rate of 1 kHz, with the time of each row."),
    (_still, "Leave out channels that are not connected."),
    (_beyond_peak, LIMITS),
    (_few_counts, FINER),
    (_whole_numbers, UNITS),
    (velocities, SLOPES),
    (currents, FACTOR),
    (magnitudes, SCALES),
    (angles, FACTOR),
    (torques, SCALES),
    (_not_reflected, REFLECTED),
    (coarser, UNITS),
    (spring, UNITS),
    (exchanged, UNITS),
    (faster_than_driven, "Correct the mapping, or the joint file."),
    (mapped_twice, UNITS),
    (_noise, SPECIFY),
    (lambda view: current_and_command(view)[0], ONE_INSTANT),
    (lambda view: motion_and_torque(view)[0], ONE_INSTANT),
    (angles_apart, ONE_INSTANT),
    (_direction, TURN),
    (foreign, OTHERS),
    (_tail, "Record motion to the end, or a second record to test on."),
    (_swing, ""),
)
"""Checks for faults, each with its remedy."""
NOTES: tuple[Callable[[View], Sequence[str]], ...] = (
    lambda view: bridged(view.logged)[1],
    lambda view: current_and_command(view)[1],
    lambda view: motion_and_torque(view)[1],
    miscounted,
    without_spring,
    at_rest,
    lambda view: bus(view.records),
)
"""Checks that return remarks."""
