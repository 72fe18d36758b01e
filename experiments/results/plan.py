"""How large a comparison is, and the trainings that it rests on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from joblib import Parallel, delayed

from cjt_gym.baselines.gains import choose
from cjt_gym.joint import get_structure, joint_names, load_joint_file
from cjt_gym.training.evaluation.conditions import realistic_effects
from cjt_gym.training.learning.config import TrainConfig, load_config
from cjt_gym.training.learning.train import train

Say = Callable[[str], None]
STRUCTURES: Final = ("output_fixed_rigid_gearbox", "rigid_gearbox")
RECIPES: Final = dict(zip(STRUCTURES, ("quiet_residual", "quiet_residual_free"), strict=True))
TRAINED: Final = ("step", "chirp", "multisine", "smooth")
"""Kinds of references that the trainings draw from."""
HELD_OUT: Final = ("reversal", "load_motion")
"""Tasks that no training saw; `quiet_residual` moves the locked output, in other ways."""
TASKS: Final = (*TRAINED, *HELD_OUT)


@dataclass(frozen=True)
class Plan:
    """How large a comparison is.

    Attributes:
        out: Folder for everything; what is there is not done again.
        joint: The joint.
        recipe: Configuration of the training, the same for all structures or one for each.
        seeds: Trainings of each structure.
        steps: Of a training; None for those of the recipe.
        episodes: Of each task.
        jobs: Processes.
        structures: Some of `STRUCTURES`.
    """

    out: Path
    joint: str = "orange_80_6000"
    recipe: str | Mapping[str, str] = field(default_factory=lambda: dict(RECIPES))
    seeds: int = 5
    steps: int | None = None
    episodes: int = 32
    jobs: int = 2
    structures: tuple[str, ...] = STRUCTURES

    def config(self, structure: str) -> TrainConfig:
        """Return the configuration of the trainings of a structure, on the joint of the plan.

        Raises:
            CjtGymError: There is none, or it is not valid.
        """
        name = self.recipe if isinstance(self.recipe, str) else self.recipe[structure]
        config = load_config(name)
        env = {**config.env, "joint": self.joint, "structure": structure}
        return config.with_changes(env=env, total_steps=self.steps)

    def base(self, structure: str) -> str | None:
        """Return the row of `CONTROLLERS` that the policies of a structure add to, None if none."""
        name = self.config(structure).env.get("base_controller")
        return None if name is None else choose(str(name)).controller

    def run(self, structure: str, seed: int) -> Path:
        """Return the folder of a training."""
        return self.out / "runs" / f"{structure}_{seed}"

    def runs(self, structure: str) -> list[str]:
        """Return the folders of the trainings of a structure."""
        return [str(self.run(structure, seed)) for seed in range(self.seeds)]

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data, without its folder."""
        return {name: value for name, value in asdict(self).items() if name != "out"}


def train_all(plan: Plan, say: Say) -> None:
    """Train every seed of every structure.

    Raises:
        CjtGymError: The recipe, the joint or a run cannot be used.
    """
    work = Parallel(n_jobs=plan.jobs, return_as="generator_unordered")
    for name in work(
        delayed(_train)(plan, structure, seed)
        for structure in plan.structures
        for seed in range(plan.seeds)
    ):
        say(f"trained {name}")


def _train(plan: Plan, structure: str, seed: int) -> str:
    config = plan.config(structure).with_changes(seed=1000 * seed)
    return train(config, plan.run(structure, seed), quiet=True).path.name


def other_joints(joint: str, structure: str) -> list[str]:
    """Return the joints that ship and have the same effects as a joint, without itself.

    Args:
        joint: Name of a joint, or path of its file.
        structure: Structure for which they must have the parameters.
    """
    mine, kept = load_joint_file(joint), []
    needed = get_structure(structure).needed_parameters
    for name in joint_names():
        other = load_joint_file(name)
        same = name != joint and other.hash_hex() != mine.hash_hex()
        if same and all(key in other.parameters for key in needed):
            kept += [name] if set(realistic_effects(name)) == set(realistic_effects(joint)) else []
    return kept
