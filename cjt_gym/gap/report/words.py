"""A diagnosis in words: names of effects, places, numbers, and the verdict in one sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from cjt_gym.gap.diagnosis import Diagnosis, GapSize, Horizon, Interval, NamedEffect
from cjt_gym.gap.evidence import Regime
from cjt_gym.gap.horizons.prediction.model import MEASURES

VERDICTS: Mapping[str, str] = {
    "no_gap": "No gap",
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "unexplained": "Unexplained",
}
EFFECTS: Mapping[str, str] = {
    "command_delay": "dead time of the command",
    "current_lag": "a slow current loop",
    "current_saturation": "a limited current",
    "command_quantization": "a coarse command",
    "torque_constant": "a different torque constant",
    "thermal_derating": "torque lost as the windings warm",
    "torque_offset": "a constant torque offset",
    "inertia": "a different inertia I_m",
    "damping": "viscous damping",
    "coulomb": "Coulomb friction",
    "coulomb_asym": "asymmetric Coulomb friction",
    "viscous_asym": "asymmetric viscous friction",
    "stribeck": "Stribeck friction",
    "presliding": "friction with elastic presliding",
    "load_friction": "friction that grows with the transmitted torque",
    "cogging": "cogging",
    "gear_ripple": "gear ripple",
    "backlash": "backlash",
    "stiffness": "a different stiffness of the torsion bar",
    "gear_stiffness": "a different stiffness of the gearbox",
    "hardening": "a spring that stiffens with deflection",
    "spring_hysteresis": "hysteresis of the spring",
    "torque_gain": "a wrong scale of the torque sensor",
    "torque_bias": "an offset of the torque sensor",
    "torque_delay": "a late torque sensor",
    "quantization": "steps coarser than specified",
    "noise": "noise above the specification",
    "load_inertia": "a different inertia of the load",
    "load_coulomb": "Coulomb friction of the load",
    "gravity": "weight of the load",
}
CHANNELS: Mapping[str, str] = {
    "tau": "joint torque",
    "tau_m": "drive torque",
    "dq_m": "motor velocity",
    "q_m": "motor position",
    "i": "current",
}
WITH_BODY = ("coulomb", "coulomb_asym", "viscous_asym", "stribeck", "presliding", "damping")
CORRECTED = 0.6
"""Ratio of the gap after to that before below which refined values are more than tolerances."""
NOTABLE = 0.1
"""Share of the replay error that must be gone for the verdict to say how much."""
OPEN, AGAIN = 0.1, 3.0
"""Replay error, and its ratio to the noise floor, above which an explained joint needs a remark."""
SHORT = 0.05
"""Time up to which a prediction depends on its measured start [s]."""
SLIGHT, TWICE = 0.01, 1.7
"""Relative error of a prediction, and its ratio to the floor, above which a joint without a gap
needs a remark."""
MUCH = 0.1
"""Relative error of a prediction above which it is told of a joint without a gap."""
DOUBTED = 0.3
"""Confidence of the surest name below which names are only a guess."""
AT_THE_END = 1e-4
"""Distance from an end of an interval, relative to its width, up to which a value is there."""
MOST_MOVED = 4
"""Most values of the datasheet that a verdict lists."""
MINUS = "\N{MINUS SIGN}"
SPACE = "\N{NO-BREAK SPACE}"
CONCENTRATED = 0.5
"""Share of a stage's gap in one place from which the verdict names the place."""


def number(value: float, digits: int = 3) -> str:
    """Format a number to a given number of significant digits, avoiding an exponent if possible."""
    if value == 0.0 or not math.isfinite(value):
        return "0"
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    exponent = int(power)
    if -4 <= exponent < 6:
        rounded = round(value, digits - 1 - exponent)
        return f"{rounded:.{max(digits - 1 - exponent, 0)}f}".replace("-", MINUS)
    raised = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}·10{raised}".replace("-", MINUS)


def percent(share: float) -> str:
    """Return a share in per cent."""
    size = abs(100.0 * share)
    if size < 0.005:
        return f"0{SPACE}%"
    return f"{number(100.0 * share, 2 if size < 99.5 else 3)}{SPACE}%"


def noise_floor(gap: GapSize) -> str:
    """Return the part of a gap due to noise alone; zero means unknown."""
    return percent(gap.floor) if gap.floor > 0.0 else "not known"


def interval(p: Interval) -> str:
    """Return a number with its interval, to the digits that the interval leaves certain."""
    width = p.high - p.low
    if width <= 0.0 or max(abs(p.low), abs(p.high)) < 1e-3:
        return f"{quantity(p.value, p.unit)} ({number(p.low)} … {number(p.high)})"
    ends = (2.0 * away for away in (p.value - p.low, p.high - p.value))
    below, above = (_decimals(away if away > AT_THE_END * width else width) for away in ends)
    value, low, high = (
        number(x, 2)
        if x != 0.0 and abs(x) < 0.5 * 10.0**-decimals  # it would look like none
        else f"{round(x, decimals) + 0.0:.{max(decimals, 0)}f}".replace("-", MINUS)
        for x, decimals in ((p.value, max(below, above)), (p.low, below), (p.high, above))
    )
    unit = "" if p.unit in ("", "-") else f" {p.unit}".replace(" ", SPACE)
    return f"{value}{unit} ({low} … {high})"


def _decimals(width: float) -> int:
    """Return to how many decimals a number is certain within a width."""
    return 1 - math.floor(math.log10(width))


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """Return a number with its unit."""
    if unit in ("", "-"):
        return number(value, digits)
    return f"{number(value, digits)} {unit}".replace(" ", SPACE)


def joined(words: Sequence[str], link: str = "and") -> str:
    """Return words as a list in a sentence."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {link} {words[-1]}"


def effect_name(name: str, body: str | None = None, channel: str | None = None) -> str:
    """Return an effect in words."""
    text = EFFECTS.get(name, name.replace("_", " "))
    if body and name in WITH_BODY:
        text += f" of the {body}"
    if channel and name in ("noise", "quantization"):
        text += f" of {channel}"
    return text


def effect_sizes(effect: NamedEffect) -> str:
    """Return the numbers of an effect, short enough for a sentence."""
    p = dict(effect.parameters)
    if {"f", "a", "b"} <= set(p):
        size = math.hypot(p["a"].value, p["b"].value)
        over = "2π m" if p["a"].unit == "N" else "revolution"
        return f"{number(p['f'].value)} per {over}, {quantity(size, p['a'].unit, 2)}"
    units = {item.unit for item in p.values()}
    if len(units) == 1:
        unit = units.pop()
        values = " / ".join(number(item.value, 3 if unit == "-" else 2) for item in p.values())
        return values if unit == "-" else f"{values} {unit}".replace(" ", SPACE)
    return ", ".join(f"{symbol} = {quantity(x.value, x.unit, 2)}" for symbol, x in p.items())


def in_words(effect: NamedEffect) -> str:
    """Return an effect in words with its numbers."""
    sizes = effect_sizes(effect)
    text = effect_name(effect.name, effect.body, effect.channel)
    if effect.name == "hardening" and all(one.value < 0.0 for one in effect.parameters.values()):
        text = text.replace("stiffens", "softens")
    return f"{text} ({sizes})" if sizes else text


def place(regimes: Sequence[Regime]) -> str:
    """Return where in its operating range a stage's gap lies, or nothing if it lies everywhere."""
    speeds = [r for r in regimes if r.variable in ("dq_m", "dq_l")]
    lines = [r for r in regimes if r.variable == "cycles_per_rev" and r.low > 0.0]
    slow = sum(r.share for r in speeds if r.low < 0.0 < r.high)
    if slow >= CONCENTRATED:
        return "at low speed"
    for r in lines:
        if r.share >= CONCENTRATED and r.high - r.low < 0.1 * r.high:
            unit = "revolution" if r.unit != "1/m" else "metre"
            return f"at {number(0.5 * (r.low + r.high))} cycles per {unit}"
    ends = [r.share for r in speeds[:1] + speeds[-1:]]
    if sum(ends) >= CONCENTRATED:
        return "at high speed"
    for way, one in (("forward", 1.0), ("backward", -1.0)):
        if sum(r.share for r in speeds if one * (r.low + r.high) > 0.0) >= 0.85:
            return f"in {way} motion"
    return ""


def where(diagnosis: Diagnosis) -> str:
    """Return the stages with a gap, the worst first, and the place of the worst."""
    found = [name for name, stage in diagnosis.stages.items() if stage.significant]
    found.sort(key=lambda name: -diagnosis.stages[name].before)
    if not found:
        return ""
    stages = f"in the {joined(found)} stage{'s' if len(found) > 1 else ''}"
    regimes = diagnosis.evidence.regimes.get(found[0])
    spot = place(regimes[0]) if regimes else ""
    return f"{stages}, {spot}" if spot and len(found) == 1 else stages


def _listed(symbols: Sequence[str]) -> str:
    """Return symbols as a list of no more than a few."""
    few = symbols if len(symbols) <= MOST_MOVED else [*symbols[: MOST_MOVED - 1], "others"]
    return joined(few)


def _named(effects: Sequence[NamedEffect]) -> str:
    """Return effects as the subject of a sentence, with the tentative ones apart."""
    sure = [in_words(effect) for effect in effects if effect.status != "tentative"]
    doubtful = [in_words(effect) for effect in effects if effect.status == "tentative"]
    if not sure or not doubtful:
        return ("" if sure else "tentatively ") + joined(sure or doubtful)
    return f"{joined(sure)}, and tentatively {joined(doubtful)},"


def _above_the_floor(diagnosis: Diagnosis) -> Horizon | None:
    """Return the prediction of the motion that is farthest above its floor, if any is."""
    rows = [
        row
        for row in diagnosis.horizons
        if row.channel == "q_m" and row.seconds > SHORT and row.floor
        and row.found > max(SLIGHT, TWICE * row.floor)
    ]  # fmt: skip
    return max(rows, key=lambda row: row.found / (row.floor or 1.0), default=None)


def _in_the_noise(diagnosis: Diagnosis) -> str:
    """Return how much of the motion is not predicted, if that is much, though no gap is seen."""
    rows = [r for r in diagnosis.horizons if r.channel == "q_m" and r.seconds > SHORT]
    worst = max(rows, key=lambda row: row.found, default=None)
    if worst is None or worst.found < MUCH:
        return ""
    return (
        f" But {percent(worst.found)} of its motion is not predicted {worst.seconds:g} s ahead, so "
        "that this record shows no effect smaller than that."
    )


def error_of(diagnosis: Diagnosis) -> str:
    """Return which error measures the gap: that of a replay, or of predictions."""
    gap = diagnosis.gap
    ahead = [h for h in diagnosis.horizons if (h.datasheet, h.found) == (gap.before, gap.after)]
    return f"the error {ahead[-1].seconds:.3g} s ahead" if ahead else "the replay error"


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """Return the verdict in one plain sentence."""
    gap = diagnosis.gap
    if diagnosis.verdict == "no_gap":
        row = _above_the_floor(diagnosis)
        none, noise = ("no gap", " and sensor noise") if row is None else ("hardly a gap", "")
        text = f"There is {none}: within tolerances{noise} the joint does what its datasheet says."
        if gap.after < CORRECTED * gap.before:
            text = (
                f"There is {none} but in values that the datasheet guesses, gives with a "
                "tolerance or does not state."
            )
        if row is not None:
            text += (
                f" The {percent(row.found)} that its predictions leave {row.seconds:g} s ahead are "
                f"small, but more than the {percent(row.floor or 0.0)} that could not be "
                "predicted; no effect of the table explains the rest."
            )
        else:
            text += _in_the_noise(diagnosis)
        change = f"{percent(gap.before)} to {percent(gap.after)}"
        better = f" Refining its values takes {error_of(diagnosis)} from {change}."
        return text + (better if gap.removed >= NOTABLE else "")
    if diagnosis.verdict == "unexplained" and not gap.floor and gap.removed < NOTABLE:
        lost = f"{percent(gap.after)} of what the joint does is not predicted"
        return f"{lost}, and this record does not tell how much of it could be."
    size = f" of {percent(gap.before)}" if gap.before else ""
    stages = where(diagnosis)
    lies = f"The gap{size} lies {stages}" if stages else f"There is a gap{size}"
    if diagnosis.verdict == "unexplained" or not diagnosis.effects:
        if gap.removed >= NOTABLE:
            rest = f"refined values take it to {percent(gap.after)}"
            return f"{lies}; no effect is named as its cause, but {rest}."
        return f"{lies}; no effect of the table explains it."
    names = _named(diagnosis.effects)
    verb = "explain" if len(diagnosis.effects) > 1 else "explains"
    if max(effect.confidence for effect in diagnosis.effects) < DOUBTED:
        verb = "might explain"
    beside = f", with other values of {_listed(diagnosis.moved)}," if diagnosis.moved else ""
    moving = any(effect.name not in MEASURES for effect in diagnosis.effects)
    share = f"{percent(gap.removed)} of it" if moving and gap.removed >= NOTABLE else ""
    left = diagnosis.unexplained
    rest = f"something in the {left.stage} stage stays unexplained"
    if share and not any(e.gap_removed for e in diagnosis.effects if e.name not in MEASURES):
        text = f"{lies}; refined values explain {share}, and the torque shows {names}"
        return f"{text.removesuffix(',')}{'' if left.stage is None else f'; {rest}'}."
    if left.stage is not None:
        # How much is another measure, of a stage's residual or a prediction: `left` tells it.
        change = f"{percent(gap.before)} to {percent(gap.after)}"
        fall = f", so that {error_of(diagnosis)} falls from {change}"
        if not moving:
            names = names.removesuffix(",")
            return f"{lies}; no effect of the table explains it; sensors differ as well: {names}."
        return f"{lies}; {names} {verb}{beside} part of it{fall if share else ''}; {rest}."
    if not moving:
        names = names.removesuffix(",")
        if gap.removed < NOTABLE:
            return f"{lies}: {names}."
        change = f"{percent(gap.before)} to {percent(gap.after)}"
        return (
            f"Values refined within their tolerances take {error_of(diagnosis)} from {change}; "
            f"apart from that only sensors differ: {names}."
        )
    text = f"{lies}; {names} {verb}{beside} {share or 'it, although the replay hardly changes'}."
    if gap.after > max(OPEN, AGAIN * gap.floor):
        text += (
            f" The replay is still {percent(gap.after)} off while no stage is: in open loop small "
            "errors add up, most of all where the joint is little damped or friction holds it."
        )
    return text
