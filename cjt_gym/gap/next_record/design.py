"""The next experiment: the input that best separates the explanations that a record leaves open.

Each explanation that fits the record is simulated under every input of the menu, within the limits
of the joint, and the others are fitted to the result. The misfit of the best of these fits is the
cross-innovation; the input that maximises the smaller cross-innovation tells the explanations apart
whichever of them is true.

References:
    Hunter, Reiner (1965), Technometrics 7(3), for designs that discriminate between rival models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from cjt_gym.gap.judged.replay import Written, replay, written
from cjt_gym.gap.next_record.menu import MENU, Input
from cjt_gym.gap.recorded.series import Series
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.fit import DEFLATION, FLOOR, Fit, Model, Problem
from cjt_gym.gap.stages.leftover import LEFT
from cjt_gym.gap.stages.prune import SIMPLER
from cjt_gym.joint.kernel.arrays import Floats

SAMPLES, SHORTEST, LONGEST = 4000, 4.0, 20.0
"""Number of samples of an input, and its shortest and longest duration [s]."""
MOVES = 10
"""Number of steps when fitting a rival."""
RESERVE = 0.8
"""Share of a limit of the joint file that an experiment uses."""
BEYOND = 2.0
"""Largest size of an experiment relative to what was recorded."""
TELLS = 14.0
"""Margin of evidence above which an input tells two explanations apart."""
BACK_OFF, TRIALS = 0.75, 12
"""Factor by which an input that breaks a limit is scaled down, and the number of attempts."""


@dataclass(frozen=True)
class Bounds:
    """Limits of an experiment."""

    current: float  # largest current [A]
    speed: float  # largest speed of the motor [rad/s]
    torque: float  # largest joint torque [N m]
    travel: float  # largest distance of the motor from its starting point [rad]


@dataclass(frozen=True)
class Cross:
    """How badly a rival fits data simulated with the true explanation.

    The rival lacks `margin` of evidence and leaves a normalised residual of rms `residual` in
    `stage`, where it fits worst.
    """

    true: str
    rival: str
    margin: float
    stage: str
    residual: float


@dataclass(frozen=True, eq=False)
class Prospect:
    """Expected outcome of an input."""

    input: Input  # row of the menu
    current: Floats  # the input [A], shape (N,)
    dt: float  # time between samples [s]
    crosses: tuple[Cross, ...]  # one per ordered pair of explanations
    margin: float  # the smallest of their margins that any input can make large

    @property
    def tells(self) -> bool:
        """Whether it tells the explanations apart."""
        return self.margin >= TELLS


def bounds(setting: Setting) -> Bounds:
    """Return the limits of an experiment: the joint file's, near the recorded range."""
    series, p = setting.series, setting.joint.parameters
    drive = series["i_cmd"] if "i_cmd" in series else series["i"]
    current = BEYOND * float(np.abs(drive).max())
    # A spring to a locked output bounds the motion by itself; slow records do not show how far.
    locked = setting.structure.output_fixed and setting.has_spring
    speed = np.inf if locked else BEYOND * float(np.abs(series.speed("q_m")).max())
    travel = np.inf if locked and "tau" in series else BEYOND * float(np.ptp(series["q_m"]))
    torque = BEYOND * float(np.abs(series["tau"]).max()) if "tau" in series else np.inf
    return Bounds(
        min(current, RESERVE * p.get("i_p", np.inf)),
        min(speed, RESERVE * p.get("dq_p", np.inf)),
        torque,
        travel,
    )


def prospects(problem: Problem, fits: Mapping[str, Fit]) -> tuple[Prospect, ...]:
    """Return the expected outcome of each input of the menu, best first.

    Args:
        problem: The record that leaves the explanations open.
        fits: The explanations by name, at least two.
    """
    setting = problem.stages.setting
    within = bounds(setting)
    models = {name: written(problem, fit.model, fit.z) for name, fit in fits.items()}
    found = []
    with np.errstate(over="ignore", invalid="ignore"):  # from rejected trial steps
        for row in MENU.values():
            current = _sized(setting, row, models, within)
            if current is not None:
                crosses = _crosses(problem, fits, models, current)
                found.append(Prospect(row, current, setting.series.dt, crosses, 0.0))
    scored = [replace(p, margin=_margin(p, found)) for p in found]
    return tuple(sorted(scored, key=lambda p: -p.margin))


def _margin(prospect: Prospect, among: Sequence[Prospect]) -> float:
    """Return the smaller cross-innovation.

    A law that contains another one explains everything the other one can produce, whatever the
    input; such a pair is ignored unless there is no other.
    """
    hopeful = [
        cross.margin
        for k, cross in enumerate(prospect.crosses)
        if max(p.crosses[k].margin for p in among) >= TELLS
    ]
    return min(hopeful, default=max(cross.margin for cross in prospect.crosses))


# ---- within the limits
def _samples(setting: Setting) -> int:
    dt = setting.series.dt
    return int(np.clip(SAMPLES * dt, SHORTEST, LONGEST) / dt)


def _sized(
    setting: Setting, row: Input, models: Mapping[str, Written], within: Bounds
) -> Floats | None:
    """Return an input at the largest amplitude at which no explanation breaks a limit, if any.

    Returns:
        Current [A], shape (N,).
    """
    floating = not setting.structure.output_fixed
    unit = row.current(_samples(setting), setting.series.dt, floating)
    full = within.current
    if row.stuck:
        full = max(_friction(model) for model in models.values())
    current = unit * min(row.size * full, within.current)
    if not np.any(current):
        return None
    for _ in range(TRIALS):
        if all(_is_within(setting, model, current, within) for model in models.values()):
            return current
        current = BACK_OFF * current
    return None


def _friction(model: Written) -> float:
    """Return the current above which the motor side moves [A]."""
    fields = model.fields
    levels = (
        max(fields[f"c_p_{b}"], fields[f"c_n_{b}"]) + max(fields[f"s_p_{b}"], fields[f"s_n_{b}"])
        for b in "mg"
    )
    return sum(levels) / fields["k_t"] / fields["n"]


def _is_within(setting: Setting, model: Written, current: Floats, within: Bounds) -> bool:
    out = replay(_blank(setting, model, current), model)
    travel = np.abs(out["q_m"] - out["q_m"][0])
    limits = {"dq_m": within.speed, "tau": within.torque}
    small = all(np.abs(out[name]).max() <= limit for name, limit in limits.items() if name in out)
    return bool(small and np.isfinite(travel).all() and travel.max() <= within.travel)


# ---- data simulated with an explanation, and how well another one fits them
def _blank(setting: Setting, model: Written, current: Floats) -> Setting:
    """Return the setting of a planned experiment: its command, with the joint at rest.

    The spring is initially relaxed.
    """
    size, old, fields = len(current), setting.series, model.fields
    columns = {name: np.zeros(size) for name in old.columns}
    columns["i_cmd" if "i_cmd" in old else "i"] = current
    columns["q_m"] += fields["q_0"] + fields["centre_g"] if setting.has_spring else 0.0
    if "tau" in old:
        columns["tau"] += fields["tau_0"]
    valid = {name: np.ones(size, dtype=bool) for name in columns}
    return replace(setting, series=Series(old.dt, columns, valid, old.zero, old.derived))


def pretended(setting: Setting, model: Written, current: Floats) -> Setting:
    """Return the setting of an experiment as it would be recorded if a model were true.

    Args:
        setting: The existing record, whose sensors and sampling the experiment shares.
        model: The model.
        current: The command [A], shape (N,).
    """
    blank = _blank(setting, model, current)
    signals = replay(blank, model)
    rng = np.random.default_rng(0)
    columns = dict(blank.series.columns)
    for name in columns:
        if name in signals:
            columns[name] = signals[name] + setting.std(name) * rng.standard_normal(len(current))
    return replace(setting, series=replace(blank.series, columns=columns, _speeds={}))


def _crosses(
    problem: Problem, fits: Mapping[str, Fit], models: Mapping[str, Written], current: Floats
) -> tuple[Cross, ...]:
    made = {}
    for name, model in models.items():
        there = Problem.of(Stages(pretended(problem.stages.setting, model, current)))
        there.stages.tune(model.fields)
        at = _moved(problem, there, fits[name])
        made[name] = (there, _evaluated(there, fits[name].model, at))
    found = []
    for true, rival in permutations(fits, 2):
        there, own = made[true]
        if _contains(fits[rival].model, fits[true].model):
            # It fits equally well on any input.
            found.append(Cross(true, rival, 0.0, "motor", 1.0))
        else:
            start = Fit(fits[rival].model, _moved(problem, there, fits[rival]), 0.0, {}, {})
            found.append(_cross(true, rival, start, there, own))
    return tuple(found)


def _contains(model: Model, other: Model) -> bool:
    """Return whether a model contains another: it has more effects, or a richer law."""
    more = [e for e in model.effects if e.key not in {o.key for o in other.effects}]
    less = [o for o in other.effects if o.key not in {e.key for e in model.effects}]
    if len(more) == len(less) == 1:
        return less[0].name in SIMPLER.get(more[0].name, ())
    return not less


def _cross(true: str, rival: str, start: Fit, there: Problem, own: Fit) -> Cross:
    """Return how well a rival, fitted from `start`, explains data generated by the truth."""
    other = there.fit(start.model, start.z, MOVES)
    data = sum(
        there.counts[n] / DEFLATION * np.log(max(ms, FLOOR**2) / max(own.mean_square[n], FLOOR**2))
        for n, ms in other.mean_square.items()
    )
    margin = float(data) + max(there.strain(other.z) - there.strain(start.z), 0.0)
    worse = {n: ms / max(own.mean_square[n], 1.0) for n, ms in other.mean_square.items()}
    stage = max(worse, key=lambda n: worse[n])
    return Cross(true, rival, margin, stage, other.mean_square[stage] ** 0.5)


def _evaluated(problem: Problem, model: Model, z: Floats) -> Fit:
    """Return the true model on its own data, refitted if the predictor is too coarse."""
    residuals = problem.residuals(model, z)
    found = Fit(model, z, 0.0, problem.mean_square(residuals), residuals)
    coarse = max(found.mean_square.values()) > LEFT**2
    return problem.fit(model, z, MOVES) if coarse else found


def _moved(old: Problem, new: Problem, fit: Fit) -> Floats:
    """Return a fit's coordinates in the problem of another record, at the same values."""
    shared = Model().fields(old.stages.setting.nominal, old.shared, fit.z)
    first = [n.unknown.coordinate(shared[n.field]) for n in new.shared]
    return np.concatenate([first, fit.z[len(old.shared) :]])
