"""The channels a record may hold, and the units each of them may have.

A record holds SI values on the link side. A rotary joint has its angles in rad and its torques in
N m; a prismatic axis has positions in m and forces in N, under the same column names. A column with
the prefix ``true_`` is the same quantity without sensor effects; only a simulation can write it.
In a record of several joints the name of the joint stands before that of the column, as in
``elbow/q_m``.
"""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final

from cjt_gym.errors import RecordError

TRUE_PREFIX: Final = "true_"
JOINT_MARK: Final = "/"
"""Between the name of a joint and its column, in a record of several joints."""
ROTARY: Final = frozenset({"rad", "rad/s", "N m"})
PRISMATIC: Final = frozenset({"m", "m/s", "N"})


COMMANDS: Final = ("i_cmd", "i_extra", "tau_cmd", "tau_ref", "q_ref")
"""Columns whose value holds until the next one; the others are measured, and move in between."""


@dataclass(frozen=True)
class Column:
    """A channel that a record may hold.

    Attributes:
        name: Name of the column.
        units: Units it may have; the first one is the default.
        description: What it is, in one line.
    """

    name: str
    units: tuple[str, ...]
    description: str


ALIKE: Final = 0.65
"""Likeness from which a name is a misspelt column: "taw" is "tau", "fault" is nothing."""
_POSITION = ("rad", "m")
_VELOCITY = ("rad/s", "m/s")
_TORQUE = ("N m", "N")

COLUMNS: Final[dict[str, Column]] = {
    column.name: column
    for column in (
        Column("t", ("s",), "time of the sample, strictly increasing"),
        Column(
            "i_cmd",
            ("A", "V"),
            "command to the drive: a current, or the input voltage of its amplifier",
        ),
        Column(
            "i_extra",
            ("A", "V"),
            "part of i_cmd that was added to the controller's output as an excitation",
        ),
        Column("i", ("A",), "motor current (q axis)"),
        Column("i_d", ("A",), "motor current of the d axis"),
        Column("v", ("V",), "motor voltage (q axis)"),
        Column("v_d", ("V",), "motor voltage of the d axis"),
        Column("tau_cmd", _TORQUE, "commanded motor torque"),
        Column("tau_ref", _TORQUE, "reference of the joint torque"),
        Column("tau_m", _TORQUE, "motor torque, k_t n i"),
        Column("q_ref", _POSITION, "reference of the position"),
        Column("q_m", _POSITION, "motor angle, rotor angle / n"),
        Column("q_g", _POSITION, "angle at the gear output"),
        Column("q_l", _POSITION, "load angle"),
        Column("dq_m", _VELOCITY, "motor velocity"),
        Column("dq_g", _VELOCITY, "velocity at the gear output"),
        Column("dq_l", _VELOCITY, "load velocity"),
        Column("tau", _TORQUE, "measured joint torque"),
        Column("tau_l", _TORQUE, "external load torque, positive where it accelerates the load"),
        Column("temperature", ("degC",), "hottest temperature that the drive reports"),
        Column("age", ("s",), "age of the motor angle where the control loop used it"),
        Column("lateness", ("s",), "of the command behind the deadline of its control step"),
        Column(
            "round_trip",
            ("s",),
            "from the command before to the first report after it; 0 where none came in time",
        ),
    )
}


def column_of(name: str) -> Column:
    """Return the row of the column table for a column, with or without the prefix ``true_``."""
    joint, _, plain = name.rpartition(JOINT_MARK)
    row = COLUMNS.get(plain.removeprefix(TRUE_PREFIX))
    if row is None or plain == TRUE_PREFIX + "t" or (joint and plain == "t"):
        meant = _meant(name)
        raise RecordError(
            f"Unknown column '{name}'."
            + (f" Did you mean '{meant}'?" if meant else "")
            + f" Known: {', '.join(sorted(COLUMNS))}. Noise-free states: the same with the prefix "
            f"{TRUE_PREFIX}."
        )
    return row


def _meant(name: str) -> str | None:
    """Return the column that is known by that word, or that is spelt nearly so."""
    from cjt_gym.records.draft import guess  # which needs the columns itself

    return guess(name) or next(iter(get_close_matches(name, COLUMNS, n=1, cutoff=ALIKE)), None)


def default_units(names: tuple[str, ...], prismatic: bool = False) -> dict[str, str]:
    """Return the usual SI unit of each named column.

    Example:
        >>> default_units(("t", "q_m", "true_tau"))
        {'t': 's', 'q_m': 'rad', 'true_tau': 'N m'}
        >>> default_units(("q_m", "i_cmd"), prismatic=True)
        {'q_m': 'm', 'i_cmd': 'A'}

    Raises:
        RecordError: A name is not one a record may hold.
    """
    found = {name: column_of(name).units for name in names}
    return {
        name: next((unit for unit in units if prismatic and unit in PRISMATIC), units[0])
        for name, units in found.items()
    }


def check_unit(owner: str, name: str, unit: str) -> None:
    """Raise RecordError unless ``unit`` is one that column ``name`` may have."""
    allowed = column_of(name).units
    if unit not in allowed:
        raise RecordError(
            f"The unit of column {name!r} of {owner} must be {' or '.join(map(repr, allowed))}, "
            f"got {unit!r}. Convert the values to SI units on the link side, or give their unit "
            "in a mapping beside the log (NAME.map.toml), which converts them."
        )


def check_one_axis(owner: str, units: dict[str, str]) -> None:
    """Raise RecordError where some columns are in rotary and others in prismatic units."""
    rotary = [name for name, unit in units.items() if unit in ROTARY]
    prismatic = [name for name, unit in units.items() if unit in PRISMATIC]
    if rotary and prismatic:
        raise RecordError(
            f"The units of {owner} must all be rotary (rad, rad/s, N m) or all prismatic (m, m/s, "
            f"N), got {rotary[0]!r} in {units[rotary[0]]!r} and {prismatic[0]!r} in "
            f"{units[prismatic[0]]!r}. Convert one of them to the link side's unit."
        )
