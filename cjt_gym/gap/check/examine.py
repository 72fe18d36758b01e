"""Examination of a record before any fit: its faults, and what it can and cannot identify."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from threadpoolctl import threadpool_limits

from cjt_gym.errors import RecordError
from cjt_gym.gap.check import drive, friction, load, sensing, torque, transmission
from cjt_gym.gap.check.channels import measured
from cjt_gym.gap.check.examination import CannotTell, Examination
from cjt_gym.gap.check.faults import faults, notes
from cjt_gym.gap.check.verdicts import TOO_FEW, Seen, Unseen, Verdict, no_balance
from cjt_gym.gap.check.view import View
from cjt_gym.gap.recorded.driven import driven_only, is_left
from cjt_gym.gap.recorded.fields import check_bodies
from cjt_gym.gap.recorded.given import (
    JointLike,
    as_records,
    joint_file_of,
    named_joint,
    structure_of,
)
from cjt_gym.gap.recorded.series import SHORTEST
from cjt_gym.gap.recorded.usable import measured_only, unmeasured
from cjt_gym.joint import Joint, JointFile, Structure
from cjt_gym.records import Record

ALONE = "Map the torque of what else drives the joint as tau_l, or let its motor drive it alone."
"""Remedy for motion that is not the motor's."""
BRIEFEST = 0.2
"""Shortest duration of a record [s]."""
ROWS: Mapping[str, Callable[[View], Verdict]] = {
    "command_delay": drive.command_delay,
    "current_lag": drive.current_lag,
    "current_saturation": drive.current_saturation,
    "command_quantization": drive.command_quantization,
    "torque_constant": torque.torque_constant,
    "thermal_derating": torque.thermal_derating,
    "torque_offset": friction.torque_offset,
    "inertia": friction.inertia,
    "damping": friction.damping,
    "coulomb": friction.coulomb,
    "coulomb_asym": friction.coulomb_asym,
    "viscous_asym": friction.viscous_asym,
    "stribeck": friction.stribeck,
    "presliding": friction.presliding,
    "load_friction": friction.load_friction,
    "cogging": torque.cogging,
    "gear_ripple": torque.gear_ripple,
    "backlash": transmission.backlash,
    "stiffness": transmission.stiffness,
    "gear_stiffness": transmission.gear_stiffness,
    "hardening": transmission.hardening,
    "spring_hysteresis": transmission.spring_hysteresis,
    "torque_gain": sensing.torque_gain,
    "torque_bias": sensing.torque_bias,
    "torque_delay": sensing.torque_delay,
    "quantization": sensing.quantization,
    "noise": sensing.noise,
    "load_inertia": load.load_inertia,
    "load_coulomb": load.load_coulomb,
    "gravity": load.gravity,
}
"""The effects that an examination judges, in the order of the effect table's stages."""


def examine(
    records: Record | Sequence[Record],
    joint: JointLike | None = None,
    structure: str | Structure | None = None,
) -> Examination:
    """Return what records can and cannot identify, and their faults.

    No model is fitted: the influence of an effect on the record is compared with the scatter of the
    channels, by plain least squares.

    Args:
        records: The record, or several of one joint, which are judged together.
        joint: The nominal joint, or its name or path; by default the one that the record names.
            Without one, sizes are in amperes.
        structure: How its bodies are joined; by default as the record or else the joint states, or
            as the channels suggest.

    Raises:
        ConfigurationError: These are no records.
        RecordError: There is no record, or it has fewer than 50 samples, lasts less than 0.2 s or
            has no channel.
        UnknownNameError: There is no such joint or structure.
        MissingFileError: There is no file of the joint.
        ParameterError: A body of the joint that moves freely has no inertia.

    Example:
        >>> from cjt_gym.records import read_record
        >>> "coulomb" in examine(read_record("emps")).can_tell
        True
    """
    given = as_records(records, "examine")
    if isinstance(joint, Joint) and structure is None:
        structure = joint.structure
    _check(given)
    file = named_joint(given[0]) if joint is None else joint_file_of(joint)
    return examination_of(given, file, None if structure is None else structure_of(structure))


def examination_of(
    records: Sequence[Record], joint: JointFile | None, structure: Structure | None
) -> Examination:
    """Return what `examine` does, of a joint that is loaded or, where it is None, unknown."""
    _check(records)
    absent = {name: row for one in records for name, row in unmeasured(one).items()}
    view = View.of(measured_only(records), joint, structure)
    driven, moved = driven_only(view.logged, view.structure)
    if moved and any(map(is_left, driven)):
        view = View.of([one for one in driven if is_left(one)], joint, view.structure)
    if joint is not None:
        check_bodies(joint.parameters, view.structure)
        for one in records:
            _check_axis(one, joint)
    with threadpool_limits(1, "blas"):  # threads slow down products of narrow matrices
        verdicts = {name: row(view) for name, row in ROWS.items()}
        wrong, remedies = faults(view)
        known = notes(view)
    replaced = [
        f"{name} {said}: it was not measured, and {command} counts alone."
        for name, (command, said) in absent.items()
    ]
    seen = {name: verdict for name, verdict in verdicts.items() if isinstance(verdict, Seen)}
    unseen = tuple(
        CannotTell(name, sentence(verdict.why), verdict.instead)
        for name, verdict in verdicts.items()
        if isinstance(verdict, Unseen)
    )
    advice = [*([ALONE] if moved else []), *remedies, *(row.instead for row in unseen)]
    return Examination(
        can_tell=tuple(seen),
        cannot_tell=unseen,
        faults=(*replaced, *moved, *wrong),
        smallest={name: (verdict.size, verdict.unit) for name, verdict in seen.items()},
        advice=_once(advice),
        channels=view.channels,
        notes=known,
        at_rest=view.at_rest,
        hardly_moves=no_balance(view) is TOO_FEW,
        back=min(view.both_ways),
    )


def _once(advice: Sequence[str]) -> tuple[str, ...]:
    """Return each advice once, and none that another one includes."""
    each = dict.fromkeys(filter(None, advice))
    asked = any(one.endswith("and the measured current.") for one in each)
    return tuple(one for one in each if not (asked and one == drive.MEASURE))


def sentence(words: str) -> str:
    """Return words as a sentence.

    Example:
        >>> sentence("no command is recorded")
        'No command is recorded.'
    """
    words = words.rstrip(".")
    first = words.split(" ", 1)[0]
    symbol = "_" in first or first in ("i", "tau", "v")
    return (words if symbol else words[0].upper() + words[1:]) + "."


def _check_axis(record: Record, joint: JointFile) -> None:
    """Refuse positions in rad of a prismatic joint, and in m of a rotary one."""
    axis, turns = joint.parameters.axis, {"rad", "rad/s", "N m"} & set(record.units.values())
    if record.prismatic == (axis == "prismatic") or not (record.prismatic or turns):
        return
    wanted, other = ("m and N", "rotary") if axis == "prismatic" else ("rad and N m", "prismatic")
    got = ", ".join(f"{name} in {unit}" for name, unit in record.units.items() if name != "t")
    raise RecordError(
        f"{record.owner} must be in {wanted}, as {joint.parameters.name} is {axis}, got {got}. Map "
        f'its columns with their units, or give a {other} joint (axis = "{other}").'
    )


def _check(records: Sequence[Record]) -> None:
    if not records:
        raise RecordError("An examination needs a record, got none.")
    for record in records:
        if len(record) < SHORTEST:
            raise RecordError(
                f"{record.owner} must have at least {SHORTEST} samples to be examined, "
                f"got {len(record)}. Record for longer."
            )
        span = float(record.t[-1] - record.t[0])
        if span < BRIEFEST:
            raise RecordError(
                f"{record.owner} must last at least {BRIEFEST} s to be examined, got {span:.3g} s. "
                "Record for longer, or map t with its unit."
            )
        if not any(measured(name, record) for name in record.columns):
            raise RecordError(
                f"{record.owner} has no measured channel but its time. Record at least one of i, "
                "i_cmd, q_m and tau."
            )
