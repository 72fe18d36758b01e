"""Conversion of a diagnosis's numbers for an effect into rows of the effect table.

One function per effect. Additions to the nominal joint are taken as named; numbers fitted
together with a datasheet value or an offset are taken from the fitted model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from cjt_gym.gap.diagnosis import Interval, NamedEffect
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.listed import SLIP_SPAN, in_place_of
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.joint import EFFECTS
from cjt_gym.joint.files.effect_entries import unit_on

SHARP_LOOP = 0.95
"""Width of the loop of exponent 1 that comes nearest to one of exponent 2 on random paths."""
DERATING, HOTTEST = 0.002, 100.0
"""Assumed loss of torque constant [1/K] behind the loss per square ampere in a record; it grows if
the windings would otherwise need more than this thermal resistance [K/W]."""
HOUSING = 1e3
"""Time constant of the housing over that of the winding."""


@dataclass(frozen=True)
class Number:
    """A number with its 95 % interval and a remark."""

    value: float
    low: float
    high: float
    note: str = ""  # remark for the reader of a joint file

    def within(self, least: float, strict: bool, most: float) -> tuple[float, float, float]:
        """Return value, low and high, held within the domain of a parameter."""
        tiny = 1e-3 * abs(self.value) or 1e-9
        least = least + tiny if strict else least
        value = min(max(self.value, least), most)
        low, high = max(min(self.low, value), least), min(max(self.high, value), most)
        value, low, high = (float(f"{x:.8g}") for x in (value, low, high))
        return value, low, high


Numbers = dict[str, Number]
Rows = dict[str, Numbers]


@dataclass(frozen=True)
class Found:
    """An effect that was found, and the model that it is part of."""

    setting: Setting  # the record and its nominal joint
    fields: Fields
    effect: NamedEffect  # the effect
    asymmetric: bool = False  # whether the joint's Coulomb friction has a level for each direction

    @property
    def letter(self) -> str:
        """Letter of its body, m for none."""
        return {"gear": "g", "load": "l"}.get(self.effect.body or "", "m")

    def named(self, symbol: str) -> float:
        """Return a number as it was named."""
        return self.effect.parameters[symbol].value

    def beside(self, field: str) -> float:
        """Return a field of the nominal joint without what it lists of the effect."""
        own = [self.setting.listed.get(name, {}) for name in in_place_of(self.effect.name)]
        return self.setting.nominal[field] - sum(one.get(field, 0.0) for one in own)

    def moved(self, symbol: str, value: float, slope: float = 1.0, note: str = "") -> Number:
        """Return a value whose interval is that of a named number, times a slope."""
        known = self.effect.parameters[symbol]
        ends = (value + slope * (end - known.value) for end in (known.low, known.high))
        low, high = sorted(ends)
        return Number(value, low, high, note)

    def scaled(self, symbol: str, value: float, power: float = 1.0, note: str = "") -> Number:
        """Return a value in proportion to a power of a named positive number."""
        known = self.effect.parameters[symbol]
        ratios = (max(end / known.value, 1e-3) ** power for end in (known.low, known.high))
        low, high = sorted(value * ratio for ratio in ratios)
        return Number(value, low, high, note)

    @property
    def smoothing(self) -> Number:
        """Velocity over which the sign of dry friction is smoothed [rad/s]; 0 for a sharp one."""
        width = self.fields[f"dq_0_{self.letter}"]
        return self.moved("dq_0", width) if "dq_0" in self.effect.parameters else _exact(width)


def _exact(value: float, note: str = "") -> Number:
    return Number(value, value, value, note)


# ---- drive and motor
def _one(effect: str, ours: str, theirs: str, field: str) -> Callable[[Found], Rows]:
    """Return the function of an effect with one number, which the model holds as a field."""
    return lambda x: {effect: {theirs: x.moved(ours, x.fields[field])}}


def _lag(x: Found) -> Rows:
    bandwidth = 1.0 / (2.0 * math.pi * x.fields["lag"])
    return {"current_lag": {"bandwidth": x.scaled("bandwidth", bandwidth)}}


def _inertia(x: Found) -> Rows:
    symbol = f"I_{x.letter}"
    return {"inertia": {symbol: x.moved(symbol, x.fields[symbol])}}


def _damping(x: Found) -> Rows:
    symbol = f"d_{x.letter}"
    return {"damping": _drag(x, symbol, x.fields[symbol])}


def _drag(x: Found, symbol: str, own: float) -> Numbers:
    """Return viscous friction; for bodies that are one mass, all of it on the motor."""
    others = _one_with_motor(x.setting) if symbol == "d_m" else ""
    if not others:
        return {symbol: x.moved(symbol, own)}
    total = own + sum(x.fields[f"d_{body}"] for body in others)
    note = "of the whole mass, whose bodies this record cannot tell apart"
    rest = {f"d_{body}": _exact(0.0, "counted with the motor") for body in others}
    return {"d_m": x.moved("d_m", total, note=note), **rest}


def _one_with_motor(setting: Setting) -> str:
    """Return the letters of the bodies that are one mass with the motor."""
    motor, *others = setting.structure.groups
    return "".join(body for body, group in zip("gl", others, strict=True) if group == motor)


def _viscous_asym(x: Found) -> Rows:
    up, down = f"d_{x.letter}", f"d_{x.letter}_n"
    ahead = _drag(x, up, x.fields[up] + x.named(up))
    others = [symbol for symbol in ahead if symbol != up]
    behind = x.fields[up] + x.named(down) + sum(x.fields[symbol] for symbol in others)
    still = {f"{symbol}_n": _exact(0.0) for symbol in others}
    return {"damping": ahead, "viscous_asym": {down: x.moved(down, behind), **still}}


def _derating(x: Found) -> Rows:
    """Return windings that warm up as fast and weaken as much as the record shows.

    A record reveals the product derating * r * r_th1 and the time constant, but no temperature.
    """
    p, time = x.setting.joint.parameters, x.fields["heat"]
    product = x.fields["derate"] / DERATING
    ohms = p.get("r", math.sqrt(product) or 1.0)
    derating = DERATING * max(product / ohms / HOTTEST, 1.0)
    slope = 1.0 / (derating * ohms)
    return {
        "thermal_derating": {
            "derating": _exact(derating, "only derating * r * r_th1 is known from the record"),
            "r": _exact(ohms),
            "r_th1": x.moved("loss", slope * x.fields["derate"], slope),
            "r_th2": _exact(p.get("r_th2", 1.0)),
            "T_thw": x.scaled("time_constant", time),
            "T_thm": _exact(HOUSING * time, "so slow that the record shows the winding alone"),
            "a_CU": _exact(0.0),
        }
    }


def _ripple(x: Found) -> Rows:
    """Convert amplitudes over the angle from the first sample to the recorded angle."""
    f, a, b = (x.effect.parameters[s] for s in "fab")
    phase = f.value * x.setting.series.zero["q_m"]
    cos, sin = math.cos(phase), math.sin(phase)
    half_a, half_b = 0.5 * (a.high - a.low), 0.5 * (b.high - b.low)
    values = (a.value * cos - b.value * sin, a.value * sin + b.value * cos)
    halves = (math.hypot(half_a * cos, half_b * sin), math.hypot(half_a * sin, half_b * cos))
    new_a, new_b = (
        Number(v, v - h, v + h, "over the angle q_m as recorded")
        for v, h in zip(values, halves, strict=True)
    )
    return {x.effect.name: {"f": x.moved("f", f.value), "a": new_a, "b": new_b}}


# ---- friction
def _coulomb(x: Found) -> Rows:
    level = f"d_c{x.letter}"
    totals = [x.beside(f"{field}_{x.letter}") + x.named(level) for field in ("c_p", "c_n")]
    if not x.asymmetric:
        return {"coulomb": {level: x.moved(level, totals[0]), "dq_0": x.smoothing}}
    up, down = (x.moved(level, total) for total in totals)
    return {"coulomb_asym": {level: up, f"{level}_n": down, "dq_0": x.smoothing}}


def _coulomb_asym(x: Found) -> Rows:
    numbers = {"dq_0": x.smoothing}
    for way, field in (("", "c_p"), ("_n", "c_n")):
        level = f"d_c{x.letter}{way}"
        total = x.beside(f"{field}_{x.letter}") + x.named(level)
        numbers[level] = x.moved(level, total)
    return {"coulomb_asym": numbers}


def _stribeck(x: Found) -> Rows:
    level = f"d_c{x.letter}"
    return {
        "stribeck": {
            level: x.moved(level, x.named(level)),
            f"d_s{x.letter}": x.moved("d_s", x.named("d_s")),
            "v_s": x.scaled("v_s", x.named("v_s")),
            "dq_0": x.smoothing,
        }
    }


def _presliding(x: Found) -> Rows:
    level, width = f"d_c{x.letter}", x.named("z_s")
    total = x.beside(f"c_p_{x.letter}") + x.named(level)
    stiffness = x.scaled("z_s", total / width, -1.0)
    return {
        "presliding": {
            level: x.moved(level, x.named(level)),
            f"sigma_{x.letter}": stiffness,
            "sigma_1": _exact(0.0),
        }
    }


def _load_friction(x: Found) -> Rows:
    return {
        "load_friction": {
            f"mu_{x.letter}": x.moved("mu", x.named("mu")),
            "dq_0": x.smoothing,
        }
    }


# ---- transmission, sensing, load
def _backlash(x: Found) -> Rows:
    inside = x.fields["play_g"] == 0.0 and x.setting.has_gear
    note = "the record places it at the torsion bar, the model in the gear" if inside else ""
    if x.fields["pull_g"] > 0.0:
        note = "in the record the damper resists parting teeth, in the model it does not"
    play = x.fields["play"] or x.fields["play_g"]
    return {"backlash": {"gap": x.moved("b", play, note=note), "offset": _exact(0.0)}}


def _hardening(x: Found) -> Rows:
    stiffness = x.fields["k_b"]
    cubic = stiffness * x.named("c")
    note = f"it softens, k_3 = {cubic:.3g}, which the model cannot represent" if cubic < 0.0 else ""
    return {"hardening": {"k_3": x.moved("c", cubic, stiffness, note)}}


def _hysteresis(x: Found) -> Rows:
    exponent, slip = x.fields["hyst_n"], x.fields["hyst_n"] == 0.0
    factor = 1.0 / SLIP_SPAN if slip else SHARP_LOOP if exponent > 1.0 else 1.0
    note = "as a loop of exponent 1; the record's is sharper" if exponent > 1.0 else ""
    return {
        "spring_hysteresis": {
            "tau_h": x.moved("h", x.named("h")),
            "delta_h": x.scaled("z_h", factor * x.named("z_h"), note=note),
            "elements": _exact(1.0 if slip else 0.0),
        }
    }


def _load_coulomb(x: Found) -> Rows:
    return {"load_coulomb": {"d_cl": x.moved("d_cl", x.named("d_cl")), "dq_0": x.smoothing}}


def _gravity(x: Found) -> Rows:
    """Return a weight and the recorded angle at which it hangs."""
    a, b = x.effect.parameters["a"], x.effect.parameters["b"]
    weight = math.hypot(a.value, b.value)
    half_a, half_b = 0.5 * (a.high - a.low), 0.5 * (b.high - b.low)
    size = max(weight, 1e-12)
    along = math.hypot(half_a * a.value, half_b * b.value) / size
    across = math.hypot(half_a * b.value, half_b * a.value) / size**2
    angle = x.setting.series.zero["q_m"] + x.fields["q_0"] - math.atan2(a.value, b.value)
    angle = math.remainder(angle, 2.0 * math.pi)
    torque = Number(weight, weight - along, weight + along)
    note = "of q_l, which is q_m as recorded where the spring is relaxed"
    hangs = Number(angle, angle - across, angle + across, note if x.setting.has_spring else "")
    return {"gravity": {"torque": torque, "angle": hangs}}


ROWS: Mapping[str, Callable[[Found], Rows]] = {
    "command_delay": _one("command_delay", "delay", "delay", "delay"),
    "current_lag": _lag,
    "current_saturation": _one("current_saturation", "i_max", "i_p", "i_max"),
    "command_quantization": _one("command_quantization", "resolution", "resolution", "step"),
    "torque_constant": _one("torque_constant", "k_t", "k_t", "k_t"),
    "thermal_derating": _derating,
    "torque_offset": _one("torque_offset", "torque", "torque", "offset"),
    "inertia": _inertia,
    "damping": _damping,
    "coulomb": _coulomb,
    "coulomb_asym": _coulomb_asym,
    "viscous_asym": _viscous_asym,
    "stribeck": _stribeck,
    "presliding": _presliding,
    "load_friction": _load_friction,
    "cogging": _ripple,
    "gear_ripple": _ripple,
    "backlash": _backlash,
    "stiffness": _one("stiffness", "k_b", "k_b", "k_b"),
    "gear_stiffness": _one("gear_stiffness", "k_g", "k_g", "k_g"),
    "hardening": _hardening,
    "spring_hysteresis": _hysteresis,
    "torque_gain": _one("torque_gain", "gain", "gain", "gain"),
    "torque_bias": _one("torque_bias", "bias", "bias", "tau_0"),
    "torque_delay": _one("torque_delay", "delay", "delay", "late"),
    "load_inertia": _one("load_inertia", "I_l", "I_l", "I_l"),
    "load_coulomb": _load_coulomb,
    "gravity": _gravity,
}
"""Effects that a diagnosis may name, except those that concern a sensor alone."""


def in_symbols(found: Found) -> NamedEffect:
    """Return an effect with the numbers and units that a joint file has for it.

    Values that the record does not determine, such as those of a law's other parameters, are left
    out.
    """
    effect, known = found.effect, {}
    if effect.name not in ROWS:
        return effect  # of a sensor: a channel's noise or resolution
    for name, numbers in ROWS[effect.name](found).items():
        for symbol, one in numbers.items():
            parameter = EFFECTS[name].parameter(symbol)
            assert parameter is not None
            if one.high > one.low:
                unit = unit_on(parameter, found.setting.joint.parameters)
                known[symbol] = Interval(one.value, one.low, one.high, unit)
    return replace(effect, parameters=known)
