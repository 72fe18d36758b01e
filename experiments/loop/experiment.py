"""The experiment: train, try, diagnose, train on, try again."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed

from cjt_gym.blind.case import Log
from cjt_gym.disk import write_text
from cjt_gym.envs.core import Episodes
from cjt_gym.errors import CjtGymError, ConfigurationError
from cjt_gym.gap import diagnose
from cjt_gym.joint import JointFile, load_joint_file, to_toml
from cjt_gym.records import Record, default_units
from cjt_gym.signals import Signal
from cjt_gym.training.benchmark.code_hash import COUNTED, code_hash
from cjt_gym.training.evaluation.conditions import (
    EVALUATION_SEEDS,
    TASKS,
    task_reference,
    zero_reference,
)
from cjt_gym.training.evaluation.metrics import noise_amplification, nrmse
from cjt_gym.training.evaluation.rollout import Agent, ControllerAgent, Traces
from cjt_gym.training.learning.config import TrainConfig, environment_arguments, load_config
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.train import train
from experiments.loop.drive import drive
from experiments.loop.joints import HiddenJoint, as_sensed, hidden_joints
from experiments.loop.wide import wide_randomization, with_room

Say = Callable[[str], None]
AMPLITUDE_SHARE: Final = 0.2
"""Amplitude of the references over the peak torque of the motor [-]."""
BASE: Final = "pd_feedforward"
"""The base of the policies, which is also run alone."""
RECIPE: Final = "loop"
"""Configuration of all trainings."""
ARMS: Final = ("controller", "nominal", "wide", "identified", "true")
"""What is run on every joint."""
EPISODES: Final = 2
"""Of a second each, for every task."""
RATE: Final = {"start": 3e-4, "end": 1e-5}
"""Learning rate of a training that continues another one: it begins low."""
MADE_BY: Final = "made_by.json"
"""File that says what the results of a folder come from."""
PARTS: Final = (*COUNTED, "blind", "gap")
"""Parts of the package that they come from."""


@dataclass(frozen=True)
class Plan:
    """How large the experiment is.

    Attributes:
        out: Folder for everything.
        groups: Datasheets.
        per_group: Joints of each.
        steps: Of the training on a datasheet.
        more: Of the trainings that go on from there, on the datasheet or on a single joint; that of
            the wide arm has as many as both.
        seed: Of joints and trainings.
        jobs: Processes.
    """

    out: Path
    groups: int = 4
    per_group: int = 5
    steps: int = 400_000
    more: int = 100_000
    seed: int = 1
    jobs: int = 2


@dataclass(frozen=True)
class Outcome:
    """What came of one joint.

    Attributes:
        joint: Its name.
        structure: Its structure.
        hidden: What it hides.
        found: What the diagnosis named.
        verdict: Of the diagnosis; the reason where it could not be made.
        amplitude: Of the references [N m].
        tasks: By arm and task, error of the true torque over the reference, both root mean squares
            [-].
        noise: By arm, amplification of the torque sensor's noise [-].
    """

    joint: str
    structure: str
    hidden: tuple[str, ...]
    found: tuple[str, ...]
    verdict: str
    amplitude: float
    tasks: dict[str, dict[str, float]]
    noise: dict[str, float]

    def error(self, arm: str) -> float:
        """Return the error of an arm, the geometric mean over the tasks [-].

        A task that asks for more than the motor can give, where all fail, does not hide the others.
        """
        return float(np.exp(np.mean(np.log(list(self.tasks[arm].values())))))

    @property
    def gap(self) -> float:
        """Error of the policy of the nominal joint over that of the true one, less one."""
        return self.error("nominal") / self.error("true") - 1.0

    def recovered(self, arm: str) -> float:
        """Return the share of the gap that an arm takes away."""
        nominal = self.error("nominal")
        return (nominal - self.error(arm)) / (nominal - self.error("true"))


def run_experiment(plan: Plan, say: Say = lambda text: None) -> list[Outcome]:
    """Do what is not done yet, and return what came of every joint.

    Args:
        plan: How large.
        say: Told what has been done.

    Raises:
        ConfigurationError: The folder holds what other settings or other code gave.
    """
    _claim(plan)
    joints = hidden_joints(plan.groups, plan.per_group, plan.seed)
    firsts = [next(j for j in joints if j.group == g) for g in range(plan.groups)]
    say(f"{len(joints)} joints with {plan.groups} datasheets")
    work = Parallel(n_jobs=plan.jobs, return_as="generator_unordered")
    arms = ("nominal", "wide")
    for name in work(delayed(_teach)(plan, joint, arm) for joint in firsts for arm in arms):
        say(f"trained {name}")
    found = []
    in_turn = sorted(joints, key=lambda joint: joint.name[-1])  # of each datasheet one, and so on
    for outcome in work(delayed(_try)(plan, joint) for joint in in_turn):
        errors = ", ".join(f"{arm} {outcome.error(arm):.3g}" for arm in ARMS)
        hidden, named = (", ".join(n) or "nothing" for n in (outcome.hidden, outcome.found))
        say(f"{outcome.joint} hides {hidden}, found {named}; error: {errors}")
        found.append(outcome)
    return sorted(found, key=lambda outcome: outcome.joint)


def _claim(plan: Plan) -> None:
    """Note the settings in the folder; reject one with results of other settings."""
    here = {
        "steps": plan.steps,
        "more": plan.more,
        "seed": plan.seed,
        "recipe": json.loads(json.dumps(load_config(RECIPE).to_dict())),
        "code": code_hash(PARTS),
    }
    path = plan.out / MADE_BY
    there = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
    if there is None and not any(plan.out.glob("joint_*")):
        plan.out.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(here, indent=1) + "\n")
    elif there != here:
        different = [name for name in here if here[name] != (there or {}).get(name)]
        raise ConfigurationError(
            f"{plan.out} holds an experiment that differs in {', '.join(different)}. Choose "
            "another folder with --out, or delete this one."
        )


def _teach(plan: Plan, joint: HiddenJoint, arm: str) -> str:
    """Train a policy of a datasheet, for as many steps as one of a joint gets in all."""
    file, folder = as_sensed(joint.stated(plan.out)), _folder(plan, joint, arm)
    if arm == "wide":
        drawn = wide_randomization(file, joint.structure)
        _train(plan, joint, with_room(file), folder, plan.steps + plan.more, drawn)
    else:
        first = _folder(plan, joint, "first")
        _train(plan, joint, file, first, plan.steps)
        _train(plan, joint, file, folder, plan.more, before=first)
    return folder.name


def _folder(plan: Plan, joint: HiddenJoint, arm: str) -> Path:
    """Return the run of an arm, or "first", from which all but wide go on.

    The controller has the observation and scales of nominal.
    """
    if arm in ("identified", "true"):
        return plan.out / f"{joint.name}_{arm}"
    return plan.out / f"policy_{joint.group}_{'nominal' if arm == 'controller' else arm}"


def _try(plan: Plan, joint: HiddenJoint) -> Outcome:
    """Diagnose a joint, continue training for it, and evaluate every arm on it."""
    place = plan.out / f"{joint.name}.json"
    if place.is_file():
        return Outcome(**json.loads(place.read_text(encoding="utf-8")))
    stated = joint.stated(plan.out)
    file, found, verdict = _diagnosed(joint, stated)
    for arm, known, drawn in (
        ("identified", file, "identified" if found else None),
        ("true", joint.true(stated), None),
    ):
        before = _folder(plan, joint, "first")
        _train(plan, joint, as_sensed(known), _folder(plan, joint, arm), plan.more, drawn, before)
    tasks, noise = {}, {}
    for arm in ARMS:
        folder = _folder(plan, joint, arm)
        agent = ControllerAgent(BASE) if arm == "controller" else load_policy(folder)
        config = load_config(folder / "config.toml")
        tasks[arm], noise[arm] = _tried(agent, config, joint)
    amplitude = config.env["torque_amplitude"]
    outcome = Outcome(
        joint.name, joint.structure, joint.hidden, found, verdict, amplitude, tasks, noise
    )
    write_text(place, json.dumps(asdict(outcome), indent=1) + "\n")
    return outcome


def _diagnosed(joint: HiddenJoint, stated: JointFile) -> tuple[JointFile, tuple[str, ...], str]:
    """Return the joint that the diagnosis of its records gives, what it names, and its verdict."""
    records = [_record(joint, log) for log in (joint.case.diagnose, joint.case.validate)]
    try:
        result = diagnose(records[0], stated, joint.structure, validate=records[1])
    except CjtGymError as error:
        return stated, (), str(error)
    return result.joint, tuple(effect.name for effect in result.effects), result.verdict


def _record(joint: HiddenJoint, log: Log) -> Record:
    units = default_units(tuple(log.columns))
    return Record(log.columns, units, dt=joint.case.sheet.dt, structure=joint.structure)


def _train(
    plan: Plan,
    joint: HiddenJoint,
    file: JointFile,
    folder: Path,
    steps: int,
    randomization: Any = None,
    before: Path | None = None,
) -> None:
    """Train on a joint; amplitude and scales are those of the datasheet for everyone."""
    path = folder.with_suffix(".toml")
    write_text(path, to_toml(file))
    base = load_config(RECIPE)
    sheet = str(plan.out / f"sheet_{joint.group}.toml")
    p = load_joint_file(sheet).parameters
    env = dict(base.env) | {"joint": sheet, "structure": joint.structure}
    env["torque_amplitude"] = env["action_scale"] = AMPLITUDE_SHARE * p.k_t * p.n * p.i_p
    layout = Episodes(1, **environment_arguments(env)).settings.layout
    env |= {"velocity_scale": layout.velocity, "joint": str(path)}
    if randomization is not None:
        env["randomization"] = randomization
    changes: dict[str, Any] = {"env": env, "total_steps": steps, "seed": plan.seed}
    if before is not None:
        options = {**base.algorithm_options, "learning_rate": RATE}
        changes |= {"start_from": str(before.resolve()), "algorithm_options": options}
    train(base.with_changes(**changes), folder, quiet=True)


def _tried(agent: Agent, config: TrainConfig, joint: HiddenJoint) -> tuple[dict[str, float], float]:
    """Return the errors of an agent on a joint by task, and its noise amplification [-]."""
    amplitude = config.env["torque_amplitude"]
    arguments = environment_arguments(config.env) | {"randomization": None, "episode_steps": 1000}

    def runs(reference: Signal, episodes: int) -> Traces:
        given = arguments | {"reference": reference}
        return drive(agent, given, joint.case.world, episodes, EVALUATION_SEEDS)

    errors = {task: nrmse(runs(task_reference(task, amplitude), EPISODES)) for task in TASKS}
    return errors, noise_amplification(runs(zero_reference(), 1))
