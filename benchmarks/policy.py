"""What a trained policy costs in a control loop, in the forms in which it is deployed."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.report import Table
from benchmarks.timing import best_in_turns
from cjt_gym.training.deploy.exported import load_exported, save_exported
from cjt_gym.training.deploy.fast_policy import exported
from cjt_gym.training.deploy.stepper import Stepper
from cjt_gym.training.learning.algorithms import make_environment, make_model
from cjt_gym.training.learning.config import load_config
from cjt_gym.training.learning.policy import agent_of

CALLS, LIMIT = 2_000, 10.0
RECIPE = Path(__file__).parents[1] / "training" / "configs" / "quiet_residual.toml"


def table() -> Table:
    """Measure the policy of the shipped recipe, untrained."""
    config = load_config(RECIPE)
    env = make_environment(config)
    agent = agent_of("policy", config, make_model(config, env), env)
    with tempfile.TemporaryDirectory() as folder:
        policy = load_exported(save_exported(exported(agent), Path(folder) / "policy.npz"))
    stepper, size = Stepper(policy), policy.layout.size
    reference = [1.0] * (policy.layout.preview + 1)
    observations = np.random.default_rng(0).normal(size=(64, size)).astype(np.float32)

    def repeated(call: Callable[[int], object]) -> Callable[[], int]:
        def work() -> int:
            for k in range(CALLS):
                call(k)
            return CALLS

        return work

    calls: dict[str, Callable[[int], object]] = {
        "network": lambda k: policy.network.act(observations[k % 64]),
        "network, its observation and its history": lambda k: stepper.step(
            reference, 0.5, 0.01 * k, 0.01 * k, 0.0, 0.1, 0.1, 0.0
        ),
        "torch": lambda k: agent.act(observations[k % 64 : k % 64 + 1]),
    }
    times = best_in_turns({name: repeated(call) for name, call in calls.items()})
    widths = " x ".join(str(len(layer.bias)) for layer in policy.network.layers[:-1])
    return Table(
        "A policy at work",
        f"CPU time of one action of the recipe {RECIPE.stem} ({size} observed numbers, {widths} "
        "neurons), exported as NumPy arrays, and through torch; at most "
        f"{LIMIT:.0f} us are wanted.",
        ["what is called", "time [us]"],
        [[name, f"{1e6 * t:.1f}"] for name, t in times.items()],
    )
