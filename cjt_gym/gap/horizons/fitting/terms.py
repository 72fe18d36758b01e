"""Rows of the effect table that may explain a record, and starts of the search for them."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.horizons.prediction.forward import delaying_substep
from cjt_gym.gap.horizons.prediction.log import Log
from cjt_gym.gap.horizons.prediction.model import Draft, Free, Put, Scales, Term, motor_inertia
from cjt_gym.gap.horizons.torque.cross_validated import Spent
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.joint import EFFECTS, Joint

LIKELY, RARE, UNLIKELY = 0.5, 2.0, 4.0
"""Price factors of a term: for dry friction, which every joint has; for effects that are rare or
mimicked by other errors; for a delay or lag after a measured current, and for heat."""
CREEP = 0.002
"""Velocity over which the toolbox smooths dry friction, which then creeps [rad/s]."""
SLOWEST = 0.02
"""Longest time constant of a drive [s]; anything slower is the mechanics."""
SLOWEST_HELD = 0.1
"""The same with a held output, whose mechanics are quick: a drive that controls a torque."""
LONGEST_DELAY = 0.06
"""Longest dead time of a command [s], as when a computer drives an amplifier over a network."""
WIDEST = np.pi
"""Widest backlash [rad]: angles that drift apart by more are integrated from velocities, say."""
HEAVIEST = 10.0
"""Largest gravity torque considered, as a multiple of the rarely exceeded torque: that of a
pendulum that is swung up exceeds its motor's."""
NEAR = 5.0
"""Range of the frequency of cogging about that of a regression, in its resolution."""
SWING = 0.4
"""Travel above which gravity is searched for even if the torque does not show it [rad]."""
COASTING, SELDOM = 0.1, 0.95
"""Share of the inertial torque that counts as the torque of an undriven joint, and share of the
record without any torque from which it is one."""
FARTHEST = 0.2
"""Largest angle by which bristles bend under the usual torque [rad]; what gives way further, such
as a cable or a wheel between two rows of a slow log, is no presliding."""
FALLEN = 1.0
"""Largest Stribeck velocity, relative to the rms speed: if friction falls more slowly, damping
takes the place of the Coulomb friction that every joint has."""
MOST_LOST = 0.5
"""Largest share of the transmitted torque lost to friction, as in the effect table."""
DERATING, WEAKER = 0.002, 0.2
"""Loss of torque per kelvin of the winding, of which a record shows only the product with two
resistances, and the loss at the rms current from which a search starts."""
WARMING, WINDINGS = (1.5, 4.0, 16.0), (1.0, 100.0)
"""Thermal time constants from which a search starts, and their range [s]: no winding is quicker."""
AROUND = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Directions from which the search for a weight starts."""
HOUSING = 1e3
"""Time constant of a housing that no record shows, relative to the winding's."""
BODIES = {"m": "motor", "g": "gear", "l": "load"}


def scales_of(joint: Joint, logs: Sequence[Log]) -> Scales:
    """Return the typical magnitudes in some records."""
    p = joint.parameters
    gain = p.k_t * p.n / (p.r if logs[0].voltage else 1.0)
    own = [gain * log.command[log.inside] for log in logs]
    torque = np.concatenate([x + log.load[log.inside] for x, log in zip(own, logs, strict=True)])
    speed = np.concatenate([log.speed[log.inside] for log in logs])
    travel = max(float(np.ptp(log.states[log.inside, 0])) for log in logs)
    fast = max(float(np.percentile(np.abs(speed), 99)), 1e-9)
    moved = motor_inertia(joint) * np.concatenate([log.acceleration[log.inside] for log in logs])
    peak = max(float(np.percentile(np.abs(x), 99)) for x in (torque, moved))
    usual = float(np.std(torque))
    return Scales(
        max(usual, COASTING * float(np.std(moved)), 1e-3 * float(np.abs(torque).max()), 1e-9),
        max(float(np.sqrt(np.mean(speed**2))), 1e-9),
        max(peak, 1e-9),
        max(travel, 1e-9),
        float(np.std(np.concatenate(own))) / max(usual, 1e-300),
        fast,
        float(np.quantile(np.abs(torque), SELDOM)) == 0.0,
    )


def sets(effect: str, *symbols: str) -> Put:
    """Return a function that writes numbers into a row of the effect table."""

    def put(draft: Draft, values: Sequence[float]) -> None:
        row = draft.row(effect)
        for symbol, value in zip(symbols, values, strict=True):
            row[symbol] = value

    return put


def candidates(joint: Joint, scales: Scales, logs: Sequence[Log]) -> tuple[Term, ...]:
    """Return the terms that may be added to the model of a record."""
    shape, drive = joint.structure_row, joint.drive
    found = [
        *_friction(joint, scales, "m"),
        _offset(scales),
        *_drive(logs, held=shape.output_fixed),
        *_derating(joint, logs),
    ]
    free = shape.groups[2] >= 0
    if free and shape.groups[2] != shape.groups[0]:
        found += [*_load_friction(scales), _load_damping(joint, scales)]
    if free and joint.parameters.axis == "rotary" and scales.travel > SWING:
        found.append(gravity(joint, scales))
    measured = set().union(*(log.measured for log in logs))
    if "tau" in measured:
        found += _torque_sensor(logs)
    if shape.has_spring:
        found += _spring(joint, logs)
    return tuple(t for t in found if EFFECTS[t.name].acts_in(shape, drive))


def likelier(terms: Sequence[Term], names: Collection[str]) -> list[Term]:
    """Return terms, with those named rated at least as likely as dry friction."""
    return [replace(t, factor=min(t.factor, LIKELY)) if t.name in names else t for t in terms]


def _level(symbol: str, scales: Scales) -> Number:
    return Free(symbol, "N m", 0.0, 0.05 * scales.torque, low=0.0, high=5.0 * scales.peak)


def _slip(scales: Scales) -> Number:
    """Return the velocity at which friction falls."""
    v = scales.speed
    return Free("v_s", "rad/s", 0.1 * v, 0.5, True, 0.003 * v, FALLEN * v)


def _falling(scales: Scales) -> tuple[tuple[float, float], ...]:
    """Return levels of friction that falls, and velocities, from which a search starts."""
    return tuple((0.2 * scales.torque, k * scales.speed) for k in (0.02, 0.1, 0.4))


def _friction(joint: Joint, scales: Scales, body: str) -> list[Term]:
    name, level = BODIES[body], 0.2 * scales.torque
    nominal = _listed_coulomb(joint, body)
    counted_with = body_group(joint.structure_row, "m")[1:] if body == "m" else ()  # as by damping

    def coulomb(draft: Draft, values: Sequence[float]) -> None:
        asymmetric = "coulomb_asym" in draft.effects
        row = draft.row("coulomb_asym" if asymmetric else "coulomb")
        row[f"d_c{body}"] = values[0]
        if asymmetric:
            row[f"d_c{body}_n"] = values[0]

    def smooth(draft: Draft, values: Sequence[float]) -> None:
        coulomb(draft, values)
        draft.smooth(CREEP)

    def asymmetric(draft: Draft, values: Sequence[float]) -> None:
        if "coulomb" in draft.effects:
            old = draft.effects.pop("coulomb")
            row = draft.row("coulomb_asym")
            for symbol in ("d_cm", "d_cg", "d_cl"):
                row[symbol] = row[f"{symbol}_n"] = old[symbol]
            row["dq_0"] = old["dq_0"]
        row = draft.row("coulomb_asym")
        row[f"d_c{body}"], row[f"d_c{body}_n"] = values

    def viscous(draft: Draft, values: Sequence[float]) -> None:
        up = draft.effects.get("damping", {}).get(f"d_{body}", 0.0)
        row = draft.row("viscous_asym")
        row[f"d_{body}_n"] = max(float(up) + values[0], 0.0)  # type: ignore[arg-type]
        row.update({f"d_{other}_n": 0.0 for other in counted_with})

    def presliding(draft: Draft, values: Sequence[float]) -> None:
        draft.row("presliding")[f"sigma_{body}"] = values[0]

    d_c = _level(f"d_c{body}", scales)
    rise = Free(f"d_s{body}", "N m", 0.0, 0.05 * scales.torque, low=0.0, high=3.0 * scales.peak)
    slope = 0.1 * scales.torque / scales.speed
    steep = scales.torque / scales.travel
    bent = scales.torque / FARTHEST if joint.parameters.axis == "rotary" else 0.0
    softest, stiffest = max(0.5 * steep, bent), 1e6 * max(steep, bent)
    first = max(100.0 * steep, softest)
    sigma = Free(f"sigma_{body}", "N m/rad", first, 0.7, True, softest, stiffest)
    mu = Free(f"mu_{body}", "-", 0.0, 0.05, low=0.0, high=MOST_LOST)
    return [
        Term("coulomb", (d_c,), coulomb, name, starts=((nominal + level,),), nominal=(nominal,),
             family="dry", factor=LIKELY),
        Term("coulomb", (d_c,), smooth, name, starts=((nominal + level,),), nominal=(nominal,),
             family="dry", factor=LIKELY),
        Term("coulomb_asym", (d_c, _level(f"d_c{body}_n", scales)), asymmetric, name,
             replaces=("coulomb",), starts=((level, 0.5 * level), (0.5 * level, level)),
             nominal=(nominal, nominal), family="dry"),
        Term("stribeck", (rise, _slip(scales)), sets("stribeck", f"d_s{body}", "v_s"), name,
             needs=("coulomb", "coulomb_asym"), starts=_falling(scales),
             nominal=(0.0, 0.1 * scales.speed), family="dry"),
        Term("presliding", (sigma,), presliding, name, needs=("coulomb", "coulomb_asym"),
             starts=tuple((k * max(steep, 0.1 * bent),) for k in (10.0, 100.0, 1e3, 1e4)),
             nominal=(stiffest,), family="dry"),
        Term("load_friction", (mu,), sets("load_friction", f"mu_{body}"), name, starts=((0.1,),),
             nominal=(0.0,), family="dry"),
        Term("viscous_asym", (Free(f"d_{body}_n", "N m s/rad", 0.0, slope),), viscous, name,
             starts=((0.2 * slope,), (-0.2 * slope,)), nominal=(0.0,), family="dry",
             factor=RARE),
    ]  # fmt: skip


def _listed_coulomb(joint: Joint, body: str) -> float:
    for name in ("coulomb", "coulomb_asym"):
        if name in joint.effects:
            return float(joint.effects[name][f"d_c{body}"])  # type: ignore[arg-type]
    return 0.0


def _offset(scales: Scales) -> Term:
    number = Free("torque", "N m", 0.0, 0.05 * scales.torque)
    start = 0.1 * scales.torque
    return Term(
        "torque_offset", (number,), sets("torque_offset", "torque"), starts=((start,), (-start,)),
        nominal=(0.0,), family="dry",
    )  # fmt: skip


def _drive(logs: Sequence[Log], *, held: bool) -> list[Term]:
    measured = logs[0].drive == "i"
    dt, factor = logs[0].dt, UNLIKELY if measured else 1.0
    longest = max(SLOWEST if measured else LONGEST_DELAY, 4.0 * dt)
    delay = _late(dt, longest)
    slowest = min(1.0 / (2.0 * np.pi * (SLOWEST_HELD if held else SLOWEST)), 0.05 / dt)
    starts = (0.7 * dt, 1.5 * dt, 3.0 * dt, 0.5 * longest)
    lag = Free("bandwidth", "Hz", 0.1 / dt, 0.5, True, slowest, 0.5 / dt)
    return [
        Term("command_delay", (delay,), sets("command_delay", "delay"), nominal=(0.0,),
             starts=tuple((x,) for x in starts if x < longest), family="late", factor=factor),
        Term("current_lag", (lag,), sets("current_lag", "bandwidth"), nominal=(0.5 / dt,),
             starts=((0.15 / dt,), (0.05 / dt,), (0.015 / dt,)), family="late", factor=factor),
    ]  # fmt: skip


def _derating(joint: Joint, logs: Sequence[Log]) -> list[Term]:
    """Return the term of a motor that weakens as its windings warm up, driven by a current."""
    flow = max(float(np.sqrt(np.mean(log.command[log.whole] ** 2))) for log in logs)
    if logs[0].voltage or flow <= 0.0:
        return []
    ohms = joint.parameters.get("r", float(np.clip(10.0 / flow**2, 1e-3, 100.0)))
    usual = WEAKER / (DERATING * ohms * flow**2)
    low, high = 1e-3 * usual, 20.0 * usual
    resistance = Free("r_th1", "K/W", usual, 0.3, True, low, high)
    time = Free("T_thw", "s", WARMING[1], 0.3, True, *WINDINGS)

    def put(draft: Draft, values: Sequence[float]) -> None:
        through, slow = values
        row = draft.row("thermal_derating")
        row |= {"derating": DERATING, "r": ohms, "r_th1": through, "r_th2": through}
        row |= {"T_thw": slow, "T_thm": HOUSING * slow, "a_CU": 0.0}

    return [
        Term(
            "thermal_derating", (resistance, time), put, nominal=(low, WARMING[1]),
            starts=tuple((usual, x) for x in WARMING), family="warm", factor=UNLIKELY,
        )
    ]  # fmt: skip


def _late(dt: float, longest: float) -> Number:
    """Return a delay whose finite-difference step is a whole substep of the kernel."""
    step = delaying_substep(dt) / (0.5 * dt)
    return Free("delay", "s", 0.0, 0.5 * dt, low=0.0, high=longest, step=step)


def cogging(one: Spent) -> Term:
    """Return the term of a torque that repeats with the angle, where a regression shows it.

    Away from its frequency nothing improves, so that it stays within the regression's.
    """
    f, size = one.values[0], one.size
    near = NEAR * one.deviations[0]
    numbers = (
        Free("f", "1/rev", f, one.deviations[0], low=f - near, high=f + near),
        *(
            Free(symbol, "N m", 0.0, 0.1 * size, low=-5.0 * size, high=5.0 * size)
            for symbol in "ab"
        ),
    )

    def put(draft: Draft, values: Sequence[float]) -> None:
        row = draft.row("cogging")
        row["f"], row["a"], row["b"] = ((x,) for x in values)
        row["scale"] = 1.0

    return Term("cogging", numbers, put, "motor", starts=(one.values,), nominal=(f, 0.0, 0.0))


def _load_friction(scales: Scales) -> list[Term]:
    level = 0.2 * scales.torque
    rise = Free("d_sl", "N m", 0.0, 0.05 * scales.torque, low=0.0, high=3.0 * scales.peak)
    return [
        Term("load_coulomb", (_level("d_cl", scales),), sets("load_coulomb", "d_cl"), "load",
             starts=((level,),), nominal=(0.0,), family="dry"),
        Term("stribeck", (rise, _slip(scales)), sets("stribeck", "d_sl", "v_s"), "load",
             needs=("load_coulomb",), starts=_falling(scales),
             nominal=(0.0, 0.1 * scales.speed), family="dry"),
    ]  # fmt: skip


def _load_damping(joint: Joint, scales: Scales) -> Term:
    given, step = joint.parameters.get("d_l", 0.0), 0.1 * scales.torque / scales.speed
    number = Free("d_l", "N m s/rad", given, step, low=0.0)
    return Term("damping", (number,), sets("damping", "d_l"), "load", starts=((given + step,),),
                nominal=(given,))  # fmt: skip


def _listed_weight(joint: Joint) -> tuple[float, float]:
    """Return a and b of the weight a cos q + b sin q that a joint file lists [N m]."""
    row = joint.effects.get("gravity", {})
    torque, angle = (float(row.get(s, 0.0)) for s in ("torque", "angle"))  # type: ignore[arg-type]
    return -torque * math.sin(angle), torque * math.cos(angle)


def gravity(joint: Joint, scales: Scales) -> Term:
    """Return the term of a weight; a listed one is often another, as of a payload."""
    known = _listed_weight(joint)
    size, most = 0.2 * scales.torque, HEAVIEST * scales.peak + math.hypot(*known)
    pairs = zip(("a", "b"), known, strict=True)
    numbers = tuple(Free(s, "N m", x, size, low=-most, high=most) for s, x in pairs)

    def put(draft: Draft, values: Sequence[float]) -> None:
        a, b = values  # the load needs a cos q + b sin q
        row = draft.row("gravity")
        row["torque"], row["angle"] = math.hypot(a, b), -math.atan2(a, b)

    return Term(
        "gravity", numbers, put, "load", nominal=known,
        starts=tuple((known[0] + k * size, known[1] + m * size) for k, m in AROUND),
        replaces=("torque_offset",),
        factor=LIKELY if any(known) else RARE,
    )  # fmt: skip


def _torque_sensor(logs: Sequence[Log]) -> list[Term]:
    spread = max(float(np.std(log.measured["tau"])) for log in logs if "tau" in log.measured)
    if spread <= 0.0:  # a sensor that is not connected
        return []
    gain = Free("gain", "-", 1.0, 0.05, True, 0.2, 5.0)
    bias = Free("bias", "N m", 0.0, 0.05 * spread)
    dt = logs[0].dt
    late = _late(dt, max(SLOWEST, 4.0 * dt))
    return [
        Term("torque_gain", (gain,), sets("torque_gain", "gain"), channel="tau", nominal=(1.0,),
             starts=((1.1,), (0.9,))),
        Term("torque_bias", (bias,), sets("torque_bias", "bias"), channel="tau", nominal=(0.0,),
             starts=((0.1 * spread,), (-0.1 * spread,))),
        Term("torque_delay", (late,), sets("torque_delay", "delay"), channel="tau",
             nominal=(0.0,), starts=((1.5 * dt,),), family="late"),
    ]  # fmt: skip


def _spring(joint: Joint, logs: Sequence[Log]) -> list[Term]:
    p = joint.parameters
    with_tau = [log for log in logs if "tau" in log.measured]
    swing = [np.abs(log.states[:, 1] - log.states[:, 2]) for log in logs]
    reach = max(float(np.percentile(x - x.min(), 99)) for x in swing) or 1e-3
    k_b = p.get("k_b", 0.0)
    play = min(reach, 0.5 * WIDEST)
    gap = Free("gap", "rad", 0.0, 0.05 * play, low=0.0, high=2.0 * play)
    cubic = Free("k_3", "N m/rad^3", 0.0, 0.1 * k_b / reach**2, low=0.0)
    found = [
        Term("backlash", (gap,), sets("backlash", "gap"), nominal=(0.0,),
             starts=((0.1 * play,), (0.4 * play,))),
        Term("hardening", (cubic,), sets("hardening", "k_3"), nominal=(0.0,),
             starts=((0.2 * k_b / reach**2,),)),
    ]  # fmt: skip
    if with_tau:
        size = 0.05 * k_b * reach
        tau_h = Free("tau_h", "N m", 0.0, size, low=0.0)
        delta = Free("delta_h", "rad", 0.1 * reach, 0.5, True, 1e-3 * reach, reach)
        found.append(
            Term("spring_hysteresis", (tau_h, delta), sets("spring_hysteresis", "tau_h", "delta_h"),
                 nominal=(0.0, 0.1 * reach), starts=((size, 0.1 * reach), (size, 0.3 * reach)))
        )  # fmt: skip
    return found
