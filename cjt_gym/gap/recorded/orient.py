"""Signs and units of a record's channels, where the physics of a joint determines them.

Each law relates the signs of two channels: a current follows its command, a velocity is the slope
of its angle, the spring's torque grows with its deflection,

    tau = k_b (q_m - q_l) + ...,

and the motor's torque accelerates its inertia and loads the spring,

    k_t n i = I ddq_m + d dq_m + friction + tau - tau_l.

The signs that agree with these laws are found by exhaustive search; of equally good combinations
the one that changes fewest channels counts. Reversing all signs agrees just as well: which
direction is positive cannot be determined.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import pi

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import nnls
from scipy.signal import correlate, correlation_lags, savgol_filter

from cjt_gym.errors import RecordError
from cjt_gym.gap.recorded.series import same_file
from cjt_gym.joint import JointFile, Structure
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record, Repair

FOLLOWERS = (
    ("i_cmd", "i"),
    ("tau_cmd", "i"),
    ("tau_m", "i"),
    ("i_extra", "i_cmd"),
    ("tau_ref", "tau"),
    ("q_ref", "q_m"),
    ("q_g", "q_m"),
)
"""Pairs of which the second follows the first, with the same sign."""
SLOPES = (("q_m", "dq_m"), ("q_g", "dq_g"), ("q_l", "dq_l"))
DRIVING = ("i", "tau_m", "i_cmd", "tau_cmd", "v")
"""Channels that represent the motor's torque, best first: of a voltage but for its back-EMF, which
the speed takes as friction does."""
CERTAIN = 0.7
"""Correlation above which two channels follow each other."""
TOGETHER = 0.98
"""Correlation above which both angles show one motion, of which a soft spring takes little."""
AMBIGUOUS = 0.8
"""Ratio of the best correlation to the best with the opposite sign above which it is taken."""
PARTIAL = 0.35
"""Partial correlation above which a term of an equation of motion is certain."""
CLEAR = 0.25
"""Difference over sum of two signs' unexplained shares above which one is certain."""
SOUND = 0.1
"""Unexplained share with the present sign up to which it is not doubted: a controller can make a
late torque follow the opposite sign as well."""
EXPLAINED = 0.6
"""Share of the motor's torque that its equation must explain."""
SWING = 0.05
"""Travel above which a weight, which its file need not list, may act on the motor [rad]."""
SMOOTH = 0.04
"""Time over which angles are smoothed for differentiation [s]."""
MOST_LATE = 0.1
"""Largest lag between two related channels [s]."""
FASTEST = 20_000
"""Minimum number of samples to compare two channels."""
HOLE = 0.5
"""Time without any measurement over which channels are not interpolated [s]."""
ORDER = ("tau_l", "tau", "q_l", "q_g", "dq_m", "dq_g", "dq_l", "q_m", "i", "i_cmd")
"""Channels whose sign is doubted first if any of several would do."""
LAWS = {
    "q_m": "the motor's torque accelerates it",
    "tau": "the motor's torque loads the spring",
    "tau_l": "it moves the joint as the motor's torque does",
}
"""The laws of the motor's equation, by the channel that it ties to the motor's torque."""
GENERATED = (
    " Or it is right, and the speed makes the current, as in shorted windings: then nothing that "
    "was recorded drives the joint."
)
BY_SPEED = 0.95
"""Share of a current that its speed explains from which that is told; it was 0.99 of an exoskeleton
that was moved by hand with its windings shorted."""
WOUND = "the spring's torque grows as it is wound"
"""The law of the spring, as a repair tells it."""
UNIT_FACTORS = {180.0 / pi: "180/pi", pi / 180.0: "pi/180", 1e3: "1000", 1e-3: "1/1000"}
FACTOR_MISFIT = 0.15


@dataclass(frozen=True)
class Tie:
    """Relation of two channels by a law."""

    first: str  # a channel
    second: str
    # their agreement once the law is applied, -1 to 1; negative if one of them has the wrong sign
    strength: float
    law: str  # description of the law


def orient(
    record: Record, joint: JointFile, structure: Structure, shown_by: Record | None = None
) -> tuple[Record, tuple[Repair, ...]]:
    """Return a record with consistent signs, and remarks on what was changed.

    Args:
        record: The record; NaN where a sample is missing.
        joint: The nominal joint.
        structure: How its bodies are joined.
        shown_by: Record of the same channels by which the signs are judged; by default the record
            itself.

    Returns:
        The record, which is the same object if no sign was reversed, and a line for each channel
        that was reversed or seems to have another unit.
    """
    channels = _filled(shown_by or record)
    ties = [*_following(channels, structure, record.dt), *_spring(channels, structure)]
    motor = _Motor.of(channels, record.dt, joint.parameters.axis)
    if motor is not None:
        ties += motor.ties()
    turned = _turned(ties)
    generated = motor is not None and motor.is_generated
    repairs = [_turn(name, ties, generated=generated) for name in turned]
    repairs += _scales(channels, motor, joint, structure)
    if not turned:
        return record, tuple(repairs)
    columns = {name: -record[name] for name in turned}
    texts = [repair.text for repair in repairs if repair.changed]
    known = {**record.provenance, "repairs": [*record.provenance.get("repairs", []), *texts]}
    return replace(record.with_columns(columns), provenance=known), tuple(repairs)


def all_oriented(
    records: Sequence[Record], joint: JointFile, structure: Structure
) -> tuple[list[Record], list[Repair]]:
    """Return records whose channels agree in their signs, and what was turned.

    The longest piece of a log shows the signs of all.

    Raises:
        RecordError: A channel seems to have another unit.
    """
    longest = [max(same_file(record, records), key=len) for record in records]
    pairs = [orient(r, joint, structure, by) for r, by in zip(records, longest, strict=True)]
    for record, repairs in pairs:
        odd = [repair.text for repair in repairs if repair.kind == "unit"]
        if odd:
            raise RecordError(
                f"{record.owner}: {' '.join(odd)} A channel is in another unit than the record "
                f"states, or {joint.name} is another joint. Give the unit, the gear side or the "
                "joint: [columns] of --mapping, or the values of --joint, such as an inertia."
            )
    found = dict.fromkeys(repair for _, some in pairs for repair in some)
    return [record for record, _ in pairs], list(found)


def _filled(record: Record) -> dict[str, Floats]:
    """Return the channels that vary, on even times, with missing samples interpolated.

    Of a log with holes this is its longest part between two of them.
    """
    known = np.any([np.isfinite(record[name]) for name in record.columns if name != "t"], axis=0)
    pieces = np.split(record.t[known], np.flatnonzero(np.diff(record.t[known]) > HOLE) + 1)
    longest = max(pieces, key=len)
    record = record.slice(*np.searchsorted(record.t, longest[[0, -1]], "right") - [1, 0])
    t, start = record.t, max(len(record) - FASTEST, 0) // 2
    grid = t[0] + record.dt * np.arange(round((t[-1] - t[0]) / record.dt) + 1)
    grid = grid[start : start + FASTEST]
    out = {}
    for name in record.columns:
        known = np.isfinite(record[name])
        if name != "t" and known.sum() > 100 and np.ptp(record[name][known]) > 0.0:
            out[name] = np.interp(grid, t[known], record[name][known])
    return out


def _following(channels: dict[str, Floats], structure: Structure, dt: float) -> Iterator[Tie]:
    free = () if structure.output_fixed else (("q_l", "q_m"), ("q_ref", "q_l"))
    for first, second in (*FOLLOWERS, *free):
        if first in channels and second in channels:
            law = f"{second} follows {first}"
            yield Tie(first, second, _alike(channels[first], channels[second], dt), law)
    for angle, velocity in SLOPES:
        if angle in channels and velocity in channels:
            slope, law = np.gradient(channels[angle], dt), f"{velocity} is the slope of {angle}"
            yield Tie(angle, velocity, _alike(slope, channels[velocity], dt), law)


def _alike(x: Floats, y: Floats, dt: float) -> float:
    """Return the correlation of two channels at the lag that maximises it; 0 if poor.

    A periodic signal also follows its opposite, half a period later: that is no reversed sign.
    """
    x, y = x - x.mean(), y - y.mean()
    lags = correlation_lags(len(y), len(x))
    near = np.abs(lags) <= MOST_LATE / dt
    cross = correlate(y, x, method="fft")[near] / max(float(np.sqrt((x @ x) * (y @ y))), 1e-300)
    along, against = float(cross.max()), float(-cross.min())
    best = -against if AMBIGUOUS * against > along else along
    return best if abs(best) > CERTAIN else 0.0


def _spring(channels: dict[str, Floats], structure: Structure) -> Iterator[Tie]:
    """Yield the relations by the spring: its torque grows with q_m and falls with q_l."""
    if "tau" not in channels or not structure.has_spring:
        return
    names = [name for name in ("q_m", "q_l") if name in channels]
    if not structure.output_fixed and len(names) < 2:
        return
    signs = {"q_m": 1.0, "q_l": -1.0}
    for name, strength in _partial(channels["tau"], {n: channels[n] for n in names}).items():
        yield Tie(name, "tau", signs[name] * strength, WOUND)


def _partial(y: Floats, terms: dict[str, Floats]) -> dict[str, float]:
    """Return the partial correlation of y with each term, given all the others."""
    constant = np.ones_like(y)
    out = {}
    for name, x in terms.items():
        others = np.column_stack([constant, *(v for n, v in terms.items() if n != name)])
        rest_x, rest_y = _rest(x, others), _rest(y, others)
        size = float(np.sqrt((rest_x @ rest_x) * (rest_y @ rest_y)))
        alike = float(rest_x @ rest_y) / max(size, 1e-300)
        enough = np.std(rest_x) > 1e-9 * max(float(np.std(x)), 1e-300)
        out[name] = alike if enough and abs(alike) > PARTIAL else 0.0
    return out


def _rest(y: Floats, others: Floats) -> Floats:
    return np.asarray(y - others @ np.linalg.lstsq(others, y, rcond=None)[0], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Motor:
    """The motor's equation: its drive torque and the terms that balance it."""

    driving: str
    moving: str  # the channel of its motion: its angle, or its velocity
    drive: Floats
    terms: dict[str, Floats]
    weight: tuple[Floats, ...]  # what a weight on the joint adds, of either sign

    @classmethod
    def of(cls, channels: dict[str, Floats], dt: float, axis: str) -> _Motor | None:
        driving = next((name for name in DRIVING if name in channels), None)
        moving = "q_m"
        told = driving == "v" or "tau_l" in channels  # a weight, as an arm has, needs the angle
        if moving not in channels and "dq_m" in channels and told:
            moving = "dq_m"
        if driving is None or moving not in channels:
            return None
        width = int(np.clip(round(SMOOTH / dt) | 1, 5, 101))
        if len(channels[moving]) < 4 * width:
            return None
        q, drive = channels[moving], savgol_filter(channels[driving], width, 3)
        if moving == "dq_m":
            q = cumulative_trapezoid(q, dx=dt, initial=0.0)
        speed = savgol_filter(q, width, 3, deriv=1, delta=dt)
        quick = max(float(np.quantile(np.abs(speed), 0.9)), 1e-300)
        terms = {
            "acceleration": savgol_filter(q, width, 3, deriv=2, delta=dt),
            "speed": speed,
            "friction": np.tanh(speed / (0.05 * quick)),
        }
        if "tau" in channels:
            terms["tau"] = savgol_filter(channels["tau"], width, 3)
        if "tau_l" in channels:  # it accelerates the joint as the motor does, which may oppose it
            terms["tau_l"] = -savgol_filter(channels["tau_l"], width, 3)
        heavy = axis == "rotary" and "tau" not in channels and np.ptp(q) > SWING
        return cls(driving, moving, drive, terms, (np.sin(q), np.cos(q)) if heavy else ())

    def fit(self) -> tuple[dict[str, float], float]:
        """Return the factor of each term, and the share of the drive that they explain."""
        matrix = np.column_stack([*self.terms.values(), np.ones_like(self.drive)])
        factors = np.linalg.lstsq(matrix, self.drive, rcond=None)[0]
        share = 1.0 - np.var(self.drive - matrix @ factors) / max(np.var(self.drive), 1e-300)
        return dict(zip(self.terms, factors.tolist(), strict=False)), float(share)

    @property
    def is_generated(self) -> bool:
        """Whether a measured current is all but a function of the speed, which may make it."""
        alone = replace(self, terms={name: self.terms[name] for name in ("speed", "friction")})
        return self.driving == "i" and alone.fit()[1] > BY_SPEED

    def left(self, signs: Mapping[str, float], *, heavy: bool = False) -> float:
        """Return the unexplained share of the drive for given signs of q_m, tau and tau_l.

        All factors are >= 0, as physics requires, but those of an offset and of a weight.
        """
        columns = [signs.get(name, signs["q_m"]) * x for name, x in self.terms.items()]
        columns = [x / max(float(np.std(x)), 1e-12) for x in columns]
        either = (np.ones_like(self.drive), *(self.weight if heavy else ()))
        matrix = np.column_stack([*columns, *either, *(-x for x in either)])
        rest = nnls(matrix, self.drive)[1] ** 2 / len(self.drive)
        return float(rest) / max(float(np.var(self.drive)), 1e-300)

    def ties(self) -> list[Tie]:
        """Return the relations of signs by the equation."""
        names = [name for name in LAWS if name == "q_m" or name in self.terms]
        pairs = list(product((1.0, -1.0), repeat=len(names)))
        left = {pair: self.left(dict(zip(names, pair, strict=True))) for pair in pairs}
        if min(left.values()) > 1.0 - EXPLAINED:
            return []
        clear = [_clear(left, k) for k in range(len(names))]
        if self.weight and clear[0] < 0.0:  # a weight that is lifted looks like a turned inertia
            heavy = {
                pair: self.left(dict(zip(names, pair, strict=True)), heavy=True) for pair in pairs
            }
            clear[0] = min(_clear(heavy, 0), 0.0)
        tied = [self.moving if name == "q_m" else name for name in names]
        return [
            Tie(self.driving, own, c, LAWS[name])
            for own, name, c in zip(tied, names, clear, strict=True)
        ]


def _clear(left: Mapping[tuple[float, ...], float], k: int) -> float:
    """Return how much better the present sign of a channel fits than the opposite, -1 to 1."""
    right = min(share for signs, share in left.items() if signs[k] > 0)
    wrong = min(share for signs, share in left.items() if signs[k] < 0)
    better = (wrong - right) / max(wrong + right, 1e-300)
    if better < 0.0 and right < SOUND:
        return 0.0
    return better if abs(better) > CLEAR else 0.0


def _turned(ties: list[Tie]) -> list[str]:
    """Return the smallest set of channels to reverse so that the relations agree."""
    used = [tie for tie in ties if tie.strength != 0.0]
    names = sorted({name for tie in used for name in (tie.first, tie.second)}, key=_doubt)
    if all(tie.strength > 0.0 for tie in used):
        return []

    def cost(signs: tuple[int, ...]) -> tuple[float, int, tuple[int, ...]]:
        sign = dict(zip(names, signs, strict=True))
        against = [
            abs(tie.strength)
            for tie in used
            if sign[tie.first] * sign[tie.second] * tie.strength < 0.0
        ]
        return round(sum(against), 6), sum(s < 0 for s in signs), signs

    best = min(product((-1, 1), repeat=len(names)), key=cost)
    return [name for name, sign in zip(names, best, strict=True) if sign < 0]


def _doubt(name: str) -> tuple[int, str]:
    return (ORDER.index(name) if name in ORDER else len(ORDER), name)


def _turn(name: str, ties: list[Tie], *, generated: bool) -> Repair:
    laws = dict.fromkeys(
        tie.law for tie in ties if name in (tie.first, tie.second) and tie.strength < 0.0
    )
    reason = "; ".join(laws) or "it goes with another that was turned"
    wound = {tie.first for tie in ties if tie.law == WOUND and tie.strength < 0.0}
    also = " Or q_m and q_l are swapped." if name == "tau" and {"q_m", "q_l"} <= wound else ""
    also += GENERATED if generated and LAWS["q_m"] in laws else ""
    return Repair("sign", name, 0, True, f"{name}: sign turned ({reason}).{also}")


def _scales(
    channels: dict[str, Floats], motor: _Motor | None, joint: JointFile, structure: Structure
) -> list[Repair]:
    """Return remarks on channels off by a factor typical of a wrong unit."""
    p, found = joint.parameters, []
    factors = dict(UNIT_FACTORS)
    if p.n > 2.0:
        factors |= {p.n: "the gear ratio", 1.0 / p.n: "one over the gear ratio"}
    if {"q_m", "q_l"} <= channels.keys() and not structure.output_fixed:
        turned, other = channels["q_m"], channels["q_l"]
        if np.ptp(turned) > 0.0 and abs(_alike(turned, other, 1.0)) > TOGETHER:
            slope = abs(np.polyfit(turned, other, 1)[0])
            found.append(("q_l", "q_m", "the angle of the load per angle of the motor", slope))
    if {"q_m", "tau"} <= channels.keys() and structure.has_spring:
        wound = channels["q_m"] - channels.get("q_l", np.zeros(1))
        k_b = p.get("k_b", 0.0)
        slope = np.polyfit(wound, channels["tau"], 1)[0] if np.ptp(wound) > 0.0 else 0.0
        if abs(_alike(wound, channels["tau"], 1.0)) > CERTAIN and k_b > 0.0:
            found.append(("q_m", "tau", "spring deflection per torque", k_b / abs(slope)))
    if motor is not None and motor.driving in ("i", "i_cmd"):
        per_term, share = motor.fit()
        alike = _partial(motor.drive, motor.terms) if share > EXPLAINED else {}
        torque = p.k_t * p.n
        if alike.get("tau"):
            found.append(
                (motor.driving, "tau", "current per torque", abs(per_term["tau"]) * torque)
            )
        if alike.get("acceleration") and motor.moving == "q_m":
            apart = "tau" in motor.terms and structure.has_spring
            bodies = ("I_m", "I_g") if apart else ("I_m", "I_g", "I_l")
            mass = sum(p.get(name, 0.0) for name in bodies)
            measured = abs(per_term["acceleration"]) * torque
            found.append((motor.moving, motor.driving, "acceleration per current", mass / measured))
    return [
        Repair(
            "unit",
            name,
            0,
            False,
            f"{name} or {other}: {what} is {ratio:.4g} times nominal, near {text}.",
        )
        for name, other, what, ratio in found
        for factor, text in factors.items()
        if abs(ratio / factor - 1.0) < FACTOR_MISFIT
    ]
