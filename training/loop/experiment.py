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
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.torque_tracking import complete
from cjt_gym.errors import CjtGymError
from cjt_gym.gap import diagnose
from cjt_gym.joint import JointFile, load_joint_file, to_toml
from cjt_gym.records import Record, default_units
from cjt_gym.training.conditions import EVALUATION_SEEDS, TASKS, task_reference, zero_reference
from cjt_gym.training.config import TrainConfig, environment_arguments, load_config
from cjt_gym.training.loop.drive import drive
from cjt_gym.training.loop.joints import HiddenJoint, as_sensed, hidden_joints
from cjt_gym.training.loop.wide import wide_randomization, with_room
from cjt_gym.training.metrics import noise_amplification, rms
from cjt_gym.training.policy import load_policy
from cjt_gym.training.rollout import Agent, ControllerAgent
from cjt_gym.training.train import train

Say = Callable[[str], None]
AMPLITUDE_SHARE: Final = 0.2
"""Amplitude of the references over the peak torque of the motor [-]."""
ARMS: Final = ("controller", "nominal", "wide", "identified", "true")
"""Who is tried on every joint."""
EPISODES: Final = 3
"""Of a second each, for every task."""
RATE: Final = {"start": 5e-4, "end": 5e-5}
"""Learning rate of a training that goes on from another."""


@dataclass(frozen=True)
class Plan:
    """How large the experiment is.

    Attributes:
        out: Folder for everything.
        groups: Datasheets.
        per_group: Joints of each.
        steps: Of the training on a datasheet.
        more: Of the training that goes on from there on a single joint.
        seed: Of joints and trainings.
        jobs: Processes.
    """

    out: Path
    groups: int = 4
    per_group: int = 5
    steps: int = 500_000
    more: int = 200_000
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
        tasks: By arm and task, root mean square error of the true torque [N m].
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

    def rmse(self, arm: str) -> float:
        """Return the root mean square error of an arm over all tasks [N m]."""
        return rms(np.array(list(self.tasks[arm].values())))

    @property
    def gap(self) -> float:
        """Error of the policy of the nominal joint over that of the true one, less one."""
        return self.rmse("nominal") / self.rmse("true") - 1.0

    def recovered(self, arm: str) -> float:
        """Return the share of the gap that an arm takes away."""
        nominal = self.rmse("nominal")
        return (nominal - self.rmse(arm)) / (nominal - self.rmse("true"))


def run_experiment(plan: Plan, say: Say = lambda text: None) -> list[Outcome]:
    """Do what is not done yet, and return what came of every joint.

    Args:
        plan: How large.
        say: Told what has been done.
    """
    plan.out.mkdir(parents=True, exist_ok=True)
    joints = hidden_joints(plan.groups, plan.per_group, plan.seed)
    firsts = [next(j for j in joints if j.group == g) for g in range(plan.groups)]
    say(f"{len(joints)} joints with {plan.groups} datasheets")
    work = Parallel(n_jobs=plan.jobs, return_as="generator_unordered")
    arms = ("nominal", "wide")
    for name in work(delayed(_teach)(plan, joint, arm) for joint in firsts for arm in arms):
        say(f"trained {name}")
    found = []
    for outcome in work(delayed(_try)(plan, joint) for joint in joints):
        errors = ", ".join(f"{arm} {outcome.rmse(arm):.3g}" for arm in ARMS)
        hidden, named = (", ".join(n) or "nothing" for n in (outcome.hidden, outcome.found))
        say(f"{outcome.joint} hides {hidden}, found {named}; error [N m]: {errors}")
        found.append(outcome)
    return sorted(found, key=lambda outcome: outcome.joint)


def _teach(plan: Plan, joint: HiddenJoint, arm: str) -> str:
    """Train a policy of a datasheet."""
    file = as_sensed(joint.stated(plan.out))
    name, drawn = f"policy_{joint.group}_{arm}", None
    if arm == "wide":
        file, drawn = with_room(file), wide_randomization(file, joint.structure)
    _train(plan, joint, file, name, plan.steps, drawn, None)
    return name


def _try(plan: Plan, joint: HiddenJoint) -> Outcome:
    """Diagnose a joint, go on training for it, and try everybody on it."""
    place = plan.out / f"{joint.name}.json"
    if place.is_file():
        return Outcome(**json.loads(place.read_text(encoding="utf-8")))
    stated = joint.stated(plan.out)
    file, found, verdict = _diagnosed(joint, stated)
    before = plan.out / f"policy_{joint.group}_nominal"
    drawn = "identified" if found else None
    _train(plan, joint, as_sensed(file), f"{joint.name}_identified", plan.more, drawn, before)
    true = as_sensed(joint.true(stated))
    _train(plan, joint, true, f"{joint.name}_true", plan.more, None, before)
    agents: dict[str, Agent] = {
        "controller": ControllerAgent("pd_feedforward"),
        "nominal": load_policy(before),
        "wide": load_policy(plan.out / f"policy_{joint.group}_wide"),
        "identified": load_policy(plan.out / f"{joint.name}_identified"),
        "true": load_policy(plan.out / f"{joint.name}_true"),
    }
    tasks, noise = {}, {}
    for arm, agent in agents.items():
        home = "nominal" if arm == "controller" else arm
        own = (
            f"policy_{joint.group}_{home}"
            if home in ("nominal", "wide")
            else f"{joint.name}_{home}"
        )
        config = load_config(plan.out / own / "config.toml")
        tasks[arm], noise[arm] = _tried(agent, config, joint)
    amplitude = config.env["torque_amplitude"]
    outcome = Outcome(
        joint.name, joint.structure, joint.hidden, found, verdict, amplitude, tasks, noise
    )
    place.write_text(json.dumps(asdict(outcome), indent=1) + "\n", encoding="utf-8")
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
    name: str,
    steps: int,
    randomization: Any,
    before: Path | None,
) -> None:
    """Train on a joint; amplitude and scales are those of the datasheet for everyone."""
    path = plan.out / f"{name}.toml"
    path.write_text(to_toml(file), encoding="utf-8")
    base = load_config("loop")
    sheet = str(plan.out / f"sheet_{joint.group}.toml")
    p = load_joint_file(sheet).parameters
    env = dict(base.env) | {"joint": sheet, "structure": joint.structure}
    env["torque_amplitude"] = env["action_scale"] = AMPLITUDE_SHARE * p.k_t * p.n * p.i_p
    scales = Episodes(1, **complete(environment_arguments(env))).settings
    env |= {"velocity_scale": scales.velocity_scale, "joint": str(path)}
    if randomization is not None:
        env["randomization"] = randomization
    changes: dict[str, Any] = {"env": env, "total_steps": steps, "seed": plan.seed}
    if before is not None:
        options = {**base.algorithm_options, "learning_rate": RATE}
        changes |= {"start_from": str(before.resolve()), "algorithm_options": options}
    train(base.with_changes(**changes), plan.out / name, quiet=True)


def _tried(agent: Agent, config: TrainConfig, joint: HiddenJoint) -> tuple[dict[str, float], float]:
    """Return the errors of an agent on a joint by task [N m], and its noise amplification [-]."""
    arguments = environment_arguments(config.env)
    amplitude = config.env["torque_amplitude"]
    references = {task: task_reference(task, amplitude) for task in TASKS}
    references["rest"] = zero_reference()
    errors: dict[str, float] = {}
    for task, reference in references.items():
        given = arguments | {"reference": reference, "randomization": None, "episode_steps": 1000}
        runs = drive(agent, given, joint.case.world, EPISODES, EVALUATION_SEEDS)
        if task == "rest":
            return errors, noise_amplification(runs)
        errors[task] = rms(runs.error)
    raise AssertionError
