"""A draft of a mapping for a log with columns of its own, guessed from their names."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.records.tables.flat import NUMBERS
from cjt_gym.records.units import USUAL, units_of, usual_name

UNKNOWN: Final = "?"
BRIEF: Final = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
BRIEFEST: Final = 2e-5
"""Units of time that a name may have wrongly [s], and the sample time below which it has [s]."""
HEAD: Final = """\
# Draft: which column of {log} is which, guessed from the names. Check every guess, replace every
# "?", and delete what is not needed. sign, scale, offset and more: docs/records.md.
# joint = "joint.toml"  # nominal joint: a name, or a file beside the log
# structure = "rigid"  # one of those that  cjt-gym joints  lists
# n = 100  # gear ratio, needed for side = "motor" unless the joint gives it
"""
KINDS: Final = {
    "temperature": "temp temperature temperatur degc",
    "t": "t time timestamp stamp clock zeit tiempo tempo ms us ns sec seconds",
    "dq": (
        "dq qd qdot vel velocity speed omega w rpm dtheta deg/s rad/s dps drehzahl geschwindigkeit "
        "vitesse velocidad"
    ),
    "i": "i iq icmd iref current cur curr amp amps ampere ma strom courant corriente corrente",
    "v": "u v uq vq volt volts voltage mv spannung",
    "tau": "tau torque trq moment nm drehmoment",
    "q": (
        "q pos position ang angle theta phi enc encoder deg grad rad rev counts winkel angulo "
        "posicion"
    ),
}
"""Words by which a quantity is known, those that also occur in others' names last."""
COMMAND: Final = "cmd icmd command commanded set setpoint soll target des desired demand goal"
REFERENCE: Final = "ref iref reference"
LOAD: Final = "l load link out output joint arm"
GEAR: Final = "g gear"
MOTOR: Final = "m motor rotor"
OUTSIDE: Final = "load ext external"
OTHERS: Final = "gravity hall pid gain"
"""Words of what is computed, or measured for something else."""
OTHER_SIDE: Final = {"q_m": "q_l", "dq_m": "dq_l"}
"""What the second of two equal sensors, or one beside the motor's, measures: the other side of a
spring."""
SIDED: Final = ("q_m", "dq_m", "tau_m", "tau_cmd")


def draft(log: str, table: Mapping[str, NDArray[Any]]) -> str:
    """Return the text of a mapping to be edited, from the columns of a log or their beginning.

    Example:
        >>> print(draft("a.csv", {"motor_pos_deg": np.array([0.0, 90.0])}).splitlines()[-4])
        [columns.q_m]  # from 0 to 90
    """
    guesses: dict[str, str] = {}
    rest: list[str] = []
    longest = max(map(len, table.values()), default=0)
    for name, values in table.items():
        column = guess(name) if _has_numbers(values) else None
        if column == "t" and 2 * len(values) < longest:
            column = None  # the time of something else
        first = guesses.get(column or "", "")
        if column in OTHER_SIDE and first:
            other = OTHER_SIDE[column]
            if _is_of_motor(name) and not _is_of_motor(first) and other not in guesses:
                guesses[column], name = name, first
            if _is_second(name, first) or _is_of_motor(guesses[column]):
                column = other
        if column is None or column in guesses:
            rest.append(f"# [columns.{UNKNOWN}]{_range(values)}\n# source = {_quoted(name)}\n")
        else:
            guesses[column] = name
    head = HEAD.format(log=log)
    if "t" not in guesses:
        head += f'dt = "{UNKNOWN}"  # sample time [s], as no column looks like the time\n'
    tables = [_table(column, name, table[name]) for column, name in guesses.items()]
    return "\n".join([head, *tables, *rest])


def guess(name: str) -> str | None:
    """Return the column of a record that a name suggests; None where it suggests none.

    Example:
        >>> guess("Motor Speed (rpm)"), guess("iq_ref"), guess("gripper")
        ('dq_m', 'i_cmd', None)
    """
    words = _words(name)
    kinds = [kind for kind, known in KINDS.items() if _any(known, words)]
    if "t" in kinds and len(kinds) > 1 and words & {"t"} and not _any(KINDS["t"], words - {"t"}):
        kinds.remove("t")  # T as in torque
    kind = next(iter(kinds), None)
    commanded, reference = _any(COMMAND, words), _any(REFERENCE, words)
    if kind in (None, "t", "temperature"):
        return kind
    if _any(OTHERS, words):
        return None
    if kind == "i" or kind == "v":
        return "i_cmd" if commanded or reference else kind
    if kind == "tau":
        asked = "tau_cmd" if commanded else "tau_ref" if reference else None
        sensor = "tau_l" if _any(OUTSIDE, words) and "cell" not in words else "tau"
        bare = words.isdisjoint({"tau", "torque"})  # M as in moment
        return asked or ("tau_m" if _any(MOTOR, words - {"m"} if bare else words) else sensor)
    if commanded or reference:
        return "q_ref" if kind == "q" else None
    return kind + ("_l" if _any(LOAD, words) else "_g" if _any(GEAR, words) else "_m")


def _is_of_motor(name: str) -> bool:
    """Return whether a name says that a sensor is the motor's."""
    return not _words(name).isdisjoint({"motor", "rotor"})


def _is_second(name: str, first: str) -> bool:
    """Return whether two names differ by their numbers alone, as Encoder 1 and Encoder 2."""
    plain = (re.sub(r"\d+", "", one) for one in (name, first))
    return len(set(plain)) == 1 and name != first


def _words(name: str) -> set[str]:
    """Return the words of a name in small letters, with units of more than one word as one."""
    own = re.sub(r"\bmN\W?m\b", "Nm", name.rpartition(":")[2] or name)
    plain = re.sub(r"([a-z])([A-Z][a-z])", r"\1 \2", own).lower()
    words = set(re.findall(r"[a-z]+", plain))
    return words | {f"{unit}/s" for unit in re.findall(r"(deg|rad)(?:/|_|p|ps|/sec)s", plain)}


def _any(known: str, words: set[str]) -> bool:
    return not words.isdisjoint(known.split())


def _table(column: str, name: str, values: NDArray[Any]) -> str:
    allowed = units_of(column)
    unit = allowed[0] if len(allowed) == 1 else _unit(name, allowed)
    lines = [
        f"[columns.{column}]{_range(values)}",
        f"source = {_quoted(name)}",
    ]
    among = "" if unit else f"  # {', '.join(allowed)}"
    if column == "t" and unit in BRIEF and _apart(values) * BRIEF[unit] < BRIEFEST:
        among = f"  # its name says {unit}, but rows would be {_apart(values):.2g} {unit} apart"
        unit = None
    lines.append(f'unit = "{unit or UNKNOWN}"{among}')
    if unit in ("counts", "counts/s"):
        lines.append(f'counts_per_rev = "{UNKNOWN}"')
    if column == "v":
        lines.append("# if it commands a current: [columns.i_cmd], and k_t of the joint in N m/V")
    if column in SIDED:
        lines.append('side = "?"  # motor: taken before the gear; link: after it, or there is none')
    return "\n".join(lines) + "\n"


def _apart(values: NDArray[Any]) -> float:
    """Return the usual difference of two instants that are not the same."""
    steps = np.diff(values.astype(np.float64))
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else np.inf


def _unit(name: str, allowed: tuple[str, ...]) -> str | None:
    """Return the unit at the end of a name: ``pos_deg``, ``Speed (rpm)``, ``vel_deg_s``."""
    words = [word for word, unit in USUAL.items() if unit in allowed]
    for unit in sorted([*allowed, *words], key=len, reverse=True):
        pattern = re.escape(unit).replace("/", "[/_]").replace(r"\ ", "[ ._*]?")
        if re.search(rf"(?:^|[\W_]){pattern}[\])]?$", name):
            return usual_name(unit)
    if "deg" in allowed and re.search(r"(?:^|[\W_])grad[\])]?$", name):
        return "deg"
    return "deg/s" if "deg/s" in allowed and re.search(r"(?:^|[\W_])dps[\])]?$", name) else None


def _has_numbers(values: NDArray[Any]) -> bool:
    return values.dtype.kind in NUMBERS and values.ndim == 1 and bool(np.isfinite(values).any())


def _quoted(name: str) -> str:
    return json.dumps(name, ensure_ascii=False)


def _range(values: NDArray[Any]) -> str:
    """Return from where to where values go, as a comment."""
    if not _has_numbers(values):
        return "  # no numbers"
    return f"  # from {np.nanmin(values):.6g} to {np.nanmax(values):.6g}"
