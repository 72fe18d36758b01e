"""What happens beside the learning: progress, records, validation, checkpoints, and a guard."""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from tqdm import tqdm

from cjt_gym.disk import parsing, read_json, whole, write_text
from cjt_gym.disk.arrays import read_arrays
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.learning.algorithms import (
    load_normalization,
    load_weights,
    save_normalization,
)
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.policy import agent_of
from cjt_gym.training.learning.run_folder import RunFolder, TrainingError
from cjt_gym.training.learning.validation import validation_error

RECENT = 100  # episodes that are averaged, as in Stable-Baselines3
BUFFER_ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


class Companion(BaseCallback):
    """Accompanies one training.

    It shows a progress bar with the time left, in a file or a pipe a line for each validation,
    writes tracking error [N m] and return to TensorBoard and `progress.csv`, validates, keeps the
    best model, makes checkpoints, and stops the training with the reason when weights cease to be
    finite, or early where the configuration has a patience.
    """

    def __init__(self, run: RunFolder, config: TrainConfig, steps: int, quiet: bool) -> None:
        """Prepare for so many steps; `quiet` leaves out the progress."""
        super().__init__()
        self.run_folder, self.config, self._steps = run, config, steps
        self._bar: Any = tqdm(
            total=steps, unit="step", unit_scale=True, disable=quiet or None, desc="training"
        )
        self._in_lines = self._bar.disable and not quiet
        self._errors: deque[float] = deque(maxlen=RECENT)
        self._returns: deque[float] = deque(maxlen=RECENT)
        self._seconds_before = float(run.facts.get("seconds", 0.0))
        self._best = float(run.facts.get("best_validation_rmse") or "inf")
        self._begun = time.monotonic()
        self._next_validation = self._next_checkpoint = 0
        self._patience_is_over = False

    @property
    def reason(self) -> str | None:
        """Why the training ended before its last step; None if it did not."""
        if not self._patience_is_over:
            return None
        return f"{self.config.evaluation.patience} evaluations in a row without a better model"

    @property
    def seconds(self) -> float:
        """Time that the training has taken so far, interruptions left out [s]."""
        return self._seconds_before + time.monotonic() - self._begun

    def _on_training_start(self) -> None:
        done = self.num_timesteps
        if done == 0 and self.config.start_from is not None:
            self.validate()  # the model of the other run stays the best until it is beaten
        self._bar.update(done)
        self._next_validation = _next(done, self.config.evaluation.every)
        self._next_checkpoint = _next(done, self.config.checkpoint_every)

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self._errors.append(info["rmse"])
                self._returns.append(info["episode"]["r"])
        self._bar.update(self.num_timesteps - self._bar.n)
        return not self._patience_is_over

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= min(self._next_validation, self._next_checkpoint):
            self._look()

    def _on_rollout_end(self) -> None:
        if self._errors:
            self.logger.record("tracking/rmse_Nm", float(np.mean(self._errors)))
            self.logger.record("tracking/return", float(np.mean(self._returns)))

    def _look(self) -> None:
        check_finite(self.model, self.num_timesteps)
        if self.num_timesteps >= self._next_validation:
            self._next_validation = _next(self.num_timesteps, self.config.evaluation.every)
            self.validate()
        if self.num_timesteps >= self._next_checkpoint:
            self._next_checkpoint = _next(self.num_timesteps, self.config.checkpoint_every)
            self.checkpoint()

    def validate(self) -> None:
        """Run the policy on the validation episodes and keep the model if it is the best."""
        agent = agent_of("validation", self.config, self.model, self.training_env)
        error = validation_error(self.config, agent)
        self.logger.record("validation/rmse_Nm", error)
        row = {"steps": self.num_timesteps, "seconds": self.seconds, "validation_rmse": error}
        if self._errors:
            row |= {"rmse": float(np.mean(self._errors)), "return": float(np.mean(self._returns))}
        self.run_folder.add_progress(row)
        told = f"validation rmse {error:.3g} N m"
        self._bar.set_postfix_str(told)
        if self._in_lines:
            head = f"{self.num_timesteps} of {self._steps} steps, {self.seconds:.0f} s"
            sys.stderr.write(f"{head}: {told}\n")
        if error < self._best:
            self._best = error
            save_model(self.model, self.training_env, self.run_folder.path)
            self.run_folder.note(best_validation_rmse=error, best_steps=self.num_timesteps)
        self._check_patience()

    def _check_patience(self) -> None:
        """Note whether the last evaluations were all worse, those before an interruption too."""
        patience, best = self.config.evaluation.patience, self.run_folder.facts.get("best_steps", 0)
        since = sum(row["steps"] > best for row in self.run_folder.progress())
        self._patience_is_over = 0 < patience <= since

    def checkpoint(self) -> None:
        """Write a checkpoint; it is complete once its folder has its name."""
        folder = self.run_folder.path / "checkpoints"
        part = folder / "part"
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        save_model(self.model, self.training_env, part)
        save_replay(self.model, part / "replay.npz")
        state = {"steps": self.num_timesteps, "seconds": self.seconds}
        write_text(part / "state.json", json.dumps(state) + "\n")
        place = folder / f"step_{self.num_timesteps:012d}"
        shutil.rmtree(place, ignore_errors=True)
        part.rename(place)
        self.run_folder.drop_old_checkpoints()
        self.run_folder.note(steps=self.num_timesteps, seconds=self.seconds)

    def finish(self) -> None:
        """Validate and save once more, at the end."""
        self._bar.update(self.num_timesteps - self._bar.n)
        check_finite(self.model, self.num_timesteps)
        self.validate()
        self.checkpoint()

    def close(self) -> None:
        """Take the progress bar away."""
        self._bar.close()


def check_finite(model: BaseAlgorithm, steps: int) -> None:
    """Raise TrainingError if a weight of the model is not finite."""
    for name, weights in model.policy.state_dict().items():
        if not bool(torch.isfinite(weights).all()):
            raise TrainingError(
                f"The weights {name} are no longer finite at step {steps}. Lower learning_rate, or "
                "set max_grad_norm, in [algorithm_options]."
            )


def save_model(model: BaseAlgorithm, env: VecEnv, folder: Path) -> None:
    """Write model and statistics into a folder, each whole or not at all."""
    with whole(folder / "model.zip") as part:
        model.save(part)
    save_normalization(env, folder / "normalization.npz")


def save_replay(model: BaseAlgorithm, path: Path) -> None:
    """Write the replay buffer of an off-policy model as NPZ."""
    buffer = getattr(model, "replay_buffer", None)
    if isinstance(buffer, ReplayBuffer):
        rows = buffer.buffer_size if buffer.full else buffer.pos
        arrays = {name: getattr(buffer, name)[:rows] for name in BUFFER_ARRAYS}
        with whole(path) as part:
            np.savez(part, pos=buffer.pos, full=buffer.full, **arrays)


def load_replay(model: BaseAlgorithm, path: Path) -> None:
    """Read what `save_replay` wrote."""
    buffer = getattr(model, "replay_buffer", None)
    if isinstance(buffer, ReplayBuffer) and path.is_file():
        arrays = read_arrays(path, ConfigurationError)
        rows, most = len(arrays["actions"]), buffer.buffer_size
        wrong = [n for n in BUFFER_ARRAYS if arrays[n].shape[1:] != getattr(buffer, n).shape[1:]]
        pos, full = int(arrays["pos"]), bool(arrays["full"])
        if wrong or rows > most or not 0 <= pos <= rows or full != (rows == most and full):
            raise ConfigurationError(f"{path} is the replay buffer of another training.")
        for name in BUFFER_ARRAYS:
            getattr(buffer, name)[:rows] = arrays[name]
        buffer.pos, buffer.full = pos, full


def restore(model: BaseAlgorithm, env: VecEnv, checkpoint: Path) -> dict[str, Any]:
    """Restore weights, optimiser, statistics and replay buffer of a checkpoint; return its state.

    Nothing but numbers is read from its files.
    """
    with parsing(f"The checkpoint {checkpoint} must be whole", ConfigurationError):
        state: dict[str, Any] = read_json(checkpoint / "state.json", ConfigurationError)
        steps = int(state["steps"])
        load_weights(model, checkpoint / "model.zip")
        if (checkpoint / "normalization.npz").is_file():
            load_normalization(env, checkpoint / "normalization.npz")
        load_replay(model, checkpoint / "replay.npz")
    model.num_timesteps = steps
    return state


def _next(done: int, every: int) -> int:
    return (done // every + 1) * every
