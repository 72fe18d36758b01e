# %% [markdown]
# # Train a policy
#
# A joint is also a Gymnasium environment. Here a policy learns what to add to a PD controller with
# feed-forward, on the joint of [the comparison](07_compare.ipynb). The training is short and the
# network small (`pip install "cjt-gym[train]"`); `make demo` trains for a million steps.

# %%
from dataclasses import replace

import gymnasium as gym
from matplotlib import pyplot as plt

import cjt_gym  # noqa: F401  (registers the environments)

environment = {
    "joint": "orange_80_6000",
    "structure": "output_fixed_rigid_gearbox",
    "effects": {"coulomb": {}, "noise": {}, "quantization": {}},
    "randomization": {"k_b": (0.9, 1.1), "coulomb.d_cm": (0.5, 1.5)},
}
env = gym.make("CJT/TorqueTracking-v0", **environment)
observation, info = env.reset(seed=1)
print(env.action_space, env.observation_space.shape)
print(f"this episode: k_b = {info['parameters']['k_b']:.0f} N m/rad")

# %% [markdown]
# A configuration defines a training; on the command line it is a TOML file:
# `cjt-gym train ppo_residual`.

# %%
from cjt_gym.training.learning.config import EvaluationConfig, load_config
from cjt_gym.training.learning.train import train

usual = load_config("ppo_residual")
config = replace(
    usual,
    total_steps=16_384,
    env={**environment, "base_controller": "pd_feedforward", "episode_steps": 500},
    algorithm_options={**usual.algorithm_options, "n_steps": 32, "batch_size": 256},
    evaluation=EvaluationConfig(every=4096, episodes=8),
)
run = train(config, "policy", quiet=True)
progress = [row for row in run.progress() if row["validation_rmse"] == row["validation_rmse"]]
figure, axes = plt.subplots(figsize=(7, 2.8), layout="constrained")
axes.plot([r["steps"] for r in progress], [r["validation_rmse"] for r in progress], "o-")
axes.set(xlabel="steps", ylabel="tracking error, rms [N m]", ylim=(0.0, None))

# %% [markdown]
# On joints not used for training, compared with its base controller:

# %%
from cjt_gym.training.benchmark import make_agents
from cjt_gym.training.evaluation.conditions import Conditions, task_reference
from cjt_gym.training.evaluation.metrics import rmse
from cjt_gym.training.evaluation.rollout import rollout

conditions = Conditions(**environment)
reference = task_reference("smooth", conditions.amplitude)
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for agent in make_agents(["pd_feedforward"], ["policy"]):
    traces = rollout(agent, conditions, reference, steps=1000, num=16, seed=10**6)
    axes.plot((traces.reference[0] - traces.tau[0])[50:], label=agent.name)
    print(f"{agent.name:15} {rmse(traces):.2f} N m")
axes.set(xlabel="step", ylabel="error [N m]")
axes.legend(loc="lower left")
