# %% [markdown]
# # Randomise
#
# A policy trained on one joint works on that joint only. Every reset can draw a different joint:
# parameters and sizes of effects come from a range, a distribution or a tolerance.

# %%
import numpy as np
from matplotlib import pyplot as plt

import cjt_gym
from cjt_gym.plant import SimulatedPlant

joint = cjt_gym.load_joint(
    "orange_80_6000",
    "output_fixed_rigid_gearbox",
    effects={"coulomb": {}, "cogging": {"f": (480.0,), "a": (0.5,), "b": (0.2,)}},
)
drawn = {"k_b": (0.8, 1.2), "coulomb.d_cm": (0.3, 2.0), "cogging.scale": (0.0, 3.0)}
MANY = 64
plant = SimulatedPlant(joint, MANY, 1e-3, randomization=drawn)

# %% [markdown]
# All 64 joints run in one compiled kernel, here under the same torque:

# %%
t = 1e-3 * np.arange(600)
plant.reset(seed=0)
tau = np.empty((len(t), MANY))
for k, command in enumerate(12.0 * np.sin(2.0 * np.pi * 2.0 * t)):
    tau[k] = plant.batch.arrays.tau
    plant.step(np.full(MANY, command))
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.plot(t, tau, color="tab:blue", alpha=0.15)
nominal = joint.simulate(12.0 * np.sin(2.0 * np.pi * 2.0 * t))
axes.plot(t, nominal["true_tau"], color="black", label="nominal")
axes.set(xlabel="time [s]", ylabel="joint torque [N m]")
axes.legend(loc="upper left")

# %% [markdown]
# ## Presets
#
# `"mild"` and `"wide"` vary everything that acts in the joint. `"identified"` varies the values
# for which a joint file has an interval or a tolerance, as the files written by [a
# diagnosis](10_diagnose.ipynb) do.

# %%
import gymnasium as gym

env = gym.make("CJT/TorqueTracking-v0", effects=["coulomb", "noise"], randomization="mild")
for seed in range(3):
    _, info = env.reset(seed=seed)
    print({name: round(value, 5) for name, value in list(info["parameters"].items())[:4]})

# %% [markdown]
# For distributions, drifts and groups see [the model](../../docs/model.md#randomisation).
