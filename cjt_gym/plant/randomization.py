"""Randomised joints: which numbers vary, how, and the compiled draw."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError, unknown_name
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.compiled import compiled
from cjt_gym.joint.configure import BASE_FIELDS, FIELDS
from cjt_gym.joint.random_stream import uniform

Floats = NDArray[np.float64]
DISTRIBUTIONS = ("uniform", "log_uniform")
OPERATIONS = ("set", "scale", "add")
FIELD, LOW, HIGH, LOG, OPERATION, OFFSET, FRESH = range(7)


@dataclass(frozen=True)
class Variation:
    """How one number varies from episode to episode.

    Attributes:
        low: Low end of the draw.
        high: High end of the draw.
        distribution: "uniform" or "log_uniform".
        operation: "scale" multiplies the nominal value, "add" adds to it, "set" replaces it.
    """

    low: float
    high: float
    distribution: str = "uniform"
    operation: str = "scale"

    def __post_init__(self) -> None:
        if self.distribution not in DISTRIBUTIONS:
            raise unknown_name("distribution", self.distribution, DISTRIBUTIONS)
        if self.operation not in OPERATIONS:
            raise unknown_name("operation", self.operation, OPERATIONS)
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low <= self.high):
            raise ConfigurationError(
                f"A variation must have finite low <= high, got {self.low} and {self.high}."
            )
        if self.distribution == "log_uniform" and self.low <= 0.0:
            raise ConfigurationError(f"low of a log_uniform draw must be > 0, got {self.low}.")


def make_variation(name: str, spec: Any) -> Variation:
    """Return a Variation from a Variation, a (low, high) pair of factors, or a mapping.

    Raises:
        ConfigurationError: The specification is none of these.
    """
    if isinstance(spec, Variation):
        return spec
    if isinstance(spec, Mapping):
        try:
            return Variation(**spec)
        except TypeError as error:
            raise ConfigurationError(
                f"randomization of {name} takes low, high, distribution, operation; {error}."
            ) from None
    if isinstance(spec, (list, tuple)) and len(spec) == 2:
        return Variation(float(spec[0]), float(spec[1]))
    raise ConfigurationError(
        f"randomization of {name} must be (low, high) factors or a mapping with low and high, "
        f"got {spec!r}."
    )


def fields_of(joint: Joint, name: str) -> tuple[tuple[str, ...], str | None]:
    """Return the kernel fields that a randomised name sets and the field it is relative to.

    Args:
        joint: The joint, whose active effects can be randomised.
        name: A parameter such as "k_b", or "effect.parameter" such as "coulomb.d_cm".

    Raises:
        UnknownNameError: No such parameter, or an effect that is not active.
    """
    if "." not in name:
        if name not in BASE_FIELDS:
            raise unknown_name("parameter to randomise", name, BASE_FIELDS)
        return (name,), None
    effect, symbol = name.split(".", 1)
    if effect not in joint.effects:
        raise unknown_name("active effect to randomise", effect, joint.effects)
    parameter = EFFECTS[effect].parameter(symbol)
    scalars = [p.symbol for p in EFFECTS[effect].parameters if p.fields]
    if parameter is None or not parameter.fields:
        raise unknown_name(f"scalar parameter of effect {effect}", symbol, scalars)
    return parameter.fields, parameter.relative_to


def compile_draws(joint: Joint, spec: Mapping[str, Any] | None) -> Floats:
    """Return the rows that `redraw` reads, shape (rows, 7).

    Raises:
        UnknownNameError: A name is not a parameter of the joint or of an active effect.
        ConfigurationError: A range is not valid, or would make a value negative.
    """
    rows = []
    record, _ = joint.packed()
    for name, item in (spec or {}).items():
        variation = make_variation(name, item)
        fields, relative_to = fields_of(joint, name)
        offset = float(record[relative_to][0]) if relative_to else 0.0
        for j, field in enumerate(fields):
            nominal = float(record[field][0]) + offset
            _check_sign(joint, name, variation, nominal)
            rows.append(
                (
                    FIELDS.index(field),
                    variation.low,
                    variation.high,
                    float(variation.distribution == "log_uniform"),
                    OPERATIONS.index(variation.operation),
                    offset,
                    float(j == 0),
                )
            )
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def _check_sign(joint: Joint, name: str, variation: Variation, nominal: float) -> None:
    signed = name == "torque_offset.torque"
    lowest = {
        "set": variation.low,
        "scale": nominal * variation.low,
        "add": nominal + variation.low,
    }[variation.operation]
    strict = name in ("I_m", "k_t", "n", "r", "l_a", "p")
    if not signed and (lowest < 0.0 or (strict and lowest == 0.0)):
        raise ConfigurationError(
            f"randomization of {name} of {joint.parameters.name} must keep the value "
            f"{'>' if strict else '>='} 0, got a lowest value of {lowest:g}. Raise low."
        )


@compiled
def redraw(p: Floats, nominal: Floats, rows: Floats, rng: NDArray[np.uint64], i: int) -> None:
    """Draw the parameters of joint i.

    Args:
        p: Parameters of the batch, shape (n, fields).
        nominal: Nominal parameters, shape (fields,).
        rows: From `compile_draws`.
        rng: Random streams, shape (n,).
        i: Which joint.
    """
    u = 0.0
    p[i] = nominal
    for k in range(rows.shape[0]):
        row = rows[k]
        if row[FRESH] == 1.0:
            u = uniform(rng, i)
        if row[LOG] == 1.0:
            value = row[LOW] * (row[HIGH] / row[LOW]) ** u
        else:
            value = row[LOW] + (row[HIGH] - row[LOW]) * u
        field = int(row[FIELD])
        base = nominal[field] + row[OFFSET]
        if row[OPERATION] == 1.0:
            value *= base
        elif row[OPERATION] == 2.0:
            value += base
        p[i, field] = value - row[OFFSET]
