"""What can vary on a joint: its names, their nominal values, domains and kernel fields."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cjt_gym.errors import ConfigurationError, check_name, unknown_name
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.batch import INERTIAS
from cjt_gym.joint.configure import BASE_FIELDS
from cjt_gym.joint.effects import Effect, EffectParameter
from cjt_gym.joint.files.parameters import PARAMETERS
from cjt_gym.plant.randomization.variation import Variation


@dataclass(frozen=True)
class Domain:
    """Values that a number may take."""

    low: float  # lowest value
    strict: bool  # whether the lowest value itself is forbidden
    high: float  # highest value
    unit: str  # unit of all of them

    def holds(self, low: float, high: float) -> bool:
        """Whether all values from low to high are allowed."""
        return (low > self.low if self.strict else low >= self.low) and high <= self.high

    def __str__(self) -> str:
        text = f"{'>' if self.strict else '>='} {self.low:g}"
        text += f" and <= {self.high:g}" if math.isfinite(self.high) else ""
        return text if self.unit == "-" else f"{text} {self.unit}"


@dataclass(frozen=True)
class Target:
    """One number that can vary."""

    name: str  # its name, such as "k_b" or "coulomb.d_cm"
    nominal: float  # its value without randomisation; NaN where the joint gives none
    domain: Domain  # what it may be
    fields: tuple[str, ...]  # kernel parameters that it changes
    replaces: bool = False  # whether it sets them; else it adds to them what differs from nominal
    relative_to: str | None = None  # kernel parameter from which its field is counted, or None

    def span(self, variation: Variation, owner: str) -> tuple[float, float]:
        """Return the lowest and highest value under a variation; messages name the owner."""
        if math.isnan(self.nominal) and variation.operation != "set":
            raise ConfigurationError(
                f"randomization of {self.name} cannot {variation.operation} a value that {owner} "
                'does not have. Give the value, or use operation = "set".'
            )
        ends = [self.changed(variation.operation, end) for end in variation.span]
        low, high = min(ends), max(ends)
        if not self.domain.holds(low, high):
            beyond = high if high > self.domain.high else low
            which = "highest" if high > self.domain.high else "lowest"
            raise ConfigurationError(
                f"randomization of {self.name} of {owner} must keep the value {self.domain}, got a "
                f"{which} value of {beyond:g}. Change the end of the draw."
            )
        return low, high

    def changed(self, operation: str, draw: float) -> float:
        """Return the value that a draw gives."""
        if operation == "set":
            return draw
        return self.nominal * draw if operation == "scale" else self.nominal + draw


def variable_names(joint: Joint) -> tuple[str, ...]:
    """Return the names of all that can vary: base parameters, then those of active effects."""
    return (
        *BASE_FIELDS,
        *(f"{name}.{p.symbol}" for name in joint.effects for p in _scalars(EFFECTS[name])),
    )


def find_target(joint: Joint, name: str) -> Target:
    """Return what a name such as "k_b" or, of an active effect, "coulomb.d_cm" stands for."""
    if "." not in name:
        if name not in BASE_FIELDS:
            raise unknown_name("parameter to randomise", name, variable_names(joint))
        absent = np.nan if name in ("i_p", "k_g", "k_b", "n", "k_t", "r", "v_0", "p") else 0.0
        nominal = joint.parameters.get(name, absent)
        return Target(name, nominal, base_domain(joint, name), (name,), math.isnan(nominal))
    effect, symbol = name.split(".", 1)
    check_name("active effect to randomise", effect, joint.effects)
    scalars = {p.symbol: p for p in _scalars(EFFECTS[effect])}
    check_name(f"scalar parameter of effect {effect}", symbol, scalars)
    parameter, value = scalars[symbol], joint.effects[effect][symbol]
    assert isinstance(value, float)
    replaces = parameter.replaces or parameter.shared
    return Target(
        name,
        value,
        _effect_domain(joint, EFFECTS[effect], parameter),
        parameter.fields,
        replaces,
        None if replaces else parameter.relative_to,
    )


def base_domain(joint: Joint, name: str) -> Domain:
    """Return the domain of a base parameter in the structure and with the drive of a joint."""
    spec = PARAMETERS[name]
    strict = spec.exclusive or (name == "l_a" and joint.drive in ("rl", "dq"))
    if name in INERTIAS:
        groups = joint.structure_row.groups
        group = groups[INERTIAS.index(name)]
        # A body that is first in its coordinate must have inertia; others come on top of it.
        strict = group >= 0 and groups.index(group) == INERTIAS.index(name)
    return Domain(spec.minimum, strict, math.inf, joint.parameters.unit(name))


def _effect_domain(joint: Joint, effect: Effect, parameter: EffectParameter) -> Domain:
    if parameter.replaces:
        return base_domain(joint, parameter.fields[0])
    low, strict, high = effect.domain(parameter)
    return Domain(low, strict, high, parameter.unit)


def _scalars(effect: Effect) -> list[EffectParameter]:
    return [p for p in effect.parameters if p.fields]
