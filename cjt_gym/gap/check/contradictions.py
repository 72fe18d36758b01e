"""Channels of a record that contradict each other."""

from __future__ import annotations

from math import pi

import numpy as np

from cjt_gym.gap.check.balance import left_over, orthonormal
from cjt_gym.gap.check.channels import Channel
from cjt_gym.gap.check.transmission import deflection
from cjt_gym.gap.check.view import View
from cjt_gym.gap.digits import plain
from cjt_gym.gap.recorded.slope import integrated, is_scaled
from cjt_gym.records.doubts import doubts

SLOPE = 0.15
"""Least reported relative difference between a velocity and the slope of its angle."""
GAIN = 0.25
"""Relative difference between a current and its command above which it is reported."""
EXACTLY, SLIGHT = 0.998, 0.05
"""Least correlation of a current that follows its command but for a factor, and the difference that
is reported then: in 50 simulated logs and in two real drives it is below 0.005. Real drives that
follow less closely lose a tenth to lag and noise."""
STEEPER = 0.25
"""Relative difference by which a limited current follows small changes further than large ones."""
SLOW = 32
"""Number of samples over which both are averaged to reduce the influence of lags and noise."""
LINEAR = 0.98
"""Least correlation of these averages for them to be proportional, and not clipped, say."""
FEWEST = 20
"""Fewest averages from which a factor is determined."""
LIKE, UNLIKE = 0.2, 0.5
"""Difference of a column from the command, relative to it, up to which it could be its current, and
from which on it could not."""
SAME = 0.9
"""Least correlation of two channels that represent the same motion."""
TORQUES, ALIKE = 2.0, 0.7
"""Least reported factor between a measured torque and that of the motor, and least correlation of
the two once inertia and friction are taken out. Of 188 simulated logs one exceeds 1.35."""
SPRING = 1.6
"""Least reported factor between torque and stiffness times deflection."""
FREE, RINGING = 5.0, 20.0
"""Ratio of the torque that the motion of a held joint takes to that measured, or to that of the
motor, which may ring, from which it is not held."""
RATIO = 0.1
"""Relative tolerance within which two angles differ by the gear ratio."""
COUNTED = (2.0, 4.0)
"""Counts of an encoder of two tracks per line, if one or both edges of both tracks count."""
STEPPED = 0.01
"""The same for the steps of an angle and those of its encoder, which are known exactly."""
SMALLEST = 0.2
"""Share of the blocks, those of the smallest changes, in which a limit does not act."""
TOP, FLAT = 0.97, 0.1
"""Share of its largest size from which a channel is at its top, and least share of such samples of
one that is limited: also twice that of its command."""


OFTEN, RARELY, UNTOLD = 0.1, 0.01, 0.7
"""Least share of motion in either direction, largest share of an input of the other sign, and least
share of it that motion leaves, for an input to be taken for a magnitude."""


def velocities(view: View) -> list[str]:
    """Return sentences on velocities that are not the slopes of their angles."""
    found = []
    for body in "mgl":
        angle, velocity = f"q_{body}", f"dq_{body}"
        if angle not in view or velocity not in view:
            continue
        x = np.concatenate([_lumps(np.gradient(p[angle], view.dt)) for p in view.stretches])
        y = np.concatenate([_lumps(p[velocity]) for p in view.stretches])
        if _is_told(view, angle, velocity):
            continue
        slope = _factor(x, y)  # None where noise hides it
        longest = max(view.stretches, key=lambda p: len(p[angle]))
        exact, _, rest = integrated(longest[velocity], longest[angle], view.dt)
        if is_scaled(exact, rest):
            found.append(
                f"{velocity} is {plain(exact)} times the slope of {angle}: its unit or scale is "
                "wrong, or the times of the rows are."
            )
        elif slope is not None and abs(slope - 1.0) >= SLOPE:
            found.append(f"{velocity} is {plain(slope)} times the slope of {angle}.")
    return found


def _is_told(view: View, angle: str, velocity: str) -> bool:
    """Return whether reading a record already showed that a velocity contradicts its angle."""
    told = (
        repair
        for r in view.records
        for repair in doubts({name: r[name] for name in r.columns}, r.dt)
    )
    return any(
        repair.channel == "t" or (repair.channel in (angle, velocity) and ("slope" in repair.text))
        for repair in told
        if repair.kind in ("unit", "sign")
    )


def currents(view: View) -> list[str]:
    """Return sentences on contradictory currents, or torques that represent them."""
    gain = view.value("k_t") * view.ratio
    pairs = [("i_cmd", "i", 1.0, "i_cmd")]
    if gain > 0.0:
        pairs += [(a, b, gain, f"k_t n {a}") for a, b in (("i_cmd", "tau_cmd"), ("i", "tau_m"))]
    found = []
    for one, other, times, words in pairs:
        if one not in view or other not in view:
            continue
        exact = None if other != "i" else _follows(view, one, other, EXACTLY)
        factor = _follows(view, one, other) if exact is None else exact
        limit = GAIN if exact is None else SLIGHT
        off = None if factor is None else factor / times
        same = view.channels[one].unit == view.channels[other].unit
        if off is not None and (same or times != 1.0) and abs(off - 1.0) > limit:
            found.append(f"{other} is {plain(off)} times {words}.")
    return _exchanged(view) or found


def magnitudes(view: View) -> list[str]:
    """Return a sentence on an input that was logged without its sign.

    Where the angle was logged, the energy of the joint tells that better; see `foreign`.
    """
    balance, name = view.motor, view.drive
    if balance is None or name is None or "q_m" in view:
        return []
    u, v = balance["u"], balance["v"]
    both = min(np.mean(v > 0.0), np.mean(v < 0.0))
    if both < OFTEN or min(np.mean(u < 0.0), np.mean(u > 0.0)) > RARELY:
        return []
    columns = [balance[key] for key in ("a", "v", "s", "one")]
    known, turned = (
        left_over(x, columns) / max(float(np.std(x)), 1e-300) for x in (u, np.abs(u) * np.sign(v))
    )
    if known < UNTOLD or turned > 0.5 * known:
        return []
    return [
        f"{name} has one sign throughout, although the joint turns both ways, and matches the "
        "motion only with the sign of the speed: it looks like a magnitude. Log it with its sign."
    ]


def _exchanged(view: View) -> list[str]:
    """Return a sentence if the torque equals the commanded current, and the current does not."""
    if not all(name in view for name in ("i_cmd", "i", "tau")):
        return []
    wanted, i, tau = (
        np.concatenate([piece[name][piece["valid"] > 0.0] for piece in view.stretches])
        for name in ("i_cmd", "i", "tau")
    )
    size = float(np.linalg.norm(wanted))
    apart = [float(np.linalg.norm(x - wanted)) for x in (tau, i)]
    if not apart[0] < LIKE * size or not apart[1] > UNLIKE * size:
        return []
    return ["tau follows i_cmd as a current does, and i does not: are their columns exchanged?"]


def torques(view: View) -> list[str]:
    """Return a sentence on a measured torque whose scale is not that of the motor's."""
    balance, joint = view.motor, view.joint
    if balance is None or not view.cut or "tau" not in balance or joint is None:
        return []
    k_t = joint.parameters.quantities.get("k_t")
    if view.drive not in ("i", "i_cmd") or k_t is None or k_t.guess:
        return []
    moving = orthonormal([balance[name] for name in ("a", "v", "s", "one")], len(balance))
    tau, motor = (x - moving @ (moving.T @ x) for x in (balance["tau"], balance.y + balance["tau"]))
    least, most = _factor(motor, tau, ALIKE), _factor(tau, motor, ALIKE)
    if least is None or most is None:
        return []
    # with all noise in one torque or in the other; a turned sign is told elsewhere
    ends = sorted((abs(least), abs(1.0 / most)))
    if ends[0] < TORQUES and ends[1] > 1.0 / TORQUES:
        return []
    factors = dict.fromkeys(plain(end, 2) for end in ends)
    return [
        f"Apart from inertia and friction, tau changes {' to '.join(factors)} times as much as the "
        "motor's torque does by the joint file: k_t, n or the scale of tau is wrong."
    ]


def _follows(view: View, one: str, other: str, alike: float = LINEAR) -> float | None:
    """Return the factor between slow changes of two channels; None if not proportional.

    Where small changes are followed further than large ones, or the second channel is often at its
    largest value, it is limited, not scaled.
    """
    piece = view.stretches[0]
    x, y = (_lumps(piece[name], SLOW) for name in (one, other))
    if len(x) < FEWEST or _factor(x, y, alike) is None:
        return None
    factor = float(np.std(y) / np.std(x))
    size = np.abs(x - np.median(x))
    low = size <= np.quantile(size, SMALLEST)
    small = _factor(x[low], y[low], 0.0)
    flat, others = (_at_the_top(piece[name]) for name in (other, one))
    limited = flat > max(FLAT, 2.0 * others) or (small or 0.0) > (1.0 + STEEPER) * factor
    return None if limited else factor


def _at_the_top(x: np.ndarray) -> float:
    """Return how often a channel is nearly at its largest size."""
    return float(np.mean(np.abs(x) > TOP * np.abs(x).max(initial=0.0)))


def angles(view: View) -> list[str]:
    """Return a sentence on load and motor angles that differ by a factor on the link side."""
    if view.structure.output_fixed or "q_l" not in view or "q_m" not in view:
        return []
    x, y = (np.concatenate([p[name] for p in view.stretches]) for name in ("q_m", "q_l"))
    factor = _factor(x, y)
    if factor is None or abs(factor - 1.0) < 0.5:
        return []
    for ratio, text in ((view.ratio, "the ratio n"), (1.0 / view.ratio, "one over the ratio n")):
        if ratio != 1.0 and abs(factor / ratio - 1.0) < RATIO:
            return [
                f"q_l is {plain(factor)} times q_m, {text} of the gear: map q_m to the link side."
            ]
    square = view.ratio**2  # the load's angle is then divided by n, and the motor's is not
    swapped = square != 1.0 and abs(factor / square - 1.0) < RATIO
    also = ": their columns may be swapped" if swapped else ""
    return [f"q_l is {plain(factor)} times q_m, and both should be on the link side{also}."]


def coarser(view: View) -> list[str]:
    """Return sentences on angles whose steps are those of their encoder in another unit."""
    return [
        f"{name} has steps {factor:.4g} times the resolution that the joint file states, {what}."
        for name, channel in view.channels.items()
        if (factor := _times_coarser(view, name, channel)) is not None
        for other, what in (
            (180.0 / pi, "as if in deg: map it with unit = 'deg'"),
            (view.ratio, "the ratio n of the gear: map it with side = 'motor'"),
        )
        if other != 1.0 and abs(factor / other - 1.0) < STEPPED
    ]


def miscounted(view: View) -> list[str]:
    """Return remarks on angles whose steps are twice or four times those of their encoder."""
    return [
        f"{name} has steps {factor:.3g} times the resolution that the joint file states: its "
        "encoder is coarser, or counts_per_rev of the mapping is that many times too small "
        "(an encoder of two tracks has four counts a line)."
        for name, channel in view.channels.items()
        if (factor := _times_coarser(view, name, channel)) is not None and is_count(factor)
    ]


def is_count(factor: float) -> bool:
    """Return whether steps differ by a factor that a miscounted encoder would make of them."""
    return any(abs(factor / times - 1.0) < STEPPED for times in COUNTED)


def _times_coarser(view: View, name: str, channel: Channel) -> float | None:
    """Return the steps of an angle relative to its stated resolution; None if none is stated."""
    stated = view.joint.sensors.get(name, {}) if view.joint is not None else {}
    if not name.startswith("q_") or "resolution" not in stated:
        return None
    return channel.resolution / stated["resolution"].number


def spring(view: View) -> list[str]:
    """Return a sentence if torque and deflection contradict the spring's stiffness."""
    k_b = view.value("k_b")
    if not view.deflection_known or k_b <= 0.0:
        return _held(view)
    stiffness = 1.0 / (
        1.0 / k_b + (1.0 / view.value("k_g", np.inf) if view.structure.has_gear else 0.0)
    )
    x = np.concatenate([deflection(view, piece) for piece in view.stretches])
    y = np.concatenate([piece["tau"] for piece in view.stretches])
    factor = _factor(x, y)
    if factor is None:
        return _held(view)
    times = factor / stiffness
    if 1.0 / SPRING < times < SPRING:
        return []
    said = f"tau is {plain(times)} times the nominal stiffness times the deflection of the spring"
    if 1.0 / SPRING < times * stiffness**2 < SPRING:
        return [f"{said}, as if q_m and tau were swapped."]
    if 1.0 / SPRING < -times < SPRING and "q_l" in view:
        return [f"{said}, as if its sign were turned or q_m and q_l were swapped."]
    return [f"{said}."]


def _held(view: View) -> list[str]:
    """Return a sentence if a motor turns further than the spring to a held output would let it."""
    k_b, gain = view.value("k_b"), view.value("k_t") * view.ratio
    angle = view.motor_angle or ""
    if not view.structure.output_fixed or k_b <= 0.0 or not angle.startswith("q_"):
        return []
    if "tau" in view:
        known, factor, name = "tau", FREE, "tau spans"
    elif view.drive in ("i", "i_cmd") and gain > 0.0:
        known, factor, name = view.drive, RINGING * gain, "the motor's torque spans"
    else:
        return []
    span, torque = (max(float(np.ptp(p[n])) for p in view.stretches) for n in (angle, known))
    if k_b * span <= factor * torque:
        return []
    unit, torque = view.torque_unit, torque * (1.0 if known == "tau" else gain)
    return [
        f"{angle} spans {span:.2g} {view.angle_unit}, which would take {k_b * span:.2g} {unit} of "
        f"a spring to a held output, and {name} {torque:.2g} {unit}: the output is free (choose "
        "such a structure), or a unit is wrong."
    ]


def _factor(x: np.ndarray, y: np.ndarray, alike: float = SAME) -> float | None:
    """Return the factor from x to y, except for offsets; None if they are not the same motion."""
    x, y = x - x.mean(), y - y.mean()
    power = float((x @ x) * (y @ y))
    if power <= 0.0 or abs(float(x @ y)) < alike * np.sqrt(power):
        return None
    return float(x @ y / (x @ x))


def _lumps(x: np.ndarray, size: int = 8) -> np.ndarray:
    """Return means over blocks of samples, which are less sensitive to noise and delay."""
    count = len(x) // size
    return np.asarray(x[: count * size].reshape(count, size).mean(axis=1))
