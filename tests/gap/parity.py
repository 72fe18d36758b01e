"""What the predictors of a diagnosis make of a joint that was written and simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.diagnosis import NamedEffect
from cjt_gym.gap.identified import identified_joint
from cjt_gym.gap.judged.replay import Written, exactly
from cjt_gym.gap.next_record.design import pretended
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting, make_setting
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.joint import Joint, JointFile, get_structure, load_joint, to_toml
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record

VALUES = {
    "I_m": 0.2,
    "I_g": 0.08,
    "I_l": 0.4,
    "k_g": 16000.0,
    "k_b": 6000.0,
    "n": 80.0,
    "k_t": 0.08,
    "d_m": 1.0,
    "d_g": 2.0,
    "d_l": 0.5,
    "d_mg": 100.0,
    "d_gl": 0.5,
    "i_p": 30.0,
}
ZERO_M, ZERO_L = 0.35, -0.2
"""Angles at which the encoders of the recorded joint begin [rad]."""


def datasheet() -> JointFile:
    sensors = {
        "q_m": {"resolution": Quantity(5e-6, "rad")},
        "q_l": {"resolution": Quantity(5e-6, "rad")},
        "tau": {"noise": Quantity(0.04, "N m")},
        "i": {"noise": Quantity(0.015, "A")},
    }
    return JointFile(JointParameters.from_values("stated", VALUES), sensors=sensors)


def command(seconds: float, seed: int = 3) -> Floats:
    """Return smooth noise with rests, about 2 A, shape (N,)."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / 1e-3)) * 1e-3
    tones = rng.uniform(0.5, 12.0, 9)
    waves = np.sin(2.0 * np.pi * np.outer(t, tones) + rng.uniform(0, 6.28, 9)).sum(axis=1)
    return np.asarray(np.where(t < 0.1, 0.0, 1.2 * waves))


def setting_of(structure: str, seconds: float = 2.0, file: JointFile | None = None) -> Setting:
    """Return a setting whose record is the nominal joint's own motion, encoders off zero."""
    current = command(seconds)
    joint = load(datasheet(), structure, Path("unused.toml"), write=False)
    run = joint.simulate(current * VALUES["k_t"] * VALUES["n"], dt=1e-3, dt_physics=1e-4)
    rng = np.random.default_rng(0)
    columns = {
        "i_cmd": current,
        "i": current + 0.015 * rng.standard_normal(len(current)),
        "q_m": run["true_q_m"] + ZERO_M,
        "q_l": run["true_q_l"] + ZERO_L,
        "tau": run["true_tau"] + 0.04 * rng.standard_normal(len(current)),
    }
    units = {"i_cmd": "A", "i": "A", "q_m": "rad", "q_l": "rad", "tau": "N m"}
    record = Record(columns, units, dt=1e-3, structure=structure)
    return make_setting(record, file or datasheet(), get_structure(structure))


def load(file: JointFile, structure: str, path: Path, *, write: bool = True) -> Joint:
    if not write:
        return Joint(file, structure, "current", {})
    path.write_text(to_toml(file), encoding="utf-8")
    return load_joint(path, structure)


def named(candidate: Candidate, values: Mapping[str, float]) -> NamedEffect:
    """Return the effect as a diagnosis would name it, every number known to ten per cent."""
    found = exactly(candidate, values)
    spans = {
        s: replace(x, low=x.value - _tenth(x.value), high=x.value + _tenth(x.value))
        for s, x in found.parameters.items()
    }
    return replace(found, parameters=spans, status="confirmed", confidence=1.0)


def _tenth(x: float) -> float:
    return 0.1 * abs(x) + 1e-9


def residuals(
    setting: Setting, candidate: Candidate, values: Mapping[str, float]
) -> tuple[float, float]:
    """Return what the predictors leave of the joint that is written for an effect, in noise.

    It is the largest residual of the stages that the effect touches, with the effect and without.
    """
    nominal: Fields = {**setting.nominal, "w_i": 1.0}  # the command is held over its sample
    fields = dict(nominal)
    candidate.apply(fields, values)
    file = identified_joint(setting, fields, [named(candidate, values)], {}, "a record")
    stages = Stages(pretended(setting, Written(fields, file), setting.series["i_cmd"]))
    stages.tune(fields)
    touched = [name for name in candidate.touches if name in stages.names]

    def left(model: Fields) -> float:
        return max(float(np.std(stages.residual(name, model))) for name in touched)

    return left(fields), left(nominal)


def held_out(file: JointFile, record: Record, path: Path) -> float:
    """Return the relative error of the joint torque, the kernel driven by the recorded command.

    A constant part is left out: the usual offset of a torque sensor belongs to no joint.
    """
    joint = load(file, str(record.structure), path)
    p = joint.parameters
    bias = joint.effects.get("torque_bias", {"bias": 0.0})["bias"]
    tau = float(np.mean(record["tau"][:5])) - bias
    q_g = record["q_m"][0] - (tau / p.k_g if joint.structure_row.groups[1] else 0.0)
    start = np.array([record["q_m"][0], q_g, q_g - tau / p.k_b, 0.0, 0.0, 0.0])
    command = record["i_cmd"] * p.k_t * p.n
    run = joint.simulate(command, dt=record.dt, x0=start, dt_physics=1e-4)
    apart = run["tau"] - record["tau"]
    return float(np.std(apart) / np.sqrt(np.mean(record["tau"] ** 2)))
