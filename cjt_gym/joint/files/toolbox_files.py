"""Reads parameter files of the Compliant Joint Toolbox: MATLAB scripts that assign numbers.

    params.('I_m') = 9.407e-02;    % rotor
    params.k_b     = 21000;

A file is parsed, never executed. Besides comments and the frame of a function, it may only contain
assignments of numbers and lists of numbers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cjt_gym.errors import did_you_mean
from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.files.joint_file import JointFile, load_joint_file, read_joint_text
from cjt_gym.joint.files.mistakes import Mistakes
from cjt_gym.joint.files.parameter_table import PARAMETERS
from cjt_gym.joint.files.parameters import JointParameters, check_quantities
from cjt_gym.joint.files.quantity import FrozenMapping, Quantity

RENAMED = {"x": "l_a"}
SAMPLING = {"Ts": "dt", "Ts_elec": "dt_electrical"}
RIPPLE = {"rip_types": "types", "rip_f": "f", "rip_a1": "a", "rip_a2": "b"}
RIPPLE_EFFECTS = {1.0: "cogging", 2.0: "gear_ripple"}
_SYMBOL = r"(?:\w+\s*\.\s*)?(?:\(\s*['\"](?P<quoted>\w+)['\"]\s*\)|(?P<plain>\w+))"
_ASSIGNMENT = re.compile(rf"{_SYMBOL}\s*=\s*(?P<value>[^;]*?)\s*;?")
_FRAME = re.compile(r"(function\b.*|end|return|clear.*|clc|\w+\s*=\s*(struct(\(\s*\))?|\[\s*\]));?")


@dataclass(frozen=True)
class Assigned:
    """The number or numbers that a line assigns, and its position."""

    value: float | tuple[float, ...]
    source: str


def read_toolbox(path: str | Path, defaults: str | Path | None = None) -> JointFile:
    """Return the joint that a parameter file of the toolbox describes, its lines as the sources.

    Sensors are not in such a file. Its ripple becomes the effects `cogging` and `gear_ripple`.

    Args:
        path: The file (`.m`).
        defaults: Joint from which everything comes that the file does not assign; "generic" has
            the defaults of the toolbox. Without it the joint has what the file assigns.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: A line is no assignment of numbers, or assigns what does not exist or is
            out of range; all that is wrong.
    """
    file, origin = Path(path).expanduser(), str(path)
    mistakes = Mistakes(origin)
    assigned = _assignments(read_joint_text(file), file.name, origin, mistakes)
    if not assigned:
        mistakes.found.append(f"{origin} assigns no number, such as  params.('k_b') = 6000;")
    quantities = _parameters(assigned, origin, mistakes)
    with mistakes.collected():
        check_quantities(quantities, "rotary", origin)
    effects = _ripple(assigned, origin, mistakes)
    sampling = {
        SAMPLING[symbol]: Quantity(_number(row, symbol, origin, mistakes), "s", row.source)
        for symbol, row in assigned.items()
        if symbol in SAMPLING
    }
    mistakes.check()
    source = f"parameter file {file.name} of the Compliant Joint Toolbox"
    base = None if defaults is None else load_joint_file(defaults)
    if base is None:
        parameters = JointParameters(file.stem, source, quantities, origin=origin)
        return JointFile(parameters, effects, sampling=sampling)
    whole = replace(base.parameters, name=file.stem, origin=origin).replace(**quantities)
    whole = replace(whole, source=f"{source}; what it leaves open is that of {base.name}")
    return replace(base, parameters=whole, effects=effects, sampling={**base.sampling, **sampling})


def _assignments(text: str, name: str, origin: str, mistakes: Mistakes) -> dict[str, Assigned]:
    found = {}
    for number, line in enumerate(text.splitlines(), 1):
        code = line.split("%")[0].strip()
        if not code or _FRAME.fullmatch(code):
            continue
        match = _ASSIGNMENT.fullmatch(code)
        value = None if match is None else _value(match["value"])
        if match is None or value is None:
            mistakes.found.append(
                f"Line {number} of {origin} must assign a number, such as  params.('k_b') = 6000; "
                f"got {code!r}. Write the number that it stands for."
            )
            continue
        found[match["quoted"] or match["plain"]] = Assigned(value, f"{name}, line {number}")
    return found


def _value(text: str) -> float | tuple[float, ...] | None:
    try:
        if text.startswith("[") and text.endswith("]"):
            return tuple(float(part) for part in re.split(r"[,\s]+", text[1:-1].strip()) if part)
        return float(text)
    except ValueError:
        return None


def _parameters(
    assigned: Mapping[str, Assigned], origin: str, mistakes: Mistakes
) -> dict[str, Quantity]:
    others = {*SAMPLING, *RIPPLE}
    found = {}
    for symbol, row in assigned.items():
        name = RENAMED.get(symbol, symbol)
        if symbol in others:
            continue
        if name not in PARAMETERS:
            known = [*PARAMETERS, *RENAMED, *others]
            mistakes.found.append(
                f"{origin} assigns the unknown parameter '{symbol}' ({row.source})."
                f"{did_you_mean(symbol, known)} Known: {', '.join(known)}."
            )
            continue
        found[name] = Quantity(row.value, PARAMETERS[name].units["rotary"][0], row.source)
    return found


def _number(row: Assigned, symbol: str, origin: str, mistakes: Mistakes) -> float:
    if isinstance(row.value, tuple) or not row.value > 0.0:
        mistakes.found.append(f"{symbol} of {origin} must be one number > 0 s, got {row.value}.")
        return 1.0
    return row.value


def _ripple(
    assigned: Mapping[str, Assigned], origin: str, mistakes: Mistakes
) -> FrozenMapping[FrozenMapping[Quantity]]:
    """Return the ripple as effects: type 1 has amplitudes in N m, type 2 is relative."""
    series = {key: assigned[symbol] for symbol, key in RIPPLE.items() if symbol in assigned}
    values = {k: v.value if isinstance(v.value, tuple) else (v.value,) for k, v in series.items()}
    if not any(values.values()):
        return FrozenMapping()
    if len(values) < len(RIPPLE) or len({len(row) for row in values.values()}) > 1:
        lengths = {symbol: len(values.get(key, ())) for symbol, key in RIPPLE.items()}
        mistakes.found.append(f"The ripple of {origin} must be of equal length, got {lengths}.")
        return FrozenMapping()
    found = {}
    for kind in sorted(set(values["types"])):
        if kind not in RIPPLE_EFFECTS:
            mistakes.found.append(f"rip_types of {origin} must be 1 or 2, got {kind:g}.")
            continue
        name = RIPPLE_EFFECTS[kind]
        chosen = [k for k, other in enumerate(values["types"]) if other == kind]
        entries = {}
        for key in ("f", "a", "b"):
            row = EFFECTS[name].parameter(key)
            assert row is not None
            numbers = tuple(values[key][k] for k in chosen)
            entries[key] = Quantity(numbers, row.unit, series[key].source)
        found[name] = FrozenMapping(entries)
    return FrozenMapping(found)
