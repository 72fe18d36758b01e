"""Effects that a joint file lists, as fields of the nominal model.

What is listed is part of the nominal joint: a diagnosis asks what is missing beside it. Rows that
only replace a datasheet value become that value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

from cjt_gym.gap.recorded.fields import Fields, has_friction
from cjt_gym.gap.recorded.tolerances import LEAST, SMOOTHING
from cjt_gym.joint import EFFECTS, JointFile, Structure
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.files.effect_entries import unit_on
from cjt_gym.joint.files.quantity import Quantity

SPAN = 2.0 * 1.96
"""Width of a 95 % interval in standard deviations."""
SLIP_SPAN = 3.0
"""Multiples of delta_h at which the one element of a Maxwell slip model yields."""
BODIES = "mgl"
UNSEEN = frozenset(
    {
        "noise",
        "quantization",
        "drift",
        "dropout",
        "command_noise",
        "velocity_differentiation",
        "human_torque",
        "load_motion",
    }
)
"""Effects that predictions of the stages need not know: scatter, and what is measured anyway."""

COULOMB = ("coulomb", "coulomb_asym")
"""Rows that set the same levels."""
Numbers = Mapping[str, Any]


class Place(NamedTuple):
    """Zeros of a record, and where its joint may have play.

    Attributes:
        zero: Offset subtracted from the motor's angle [rad].
        relaxed: Difference of the angles at which the spring is relaxed [rad].
        in_gear: Whether play lies in a compliant gear, not at the torsion bar.
        transmits: Whether the transmitted torque was measured.
    """

    zero: float
    relaxed: float
    in_gear: bool
    transmits: bool


def in_place_of(name: str) -> tuple[str, ...]:
    """Return the listed effects whose place a law takes that a diagnosis finds."""
    return COULOMB if name in COULOMB else (name,)


def as_values(file: JointFile, shape: Structure) -> JointFile:
    """Return a joint file whose rows of effects that replace datasheet values are these values.

    Friction that is listed without a level has that of the datasheet, which may be a guess. The
    ranges and the covariance of an earlier diagnosis are those of its record, and left out.
    """
    file = replace(_with_guesses(file), found={})
    p, kept, moved = file.parameters, dict(file.effects), {}
    for name, numbers in _resolved(file, shape).items():
        row = EFFECTS[name]
        if not all(parameter.relative_to == parameter.symbol for parameter in row.parameters):
            continue
        for parameter in row.parameters:
            symbol, entry = parameter.symbol, file.effects[name].get(parameter.symbol)
            old = p.quantities.get(symbol) or Quantity(0.0, unit_on(parameter, p))
            if numbers[symbol] != old.number:
                said = entry if isinstance(entry, Quantity) else old
                moved[symbol] = replace(
                    old,
                    value=float(numbers[symbol]),
                    source=said.source,
                    tolerance=_tolerance(said, old),
                    guess=said.guess,
                    low=None,
                    high=None,
                )
        del kept[name]
    if len(kept) == len(file.effects):
        return file
    return replace(file, parameters=p.replace(**moved), effects=kept)


def _with_guesses(file: JointFile) -> JointFile:
    """Return a joint file whose listed Coulomb friction states guesses of its levels itself."""
    known, listed = file.parameters.quantities, file.effects.get("coulomb")
    if listed is None:
        return file
    levels = {s: known[s] for s in (f"d_c{body}" for body in BODIES) if s in known}
    guesses = {symbol: level for symbol, level in levels.items() if level.guess}
    return replace(file, effects={**file.effects, "coulomb": {**guesses, **listed}})


def _tolerance(said: Quantity, old: Quantity) -> float | None:
    """Return the relative deviation of a value that replaces a datasheet's."""
    if isinstance(said.low, float) and isinstance(said.high, float) and said.number:
        return max((said.high - said.low) / (SPAN * abs(said.number)), LEAST)
    return said.tolerance if said.tolerance is not None else old.tolerance


def _resolved(file: JointFile, shape: Structure) -> dict[str, Any]:
    return resolve_effects(None, file, shape, file.drive or "current")


def with_listed(
    file: JointFile, shape: Structure, nominal: Fields, at: Place
) -> tuple[Fields, dict[str, Fields]]:
    """Return the fields of a joint with what its file lists, and what each effect adds to them.

    Args:
        file: The joint file, by `as_values`.
        shape: Structure of the joint.
        nominal: Fields of the joint without effects.
        at: Zeros of the record.

    Raises:
        ValueError: The fields cannot hold an effect that acts on what is measured.
    """
    fields, added = dict(nominal), {}
    for name, numbers in _resolved(file, shape).items():
        if name in UNSEEN:
            continue
        before = dict(fields)
        if name not in LISTED or not LISTED[name](fields, numbers, at):
            raise ValueError(f"the joint file lists {name}, which they cannot hold")
        for body in BODIES if SMOOTHING in numbers else ():
            if has_friction(fields, body):
                fields[f"dq_0_{body}"] = float(numbers[SMOOTHING])
        added[name] = {k: x - before[k] for k, x in fields.items() if x != before[k]}
    return fields, added


# ---- one function per effect, which returns whether the fields hold it
Put = Callable[[Fields, Numbers, Place], bool]


def _sets(**fields: str) -> Put:
    """Return the function of an effect whose numbers are fields."""

    def put(f: Fields, v: Numbers, at: Place) -> bool:
        f.update((field, float(v[symbol])) for field, symbol in fields.items())
        return True

    return put


def _lag(f: Fields, v: Numbers, at: Place) -> bool:
    bandwidth = float(v["bandwidth"])
    f["lag"] = 1.0 / (2.0 * math.pi * bandwidth) if bandwidth > 0.0 else 0.0
    return True


def _slew(f: Fields, v: Numbers, at: Place) -> bool:
    f["slew"] = float(v["rate"]) or math.inf
    return True


def _derating(f: Fields, v: Numbers, at: Place) -> bool:
    f["derate"] = float(v["derating"] * v["r"] * v["r_th1"])
    f["heat"] = float(v["T_thw"])
    return True


def _coulomb(f: Fields, v: Numbers, at: Place) -> bool:
    for body in BODIES:
        up = float(v.get(f"d_c{body}", 0.0))
        f[f"c_p_{body}"] += up
        f[f"c_n_{body}"] += float(v.get(f"d_c{body}_n", up))
    return True


def _viscous_asym(f: Fields, v: Numbers, at: Place) -> bool:
    for body in BODIES:
        f[f"d_n_{body}"] += float(v[f"d_{body}_n"]) - f[f"d_{body}"]
    return True


def _stribeck(f: Fields, v: Numbers, at: Place) -> bool:
    _coulomb(f, v, at)
    for body in BODIES:
        rise = float(v[f"d_s{body}"])
        f[f"s_p_{body}"] += rise
        f[f"s_n_{body}"] += rise
        f[f"v_s_{body}"] = float(v["v_s"]) if rise else 0.0
    return True


def _presliding(f: Fields, v: Numbers, at: Place) -> bool:
    _coulomb(f, v, at)
    for body in BODIES:
        stiffness = float(v[f"sigma_{body}"])
        f[f"z_s_{body}"] = f[f"c_p_{body}"] / stiffness if stiffness else 0.0
    return True


def _load_friction(f: Fields, v: Numbers, at: Place) -> bool:
    for body in BODIES:
        f[f"mu_{body}"] += float(v[f"mu_{body}"])
    return at.transmits


def _wave(prefix: str, *, transmitted: bool = False) -> Put:
    """Return the function of a torque over the motor's angle, of one frequency."""

    def put(f: Fields, v: Numbers, at: Place) -> bool:
        if len(v["f"]) != 1:
            return False
        (turns,), (a,), (b,) = v["f"], v["a"], v["b"]
        cos, sin = math.cos(turns * at.zero), math.sin(turns * at.zero)
        f[f"{prefix}_f"] = float(turns)
        f[f"{prefix}_a"] = float(v["scale"] * (a * cos + b * sin))
        f[f"{prefix}_b"] = float(v["scale"] * (b * cos - a * sin))
        return at.transmits or not transmitted

    return put


def _backlash(f: Fields, v: Numbers, at: Place) -> bool:
    """Set play in the gear or at the bar; the record tells where it lies between its ends."""
    f["play_g" if at.in_gear else "play"] = float(v["gap"])
    return at.transmits


def _hardening(f: Fields, v: Numbers, at: Place) -> bool:
    f["hard"] = float(v["k_3"]) / f["k_b"]
    return at.transmits


def _hysteresis(f: Fields, v: Numbers, at: Place) -> bool:
    slip = v["elements"] > 0.0
    f["hyst"], f["hyst_n"] = float(v["tau_h"]), 0.0 if slip else 1.0
    f["hyst_z"] = float(v["delta_h"]) * (SLIP_SPAN if slip else 1.0)
    return at.transmits


def _gravity(f: Fields, v: Numbers, at: Place) -> bool:
    angle = at.zero + at.relaxed - float(v["angle"])
    f["grav_a"] = float(v["torque"]) * math.sin(angle)
    f["grav_b"] = float(v["torque"]) * math.cos(angle)
    return True


LISTED: Final[Mapping[str, Put]] = {
    "command_delay": _sets(delay="delay"),
    "current_lag": _lag,
    "current_rate_limit": _slew,
    "command_quantization": _sets(step="resolution"),
    "thermal_derating": _derating,
    "torque_offset": _sets(offset="torque"),
    "coulomb": _coulomb,
    "coulomb_asym": _coulomb,
    "viscous_asym": _viscous_asym,
    "stribeck": _stribeck,
    "presliding": _presliding,
    "load_friction": _load_friction,
    "cogging": _wave("cog"),
    "gear_ripple": _wave("rip", transmitted=True),
    "backlash": _backlash,
    "hardening": _hardening,
    "spring_hysteresis": _hysteresis,
    "torque_gain": _sets(gain="gain"),
    "torque_bias": _sets(tau_0="bias"),
    "torque_delay": _sets(late="delay"),
    "load_coulomb": _coulomb,
    "gravity": _gravity,
}
"""Effects that the fields hold."""
