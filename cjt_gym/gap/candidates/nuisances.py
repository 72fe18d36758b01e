"""Numbers free in every fit: datasheet values within tolerances, offsets, sample timing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import Fields, body_group, own_field
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.recorded.spring_damping import SYMBOL, critical, is_stated
from cjt_gym.gap.recorded.tolerances import GUESSED, assumed_tolerance, tolerance_of
from cjt_gym.joint.files.quantity import Quantity

LATE = 2e-5
"""Standard deviation of the delay of one channel relative to another [s]."""
CURRENT_OFFSET, TORQUE_OFFSET = 0.35, 0.75
"""Deviation of a sensor's offset, in units of its noise."""
USUAL_CURRENT, USUAL_TORQUE = 0.004, 0.03
"""Smallest standard deviation of the offsets of current [A] and torque [N m]."""
USUAL_COMMAND = 1e-3
"""Standard deviation of an amplifier's offset, as a share of the range of its command."""
FRICTION = {f"c_p_{body}": f"d_c{body}" for body in "mgl"}
"""Symbol in the joint file of each field that is a level of Coulomb friction."""
WEIGHT = ("grav_a", "grav_b")
"""Fields of a weight, its two components."""
OWN = ("i_0", "tau_0", "q_0", "centre_g")
"""Fields that differ from record to record of one joint."""
BLURRED = 0.3
"""Relative deviation of inertia and damping if a log is too slow to follow the joint's swing."""
LAG_TOLERANCE = 0.2
UNSTATED = 0.05
"""Deviation of the damping of a spring that a joint file does not state, over the critical one."""
STRETCH, FURTHEST, ANYWHERE = 30.0, 5.0, 100.0
"""Largest change of a datasheet value in a fit: in standard deviations, as a factor, and as a
factor of a guess."""
HELD = 0.3
"""Standard deviation of the instant at which a drive latches its command, in samples."""


@dataclass(frozen=True)
class Nuisance:
    """A number that is free in every fit: the field that it sets, and the stages it affects."""

    field: str
    unknown: Number
    stages: tuple[str, ...]
    along: tuple[str, ...] = ()  # fields that change by the same factor: guesses of one mass

    def put(self, fields: Fields, nominal: Fields, z: float) -> None:
        """Set its fields for a coordinate."""
        value = self.unknown.value(z)
        fields[self.field] = value
        for other in self.along:
            fields[other] = nominal[other] * value / nominal[self.field]


def nuisances(setting: Setting, stages: tuple[str, ...]) -> tuple[Nuisance, ...]:
    """Return the numbers that are free in every fit of a record."""
    found = [*_parameters(setting), *_friction(setting), *_weight(setting), *_offsets(setting)]
    kept = [replace(n, stages=tuple(s for s in n.stages if s in stages)) for n in found]
    return tuple(n for n in kept if n.stages)


def nuisances_of_others(
    first: Sequence[Nuisance], others: Sequence[tuple[Setting, tuple[str, ...]]]
) -> tuple[Nuisance, ...]:
    """Return the numbers that may differ in further records: offsets and zeros.

    Args:
        first: Numbers that are free in the first record.
        others: Settings of the further records, each with its stages.
    """
    found = []
    starts = {n.field: n.unknown.start for n in first}
    for number, (setting, stages) in enumerate(others, 1):
        for own in nuisances(setting, stages):
            if own.field in OWN and own.field in starts:
                start = own.unknown.start - starts[own.field]
                unknown = replace(own.unknown, start=start, symbol=own_field(own.field, number))
                found.append(Nuisance(unknown.symbol, unknown, own.stages))
    return tuple(found)


def stages_of(setting: Setting, field: str) -> tuple[str, ...]:
    """Return the stages that depend on a field of the chain."""
    both = ("motor", "transmission")
    of_body = {"m": ("motor",), "g": both if setting.has_gear else ("motor",), "l": ("load",)}
    touched = {
        "k_t": ("motor",),
        "k_g": both,
        "d_mg": both,
        "k_b": ("transmission",),
        "d_gl": ("transmission",),
        "grav_a": ("load",),
        "grav_b": ("load",),
    }
    return setting.stages_of(*(touched.get(field) or of_body[field[-1]]))


def tolerance(setting: Setting, field: str) -> float:
    """Return the relative deviation of a datasheet value."""
    if setting.too_slow and field[0] in "Id":
        return BLURRED
    quantity = setting.joint.parameters.quantities.get(field)
    if quantity is not None and quantity.tolerance is not None:
        return max(quantity.tolerance, 1e-4)
    if _is_guess(setting, field):
        return GUESSED
    return assumed_tolerance(field)


def guesses_of(setting: Setting, body: str) -> tuple[str, ...]:
    """Return the guessed inertias of the bodies that move as one with a body."""
    together = [f"I_{b}" for b in body_group(setting.structure, body)]
    return tuple(s for s in together if setting.nominal[s] > 0.0 and _is_guess(setting, s))


def _is_guess(setting: Setting, field: str) -> bool:
    """Return whether a datasheet value is a guess without a tolerance."""
    quantity = setting.joint.parameters.quantities.get(field)
    if quantity is None or quantity.tolerance is not None:
        return False
    return not np.isfinite(tolerance_of(setting.joint, field, 0.0))


def active_parameters(setting: Setting) -> tuple[str, ...]:
    """Return the datasheet values that this structure depends on, one per lumped body.

    Of an inertia of which a part is a guess, it is the guess.
    """
    names = ["k_t", "I_m", "d_m"]
    if setting.has_gear:
        names += ["I_g", "d_g", "k_g", "d_mg"]
    elif setting.nominal["d_m"] < setting.nominal["d_g"]:
        names[2] = "d_g"
    if setting.has_spring:
        names += ["k_b", "d_gl"]
        if not setting.structure.output_fixed:
            names += ["I_l", "d_l"]
    guessed = {f"I_{b}": guesses_of(setting, b)[:1] for b in "mgl"}
    names = [(guessed.get(name) or (name,))[0] for name in names]
    return tuple(name for name in names if setting.nominal[name] > 0.0)


def _parameters(setting: Setting) -> list[Nuisance]:
    rows = []
    for name in active_parameters(setting):
        scale = _lumped_tolerance(setting, name)
        unit = setting.joint.parameters.unit(name)
        most = ANYWHERE if _is_guess(setting, name) else FURTHEST
        unknown = _relative(name, unit, setting.nominal[name], scale, most)
        along = guesses_of(setting, name[2])[1:] if name.startswith("I_") else ()
        rows.append(Nuisance(name, unknown, stages_of(setting, name), along))
    if setting.has_spring and not is_stated(setting.joint):
        most = critical(setting.joint, setting.structure)
        unit = setting.joint.parameters.unit(SYMBOL)
        unknown = Number(SYMBOL, unit, 0.0, UNSTATED * most, low=0.0, high=most)
        rows.append(Nuisance(SYMBOL, unknown, stages_of(setting, SYMBOL)))
    return rows


def _friction(setting: Setting) -> list[Nuisance]:
    """Return the levels of Coulomb friction that the file lists with a tolerance, or as guesses."""
    effects, rows = setting.joint.effects, []
    listed_levels = {} if "presliding" in effects else effects.get("coulomb", {})
    for field, symbol in FRICTION.items():
        listed, start = listed_levels.get(symbol), setting.nominal[field]
        if not isinstance(listed, Quantity) or start <= 0.0:
            continue
        if not (listed.tolerance or listed.guess):
            continue
        far = ANYWHERE if listed.guess else FURTHEST
        unknown = _relative(field, "N m", start, listed.tolerance or GUESSED, far)
        rows.append(Nuisance(field, unknown, stages_of(setting, field), (f"c_n_{field[-1]}",)))
    return rows


def _weight(setting: Setting) -> list[Nuisance]:
    """Return the size of a weight that the joint file lists with a tolerance, or as a guess."""
    listed = setting.joint.effects.get("gravity", {}).get("torque")
    if not isinstance(listed, Quantity) or not (listed.tolerance or listed.guess):
        return []
    field, other = sorted(WEIGHT, key=lambda name: -abs(setting.nominal[name]))
    start, scale = setting.nominal[field], listed.tolerance or GUESSED
    if start == 0.0:
        return []
    unknown = _relative(field, "N m", start, scale, ANYWHERE if listed.guess else FURTHEST)
    return [Nuisance(field, unknown, stages_of(setting, field), (other,))]


def _relative(field: str, unit: str, start: float, scale: float, most: float) -> Number:
    """Return a value known within a relative deviation, which may change by a factor at most."""
    far = min(float(np.exp(STRETCH * scale)), most)
    low, high = sorted((start / far, start * far))
    return Number(field, unit, start, scale, log=True, low=low, high=high)


def _lumped_tolerance(setting: Setting, name: str) -> float:
    """Return the tolerance of a value, including those of values lumped with it."""
    if not re.fullmatch("[Id]_[mgl]", name):
        return tolerance(setting, name)
    if name[0] == "I" and guesses_of(setting, name[2]) and not setting.too_slow:
        return GUESSED
    fields = [name[:2] + body for body in body_group(setting.structure, name[2])]
    total = sum((tolerance(setting, f) * setting.nominal[f]) ** 2 for f in fields)
    return float(np.sqrt(total)) / setting.nominal[name]


def _offsets(setting: Setting) -> list[Nuisance]:
    series = setting.series
    rows = []
    if "i" in series:
        scale = max(CURRENT_OFFSET * setting.std("i"), USUAL_CURRENT)
        rows.append(_offset("i_0", "A", 0.0, scale, ("drive", "motor")))
        rows.append(
            _offset("w_i", "-", 0.5, 0.1, ("motor",))
            if series.slow
            else _offset("w_i", "-", _current_weight(setting.nominal, series.dt), 0.3, ("motor",))
        )
    else:
        p = setting.nominal
        limit = p["i_max"] if np.isfinite(p["i_max"]) else float(np.ptp(series["i_cmd"]))
        rows.append(_offset("i_0", "A", 0.0, USUAL_COMMAND * limit, ("motor",)))
    if "i" in series and "i_cmd" in series and setting.nominal["lag"] > 0.0:
        start, far = setting.nominal["lag"], float(np.exp(3.0 * LAG_TOLERANCE))
        lag = Number("lag", "s", start, LAG_TOLERANCE, True, low=start / far, high=start * far)
        rows.append(Nuisance("lag", lag, ("drive",)))
    if "i_cmd" in series:
        dt, start = series.dt, setting.nominal["delay"]
        low = start - dt if series.slow else start
        middle = start - 0.5 * dt if series.slow else start
        delay = Number("delay", "s", middle, HELD * dt, low=low, high=start + dt)
        rows.append(Nuisance("delay", delay, ("drive",) if "i" in series else ("motor",)))
    if setting.cut is Cut.BY_TORQUE:
        scale = max(TORQUE_OFFSET * setting.std("tau"), USUAL_TORQUE)
        rows.append(
            _offset(
                "tau_0", "N m", setting.nominal["tau_0"], scale, ("motor", "transmission", "load")
            )
        )
        rows.append(_offset("skew", "s", 0.0, LATE, ("transmission",)))
    if (play := setting.nominal["play_g"]) > 0.0:
        half, touched = 0.5 * play, ("motor", "transmission")
        centre = Number("centre_g", "rad", 0.0, half, low=-half, high=half, prior=False)
        rows.append(Nuisance("centre_g", centre, touched))
    if setting.has_spring:
        rows.append(_relaxed(setting))
    return rows


def _offset(field: str, unit: str, start: float, scale: float, stages: tuple[str, ...]) -> Nuisance:
    return Nuisance(field, Number(field, unit, start, max(scale, 1e-12)), stages)


def _relaxed(setting: Setting) -> Nuisance:
    """Return the deflection at which the spring is relaxed."""
    scale = max(float(np.std(setting.twist)), setting.std("q_m")) * 0.1
    unknown = Number("q_0", "rad", setting.relaxed, scale, prior=False)
    return Nuisance("q_0", unknown, setting.stages_of("transmission"))


def _current_weight(nominal: Fields, dt: float) -> float:
    """Return the weight of the newer current sample for a held command and a first-order lag."""
    lag = nominal["lag"]
    if lag <= 0.0:
        return 0.9
    a = float(np.exp(-dt / lag))
    return (1.0 - lag / dt * (1.0 - a)) / (1.0 - a)
