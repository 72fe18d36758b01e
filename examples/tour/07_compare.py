# %% [markdown]
# # A fair comparison
#
# Controllers are compared on the same joints, references and noise. Every episode draws its own
# joint around the nominal one, the same for each of them.

# %%
import numpy as np
from matplotlib import pyplot as plt

from cjt_gym.training.benchmark import make_agents
from cjt_gym.training.evaluation.conditions import Conditions, task_reference
from cjt_gym.training.evaluation.metrics import bootstrap_rmse, rmse
from cjt_gym.training.evaluation.rollout import rollout

conditions = Conditions(
    joint="orange_80_6000",
    effects=["coulomb", "noise", "quantization"],
    randomization={"k_b": (0.9, 1.1), "coulomb.d_cm": (0.5, 1.5)},
)
agents = make_agents(["open_loop", "pd_feedforward", "pid_feedforward", "observer_feedback"], [])
found = {
    (agent.name, task): rollout(
        agent, conditions, task_reference(task, conditions.amplitude), steps=1000, num=16, seed=0
    )
    for agent in agents
    for task in ("smooth", "step")
}

# %% [markdown]
# The interval is that of the error over the episodes, 95 %, by bootstrap.

# %%
for (name, task), traces in found.items():
    low, high = bootstrap_rmse(traces)
    print(f"{name:18} {task:7} {rmse(traces):5.2f} N m ({low:.2f} to {high:.2f})")

# %% [markdown]
# The first of the joints, under steps:

# %%
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for agent in agents:
    traces = found[agent.name, "step"]
    t = traces.dt * np.arange(traces.tau.shape[1])
    axes.plot(t[:-1], traces.tau[0, :-1], label=agent.name)
axes.plot(t[:-1], traces.reference[0, :-1], ":", color="black", label="wanted")
axes.set(xlabel="time [s]", ylabel="torque [N m]")
axes.legend(loc="upper left", fontsize=8)

# %% [markdown]
# `cjt-gym benchmark` does this for more controllers, tasks and joints, adds bandwidth, noise,
# margins and a ranking, and writes a report ([benchmark](../../docs/benchmark.md)).
