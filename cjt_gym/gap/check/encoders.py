"""Whether the angles at both ends of a spring are those of its ends, read at the same instant.

If one angle is read later than the other, it looks like a deflection proportional to the speed, and
so like a spring that is too soft, with damping. If they are exchanged, the spring seems to push
where it pulls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import nnls

from cjt_gym.errors import CjtGymError
from cjt_gym.gap.check.balance import Balance, factors, left_over
from cjt_gym.gap.check.pieces import Columns, motion, smooth
from cjt_gym.gap.check.view import View
from cjt_gym.joint import JointFile, Structure
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record

LEAST = 0.3
"""Delay above which it is reported, in samples."""
BY_SPEED = 0.9
"""Least share of the deflection's variance, beyond the spring's windup, explained by the speed."""
SOFTEST = 0.5
"""Least plausible stiffness of a spring, relative to the datasheet's."""
LATE = "q_l"
TOLD, SURE, NOTHING = 0.5, 0.5, 0.8
"""Largest share of the torque, or of the load's acceleration, that exchanged angles leave, its
ratio to what those in place leave, from which they are exchanged, and the least share of an
acceleration that these must leave then. Of 43 simulated joints those in place left 0.06 to 0.60 of
the load's acceleration, exchanged ones 0.90 to 1.00; of 5 logs of a torsion rig 0.06 to 0.13 and
0.96."""


def mapped_twice(view: View) -> list[str]:
    """Return a sentence if both ends of a spring have the same angle in every row."""
    both = view.structure.has_spring and {"q_m", LATE} <= set(view.channels)
    if not (both and view.channels["q_m"].moves) or any(
        np.any(piece["q_m"] != piece[LATE]) for piece in view.stretches
    ):
        return []
    return ["q_l repeats q_m in every row: one column seems to be mapped twice."]


def exchanged(view: View) -> list[str]:
    """Return a sentence if a spring pulls q_m along, and the motor's torque turns q_l.

    Either tells: in a loop whose command is small, or noisy, the torque tells little.
    """
    shape, ends = view.structure, ("q_m", LATE)
    there = shape.has_spring and set(ends) <= set(view.channels) and view.drive is not None
    if not there or shape.output_fixed or not all(view.channels[name].moves for name in ends):
        return []
    told = "q_m and q_l seem to be exchanged."
    kept = min(_left_of_torque(view, *ends, sign) for sign in (1.0, -1.0))  # or it is its sign
    turned = _left_of_torque(view, *ends[::-1])
    if turned <= min(TOLD, SURE * kept):
        return [
            f"The torque of {view.drive} turns q_l, and a spring then pulls q_m along: "
            f"{turned:.0%} of the torque is left so, {kept:.0%} as they are mapped. {told}"
        ]
    own, other = (_left_of_load(view, *pair) for pair in (ends, ends[::-1]))
    if "tau_l" in view or other > min(TOLD, SURE * own) or own < NOTHING:
        return []
    return [
        f"The deflection of a spring pulls q_m along, not q_l: it leaves {other:.0%} of the "
        f"acceleration of q_m, and {own:.0%} of that of q_l. {told}"
    ]


def _left_of_torque(view: View, driven: str, pulled: str, sign: float = 1.0) -> float:
    """Return the share of the motor's torque that a body on a spring leaves unexplained."""

    def terms(piece: Columns) -> tuple[Floats, list[Floats]]:
        own = motion(piece, driven, 1.0, view.width)
        apart = own["q"] - smooth(piece[pulled], view.width)
        driving = sign * smooth(view.driving(piece), view.width)
        return driving, [own["a"], own["v"], np.sign(own["v"]), apart]

    return _left_over(view, terms)


def _left_of_load(view: View, driven: str, pulled: str) -> float:
    """Return the share of a load's acceleration that the spring which pulls it leaves."""

    def terms(piece: Columns) -> tuple[Floats, list[Floats]]:
        own = motion(piece, pulled, 1.0, view.width)
        apart = smooth(piece[driven], view.width) - own["q"]
        return own["a"], [apart, -own["v"], -np.sign(own["v"])]

    return _left_over(view, terms)


def _left_over(view: View, terms: Callable[[Columns], tuple[Floats, list[Floats]]]) -> float:
    """Return the share of a quantity that terms of positive sizes leave unexplained.

    Inertia, friction and stiffness are not negative; the zeros of both encoders are arbitrary.
    """
    pieces = [terms(piece) for piece in view.stretches if len(piece["t"]) > 2 * view.width]
    if not pieces:
        return 1.0
    y = np.concatenate([one for one, _ in pieces])
    matrix = np.concatenate([np.stack(columns) for _, columns in pieces], axis=1).T
    matrix = np.column_stack([matrix, np.ones(len(y)), -np.ones(len(y))])
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    left = nnls(matrix / size, y - y.mean())[1] ** 2 / len(y)
    return float(np.sqrt(left / max(float(np.var(y)), 1e-300)))


def late_angle(view: View) -> float:
    """Return how much later than q_m the angle q_l is read [s]; 0 if the spring may explain it."""
    shape, both = view.structure, {"q_m", LATE} <= set(view.channels)
    if not (shape.has_spring and both) or shape.output_fixed or view.value("k_b") <= 0.0:
        return 0.0
    balance = view.motor
    if balance is None:
        return 0.0
    apart = _at(view, balance, LATE) - _at(view, balance, "q_m")
    winds = [balance[name] for name in ("one", "q", "a")]
    if "tau" in view:
        winds.append(_at(view, balance, "tau"))
    without, left = left_over(apart, winds), left_over(apart, [*winds, balance["v"]])
    if without == 0.0 or left**2 > (1.0 - BY_SPEED) * without**2:
        return 0.0
    late = -float(factors(apart, [*winds, balance["v"]])[-1])
    fast = float(np.quantile(np.abs(balance["v"]), 0.95))
    wound = SOFTEST * _stiffness(view) * abs(late) * fast
    # a measured torque tells what winds the spring, but not what winds a gearbox before it
    sure = ("tau" in view and not shape.has_gear) or wound > balance.level
    return late if abs(late) > LEAST * view.dt and sure else 0.0


def _stiffness(view: View) -> float:
    """Return the stiffness between the two angles, including the gearbox [N m/rad]."""
    springs = [view.value("k_b"), view.value("k_g") if view.structure.has_gear else 0.0]
    return 1.0 / sum(1.0 / k for k in springs if k > 0.0)


def angles_apart(view: View) -> list[str]:
    """Return a sentence if the two angles are read at different instants."""
    late = late_angle(view)
    if late == 0.0:
        return []
    rows = late / view.dt
    way = "follows" if late > 0.0 else "leads"
    return [
        f"q_l {way} q_m by {abs(rows):.2g} samples ({1e3 * abs(late):.2g} ms), which the "
        "spring's deflection cannot explain: they are read at different instants. A diagnosis "
        f"corrects this; a mapping does with samples_late = {rows:.2g}."
    ]


def angles_in_step(
    records: Sequence[Record], held: Sequence[Record], file: JointFile, shape: Structure
) -> tuple[list[Record], list[Record]]:
    """Return records and held-out records with both angles aligned to the same instants."""
    try:
        late = late_angle(View.of(records, file, shape))
    except CjtGymError:
        late = 0.0
    if late == 0.0:
        return list(records), list(held)
    moved = [[_moved(r, late) if LATE in r else r for r in some] for some in (records, held)]
    return moved[0], moved[1]


def _moved(record: Record, late: float) -> Record:
    """Return a record with q_l and dq_l shifted to the instants at which they were read."""
    t = record.t
    x = {name: np.interp(t + late, t, record[name]) for name in (LATE, "dq_l") if name in record}
    first, last = np.searchsorted(t, [t[0] - late, t[-1] - late + 1e-12])
    return record.with_columns(x).slice(int(first), int(last))


def _at(view: View, balance: Balance, name: str) -> Floats:
    """Return a channel where the joint moves, smoothed like its motion, minus its mean."""

    def smoothed(piece: Columns) -> Floats:
        x = smooth(piece[name], balance.width)
        return np.asarray(x - x.mean())

    return view.at_motion(smoothed)
