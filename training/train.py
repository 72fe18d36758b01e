"""Train a policy: begin a run, or go on with one."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat
from stable_baselines3.common.vec_env import VecEnv

from cjt_gym.envs.core import Episodes
from cjt_gym.errors import CjtGymError
from cjt_gym.training.algorithms import make_environment, make_model
from cjt_gym.training.callbacks import Companion, restore
from cjt_gym.training.config import TrainConfig, environment_arguments
from cjt_gym.training.run_folder import RunFolder, TrainingError, begin_run


def train(config: TrainConfig, out: str | Path, quiet: bool = False) -> RunFolder:
    """Train as a configuration says, or go on from the last checkpoint of a run that was stopped.

    Args:
        config: What to train.
        out: The run folder; see `RunFolder` for what it will hold.
        quiet: Whether to leave out the progress bar and messages on standard error.

    Returns:
        The run folder. A run that was finished before is left as it is.

    Raises:
        ConfigurationError: The configuration is not valid, or the folder holds something else.
        TrainingError: The training diverged; `run.json` has the reason.
    """
    joint = Episodes(1, **environment_arguments(config.env)).settings.joint
    env = make_environment(config)
    model = make_model(config, env)
    run = begin_run(out, config, joint)
    if run.facts["status"] == "finished":
        _say(f"{run.path} is finished ({run.facts['steps']} steps). Nothing to do.", quiet)
        return run
    torch.set_num_threads(config.threads)
    _continue(run, model, env, config, quiet)
    model.set_logger(Logger(None, _writers(run)))
    companion = Companion(run, config, quiet)
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
    run.note(status="finished", reason=None, seconds=companion.seconds)
    return run


def _continue(
    run: RunFolder, model: BaseAlgorithm, env: VecEnv, config: TrainConfig, quiet: bool
) -> None:
    """Restore the last checkpoint, if there is one, and seed the environments."""
    done = 0
    if run.checkpoints():
        done = int(restore(model, env, run.checkpoints()[-1])["steps"])
        run.forget_progress_after(done)
        _say(f"going on with {run.path} from step {done}", quiet)
    begun = int(run.facts["begun_times"]) + 1
    run.note(status="running", reason=None, begun_times=begun)
    env.seed(config.seed + config.num_envs * (begun - 1))


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


def _writers(run: RunFolder) -> list[KVWriter]:
    return [TensorBoardOutputFormat(str(run.path / "tensorboard"))]


def _say(text: str, quiet: bool) -> None:
    if not quiet:
        sys.stderr.write(text + "\n")
