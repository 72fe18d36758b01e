"""Train a policy: begin a run, or resume one."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from stable_baselines3.common.vec_env import VecEnv

from cjt_gym.envs.core import Episodes
from cjt_gym.errors import CjtGymError, ConfigurationError
from cjt_gym.training.learning.algorithms import (
    load_normalization,
    load_weights,
    make_environment,
    make_model,
    steps_of,
)
from cjt_gym.training.learning.callbacks import Companion, restore
from cjt_gym.training.learning.config import TrainConfig, environment_arguments
from cjt_gym.training.learning.run_folder import RunFolder, TrainingError, begin_run, open_run


def train(config: TrainConfig, out: str | Path, quiet: bool = False) -> RunFolder:
    """Train as a configuration says, or resume an interrupted run from its last checkpoint.

    Args:
        config: What to train.
        out: The run folder; see `RunFolder` for what it will hold.
        quiet: Whether to leave out the progress bar and messages on standard error.

    Returns:
        The run folder. A run that was finished before is left as it is.

    Raises:
        ConfigurationError: The configuration is not valid, the folder holds something else, or
            another process is training in it.
        TrainingError: The training diverged; `run.json` has the reason.
    """
    joint = Episodes(1, **environment_arguments(config.env)).settings.joint
    env = make_environment(config)
    model = make_model(config, env)
    if config.start_from is not None:
        start_from(config.start_from, config, model, env)
    run = begin_run(out, config, joint)
    with run.held():
        return _trained(run, model, env, config, quiet)


def _trained(
    run: RunFolder, model: BaseAlgorithm, env: VecEnv, config: TrainConfig, quiet: bool
) -> RunFolder:
    """Train in a run folder that no other process uses."""
    if run.facts["status"] == "finished":
        _say(f"{run.path} is finished ({run.facts['steps']} steps). Nothing to do.", quiet)
        return run
    _continue(run, model, env, config, quiet)
    model.set_logger(Logger(None, [TensorBoardOutputFormat(str(run.path / "tensorboard"))]))
    steps = steps_of(model, config.total_steps)
    if steps > config.total_steps:
        text = f"{steps} steps instead of {config.total_steps}: all environments take whole "
        _say(text + f"rollouts of {config.algorithm} together", quiet)
    companion = Companion(run, config, steps, quiet)
    try:
        _learn(model, config, companion)
    except KeyboardInterrupt:
        companion.checkpoint()
        run.note(status="stopped", reason="interrupted")
        raise
    except (TrainingError, CjtGymError) as error:
        run.note(status="failed", reason=str(error))
        raise
    finally:
        companion.close()
        model.logger.close()
    run.note(status="finished", reason=companion.reason, seconds=companion.seconds)
    return run


def start_from(run: str, config: TrainConfig, model: BaseAlgorithm, env: VecEnv) -> None:
    """Give a model the weights, the optimiser and the statistics of the best one of another run."""
    before = open_run(run)
    if not (before.path / "model.zip").is_file():
        raise ConfigurationError(f"start_from: {run} has no model yet. Train it first.")
    there = before.config
    fits = [
        ("algorithm", there.algorithm, config.algorithm),
        ("policy", there.policy, config.policy),
    ]
    fits += [
        ("normalize_observations", there.normalize_observations, config.normalize_observations),
        ("size of the observation", _size(there), env.observation_space.shape),
    ]
    for what, one, other in fits:
        if one != other:
            raise ConfigurationError(
                f"start_from: {what} of {run} must be that of this training, {other}, got {one}. "
                "Change one of them; history and preview of [env] make the observation."
            )
    load_weights(model, before.path / "model.zip")
    if (before.path / "normalization.npz").is_file():
        load_normalization(env, before.path / "normalization.npz")


def _size(config: TrainConfig) -> tuple[int, ...]:
    space = Episodes(1, **environment_arguments(config.env)).observation_space
    return tuple(space.shape or ())


def _continue(
    run: RunFolder, model: BaseAlgorithm, env: VecEnv, config: TrainConfig, quiet: bool
) -> None:
    """Restore the last checkpoint, if there is one, and seed the environments."""
    done = 0
    if run.checkpoints():
        done = _restored(run, model, env, quiet)
        run.forget_progress_after(done)
        _say(f"resuming {run.path} from step {done}", quiet)
    begun = int(run.facts["begun_times"]) + 1
    run.note(status="running", reason=None, begun_times=begun)
    env.seed(config.seed + config.num_envs * (begun - 1))


def _restored(run: RunFolder, model: BaseAlgorithm, env: VecEnv, quiet: bool) -> int:
    """Restore the newest checkpoint that can be read; return its step."""
    for checkpoint in reversed(run.checkpoints()):
        try:
            return int(restore(model, env, checkpoint)["steps"])
        except ConfigurationError as error:
            _say(f"{error} Trying the checkpoint before it.", quiet)
    raise ConfigurationError(
        f"No checkpoint of {run.path} can be read. Delete the folder and train again."
    )


def _learn(model: BaseAlgorithm, config: TrainConfig, companion: Companion) -> None:
    """Learn until the last step, telling a numerical breakdown from other errors."""
    remaining = config.total_steps - model.num_timesteps
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="You are trying to run PPO on the GPU")
            model.learn(max(remaining, 0), companion, reset_num_timesteps=False)
    except ValueError as error:
        if "nan" not in str(error).lower() and "finite" not in str(error).lower():
            raise
        raise TrainingError(
            f"The training diverged by step {model.num_timesteps}: the network gave values that "
            "are not numbers. Lower learning_rate in [algorithm_options]."
        ) from error
    companion.finish()


def _say(text: str, quiet: bool) -> None:
    if not quiet:
        sys.stderr.write(text + "\n")
