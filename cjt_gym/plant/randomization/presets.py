"""Randomisations by name: what varies follows from the joint and the effect table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.batch import DELAYS
from cjt_gym.joint.configure import off_value, stated_by_file
from cjt_gym.joint.effects import Effect, EffectParameter
from cjt_gym.joint.files.effect_entries import CHANNEL_VALUES
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.plant.randomization.target import Target, find_target
from cjt_gym.plant.randomization.together import found_together
from cjt_gym.plant.randomization.variation import TAILS, Variation

Variations = dict[str, Variation]
LEAST = 0.05  # share of its nominal value that a number keeps however wide its tolerance
HALF = 0.5  # the same where the size of an effect is a difference from nominal
SPEEDS = ("Hz", "A/s")  # units of sizes of which less is the stronger effect, and 0 is none
COUNTED = ("n", "p")  # exact by their nature, unless the joint file gives a tolerance
NORMAL = 1.96  # standard deviations on either side of the middle that hold 95 %


@dataclass(frozen=True)
class Width:
    """How wide a preset is."""

    base: tuple[float, float]  # factors on base parameters
    size: tuple[float, float]  # factors on how far an effect is from being off
    speed: Variation  # factors on bandwidths, cut-offs and rate limits
    samples: float  # control steps that delays gain at most
    by_tolerance: bool  # whether a tolerance in the joint file goes before `base`


MILD = Width((0.9, 1.1), (0.7, 1.3), Variation(0.7, 1.3), 1.0, True)
WIDE = Width((0.7, 1.4), (0.0, 2.0), Variation(0.5, 2.0, "log_uniform"), 2.0, False)


def used_parameters(joint: Joint) -> tuple[str, ...]:
    """Return the base parameters that structure and drive use.

    What the joint does not have, and what an active effect replaces, is left out.
    """
    motor, gear, load = joint.structure_row.groups
    used = {
        "I_m": True,
        "I_g": True,
        "I_l": load >= 0,
        "k_g": motor != gear,
        "k_b": gear != load,
        "d_m": True,
        "d_g": True,
        "d_l": load >= 0,
        "d_mg": motor != gear,
        "d_gl": gear != load,
        "k_t": True,
        "r": joint.drive != "current",
        "l_a": joint.drive in ("rl", "dq"),
        "v_0": joint.drive != "current",
        "i_p": True,
        "n": True,
        "p": joint.drive == "dq",
    }
    replaced = {p.relative_to for e in joint.effects for p in EFFECTS[e].parameters if p.replaces}
    p = joint.parameters
    return tuple(n for n, is_used in used.items() if is_used and n not in replaced and p.get(n, 0))


def preset(joint: Joint, width: Width, dt: float) -> Variations:
    """Return the variations of every base parameter in use and of the size of every effect."""
    found = {}
    for name in used_parameters(joint):
        tolerance = joint.parameters.quantities[name].tolerance
        if width.by_tolerance and tolerance is not None:
            found[name] = within_tolerance(tolerance, signed=False)
        elif name not in COUNTED:
            found[name] = Variation(*width.base)
    for name in joint.effects:
        for parameter in _sizes(EFFECTS[name]):
            target = find_target(joint, f"{name}.{parameter.symbol}")
            variation = _sized(joint, target, parameter, width, dt)
            if variation is not None:
                found[target.name] = variation
    return found


def identified(joint: Joint) -> Variations:
    """Return a normal variation of every number of which the joint file says how sure it is.

    Numbers in [found.covariance] are drawn together. Of all others, a 95 % interval (low, high) is
    where the draws stay; a tolerance is one sigma, relative. That of the amplitudes of a ripple
    becomes one of its scale; frequencies of ripples count as exact. A value that replaces that of
    the file has none of these.
    """
    found = {}
    for name, quantity in joint.parameters.quantities.items():
        if name in used_parameters(joint) and (variation := as_sure_as(quantity, signed=False)):
            found[name] = variation
    for name, values in joint.effects.items():
        for parameter in EFFECTS[name].parameters:
            source = _source_of(joint, name, parameter)
            same = source is not None and source.value == values[parameter.symbol]
            if source is None or not same or parameter.symbol == "f":
                continue
            variation = as_sure_as(source, parameter.signed)
            symbol = "scale" if parameter.series else parameter.symbol
            known = found.get(f"{name}.{symbol}")
            if variation and (known is None or (known.std or 0.0) < (variation.std or 0.0)):
                found[f"{name}.{symbol}"] = variation
    found |= found_together(joint)
    if not found:
        raise ConfigurationError(
            f'randomization = "identified" needs intervals or tolerances, and '
            f"{joint.parameters.origin} gives none to what acts in this joint. Add  low = ..., "
            "high = ...  (95 %), or  tolerance = ...  (one sigma, relative) to its values, as an "
            'identification knows them, or use "mild".'
        )
    return found


def as_sure_as(quantity: Quantity, signed: bool) -> Variation | None:
    """Return the variation that a quantity's interval or tolerance calls for; None without."""
    if quantity.low is not None and quantity.high is not None:
        return _within(quantity)
    return within_tolerance(quantity.tolerance, signed) if quantity.tolerance else None


def _within(quantity: Quantity) -> Variation | None:
    """Return a normal variation cut off at the ends of the interval; of series, of their scale."""
    rows = np.atleast_1d(np.array([quantity.low, quantity.value, quantity.high]).T)
    table = rows.reshape(-1, 3)
    std = (table[:, 2] - table[:, 0]) / (2.0 * NORMAL)
    if not std.any():
        return None
    if isinstance(quantity.value, tuple):
        half = 0.5 * (table[:, 2] - table[:, 0])
        share = float(np.min(half / np.maximum(np.abs(table[:, 1]), 1e-300)))
        return Variation(max(1.0 - share, 0.0), 1.0 + share, "normal", "set", 1.0, share / NORMAL)
    low, value, high = (float(x) for x in table[0])
    return Variation(low, high, "normal", "set", value, float(std[0]))


def within_tolerance(tolerance: float, signed: bool) -> Variation:
    """Return the normal variation of one sigma, relative; one that is not signed stays positive."""
    low = 1.0 - TAILS * tolerance
    return Variation(
        distribution="normal", mean=1.0, std=tolerance, low=low if signed else max(low, LEAST)
    )


def _sizes(effect: Effect) -> list[EffectParameter]:
    """Return the numbers that make an effect larger or smaller; of series, their common factor."""
    sizes = [p for p in effect.parameters if p.symbol in effect.size and p.fields]
    if any(p.series and p.symbol in effect.size for p in effect.parameters):
        sizes += [p for p in effect.parameters if p.symbol == "scale"]
    return sizes


def _sized(
    joint: Joint, target: Target, parameter: EffectParameter, width: Width, dt: float
) -> Variation | None:
    """Return how the size of an effect varies; None where it is off."""
    off = 0.0 if parameter.symbol == "scale" else off_value(parameter, joint.parameters)
    excess = target.nominal - off
    if excess == 0.0:
        return None
    if parameter.replaces and parameter.relative_to not in joint.parameters:
        return Variation(*width.base)
    if set(target.fields) & set(DELAYS):
        return Variation(0.0, width.samples * dt, operation="add")
    if off == 0.0 and parameter.unit in SPEEDS:
        return width.speed
    ends = sorted(off + factor * excess for factor in width.size)
    low, high = ends[0], min(ends[1], target.domain.high)
    if off == 0.0 and high == ends[1]:
        return Variation(*width.size)
    if not parameter.signed:
        low = max(low, HALF * min(target.nominal, high))
    return Variation(low, high, operation="set")


def _source_of(joint: Joint, effect: str, parameter: EffectParameter) -> Quantity | None:
    """Return the quantity of the joint file that a parameter of an effect comes from."""
    listed = joint.file.effects.get(effect, {})
    key = parameter.symbol
    if listed.get("channel") == key:
        key = next((k for k in CHANNEL_VALUES if k in listed), key)
    quantity = listed.get(key) or stated_by_file(parameter, joint.file)
    return quantity if isinstance(quantity, Quantity) else None


PRESETS: Mapping[str, Callable[[Joint, float], Variations]] = {
    "mild": lambda joint, dt: preset(joint, MILD, dt),
    "wide": lambda joint, dt: preset(joint, WIDE, dt),
    "identified": lambda joint, dt: identified(joint),
}
