"""Open-loop replay: the joint that a model stands for, driven by the recorded command alone.

The predictors of the stages use measurements at every sample; a replay does not, so it shows how
far simulation and record diverge, but is not used to find the cause. Anybody can repeat this
simulation with the written joint: beyond the joint it uses only the zeros and offsets of the
record's sensors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import savgol_filter

from cjt_gym.errors import SimulationError
from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.candidates.nuisances import FRICTION, WEIGHT
from cjt_gym.gap.diagnosis import Interval, NamedEffect
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.gap.identified import Refined, identified_joint
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.series import Series, slope
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.recorded.signals import interval_mean
from cjt_gym.gap.stages.fit import Fit, Model, Problem
from cjt_gym.joint import Joint, JointFile
from cjt_gym.joint.batch import longest_substep
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.kernel.arrays import Floats

Run = Callable[[Floats, int], dict[str, Floats]]
SUBSTEP, COARSEST = 1e-4, 2.5e-4
"""Substep, to which delays are rounded, and that of long records [s]."""
MANY = 200_000
"""Number of substeps above which a record is long."""
BEGIN = 0.05
"""Time over which the state at the beginning is found [s]."""
NUDGE = 1e-2
"""Step of the derivatives by that state, in units of noise and of the usual speed."""
TINY = 1e-12
SMOOTH = 11
"""Samples over which a prescribed angle of the load is smoothed."""


@dataclass(frozen=True, eq=False)
class Written:
    """A model and the joint that it stands for.

    Attributes:
        fields: The model, of which a replay takes the zeros and offsets of sensors.
        file: The joint.
    """

    fields: Fields
    file: JointFile

    def joint(self, setting: Setting) -> Joint:
        """Return the joint without noise, with a drive where the record has its command."""
        effects = resolve_effects(None, self.file, setting.structure, "current")
        if "thermal_derating" in effects:
            given = effects["thermal_derating"].items()
            heat = {symbol: x for symbol, x in given if not isinstance(x, tuple)}
            rise = heat["rise"] + _warmth(heat, setting.series)
            effects["thermal_derating"] = {**heat, "rise": rise}
        file = replace(self.file, found={})
        joint = Joint(file, setting.structure.name, "current", effects)
        return quiet(joint, driven="i_cmd" in setting.series)


def _warmth(heat: Mapping[str, float], series: Series) -> float:
    """Return by how much the current before the first sample has warmed the winding [K]."""
    ages = series.dt * np.arange(len(series.past), 0, -1)
    share = -np.expm1(-series.dt / heat["T_thw"]) * np.exp(-ages / heat["T_thw"])
    return heat["r"] * heat["r_th1"] * float(share @ series.past**2)


def written(problem: Problem, model: Model, z: Floats) -> Written:
    """Return a model at coordinates with the joint that it stands for."""
    setting, fields = problem.stages.setting, problem.fields(model, z)
    known = {*setting.joint.parameters.quantities, *FRICTION, *WEIGHT, "lag"}
    known -= {effect.releases for effect in model.effects}
    values = {n.field: (fields[n.field], 0.0) for n in problem.shared if n.field in known}
    named = [
        exactly(effect, problem.values(model, z, index))
        for index, effect in enumerate(model.effects)
        if not effect.outside
    ]
    return Written(fields, identified_joint(setting, fields, named, values, ""))


def steps(
    problem: Problem,
    fit: Fit,
    nominal: Written,
    named: Sequence[NamedEffect],
    refined: Refined,
    record: str,
) -> list[Written]:
    """Return the nominal joint, the one within its tolerances, and with one effect more each.

    Args:
        problem: The record.
        fit: The explanation.
        nominal: The nominal joint.
        named: What is named, in the order in which it is added.
        refined: Datasheet values that the record tells; see `identified_joint`.
        record: Name of the record.
    """
    shared, setting = len(problem.shared), problem.stages.setting
    at = {(e.name, e.body, e.channel): k for k, e in enumerate(fit.model.effects)}
    keys = [(e.name, e.body, e.channel) for e in named]
    found = [nominal]
    for count in range(len(named) + 1):
        some = sorted(at[key] for key in keys[:count])
        z = np.concatenate([fit.z[:shared], *(fit.z[problem.span(fit.model, k)] for k in some)])
        fields = problem.fields(Model(tuple(fit.model.effects[k] for k in some)), z)
        file = identified_joint(setting, fields, named[:count], refined, record)
        found.append(Written(fields, file))
    return found


def exactly(effect: Candidate, values: Mapping[str, float]) -> NamedEffect:
    """Return an effect as if it were named, with exactly known numbers."""
    spans = {symbol: Interval(x, x, x, "") for symbol, x in values.items()}
    row = (effect.name, effect.stage, effect.body, effect.channel)
    return NamedEffect(*row, spans, "tentative", 0.0, 0.0)


def replay(setting: Setting, model: Written) -> dict[str, Floats]:
    """Return the channels that a model gives for the recorded command, each of shape (N,).

    Channels are q_m, q_l, dq_m and i, and where there is a spring, tau; NaN where it diverges.
    """
    series, fields = setting.series, model.fields
    joint, driven = model.joint(setting), "i_cmd" in series
    if driven:
        current = series["i_cmd"]
    else:
        current = interval_mean(series["i"] - fields["i_0"], fields["w_i"])
    zero = series.zero.get("q_m", 0.0)
    start, load = _start_and_load(setting, fields, zero)
    longest = min(max(series.dt * len(series) / MANY, SUBSTEP), COARSEST)
    longest = min(longest, 0.5 * longest_substep(joint))
    count = max(math.ceil(series.dt / longest - 1e-9), 1)
    p, h = joint.parameters, series.dt / count

    def run(start: Floats, samples: int) -> dict[str, Floats]:
        torque = current[:samples] * p.k_t * p.n
        got = joint.simulate(torque, load[:samples], series.dt, start, dt_physics=h)
        found = {"q_m": got["true_q_m"] - zero, "q_l": got["true_q_l"] - zero - fields["q_0"]}
        found["dq_m"] = slope(found["q_m"], series.dt)  # as of the measured angle
        if driven and "i" in got:
            found["i"] = got["i"] + fields["i_0"]
        if setting.has_spring:
            bias = joint.effects.get("torque_bias", {}).get("bias", 0.0)
            found["tau"] = got["tau"] + fields["tau_0"] - bias
        return found

    try:
        return run(_in_motion(setting, start, run), len(series))
    except SimulationError:
        names = ("q_m", "q_l", "dq_m", "i", *(("tau",) if setting.has_spring else ()))
        return {name: np.full(len(series), np.nan) for name in names}


def _in_motion(setting: Setting, start: Floats, run: Run) -> Floats:
    """Return the start from which the first samples of a record are followed best.

    A record that was cut begins in motion, with speeds and deflections that its first few samples
    show badly; over `BEGIN` the joint's own motion shows them better.

    Args:
        setting: The record.
        start: State at the first sample as these samples show it, shape (6,).
        run: Replay from a state over a number of samples.
    """
    series, chain = setting.series, setting.structure.selection
    samples = min(max(round(BEGIN / series.dt), 8), len(series))
    shown = ["q_m"]
    if setting.has_spring:
        shown += ["tau"] if setting.structure.output_fixed else ["q_l", "tau"]
    seen = {name: max(setting.std(name), TINY) for name in shown if name in series}

    def missed(state: Floats) -> Floats:
        got = run(state, samples)
        return np.concatenate([(got[n] - series[n][:samples]) / std for n, std in seen.items()])

    sizes = np.repeat([setting.std("q_m"), float(np.std(series.speed("q_m")))], chain.shape[1])
    moves = np.kron(np.eye(2), chain) * np.maximum(sizes, TINY)
    error = missed(start)
    slopes = np.stack([missed(start + NUDGE * move) - error for move in moves.T], axis=1) / NUDGE
    if not np.isfinite(slopes).all():
        return start
    wanted = np.linalg.lstsq(np.vstack([slopes, np.eye(len(sizes))]), np.append(-error, 0 * sizes))
    better = start + moves @ wanted[0]
    return better if np.sum(missed(better) ** 2) < np.sum(error**2) else start


def _start_and_load(setting: Setting, fields: Fields, zero: float) -> tuple[Floats, Floats]:
    """Return the state at the first sample, shape (6,), and what acts on the load, shape (N,).

    The load's angle equals the motor's when the spring is relaxed.
    """
    series = setting.series
    tau = float(np.mean(series["tau"][:5])) - fields["tau_0"] if "tau" in series else 0.0
    q = series["q_m"][0] + zero
    start = np.full(6, series.first_speed("q_m"))
    start[:3] = q
    if setting.has_gear:
        start[1:3] = q = q - tau / fields["k_g"] - fields["centre_g"]
    if setting.cut is Cut.BY_ANGLES:
        start[2] = float(np.mean(series["q_l"][:5])) + zero + fields["q_0"]
    elif setting.has_spring:
        start[2] = q - tau / fields["k_b"]
    load = series["tau_l"] if "tau_l" in series else np.zeros(len(series))
    if setting.structure.output_fixed:
        q_l = series["q_l"] if "q_l" in series else np.zeros(len(series))
        if len(q_l) > SMOOTH and np.ptp(q_l) > 0.0:
            q_l = savgol_filter(q_l, SMOOTH, 3)  # a stiff spring would turn its noise into torque
        load = np.append(np.diff(q_l), 0.0) / series.dt
        start[2], start[5] = q_l[0] + zero + fields["q_0"], load[0]
    return start, load
