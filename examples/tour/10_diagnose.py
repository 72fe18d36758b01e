# %% [markdown]
# # Find out why the real joint differs
#
# A diagnosis compares a record of the real joint with the nominal joint and says where they
# differ, which effect causes the difference, and what to record next. Here the real joint is
# simulated, so the truth is known: it has dry friction that its data sheet does not mention.

# %%
import numpy as np
from matplotlib import pyplot as plt

import cjt_gym
from cjt_gym.signals import make_signals

STRUCTURE = "output_fixed_rigid_gearbox"
real = cjt_gym.load_joint("orange_80_6000", STRUCTURE, effects={"coulomb": {}, "noise": {}})
nominal = cjt_gym.load_joint("orange_80_6000", STRUCTURE, effects={})
(signal,) = make_signals("multisine", 60.0)
t = 1e-3 * np.arange(8000)
command = signal.reset(np.random.default_rng(1)).torque(t)
record = real.simulate(command, seed=1)

# %%
from cjt_gym.gap import diagnose

found = diagnose(record, nominal.file, STRUCTURE)
found

# %% [markdown]
# What was hidden, and what was found:

# %%
hidden = sum(real.effects["coulomb"][name] for name in ("d_cm", "d_cg"))
(effect,) = (effect for effect in found.effects if effect.name == "coulomb")
named = effect.parameters["d_cm"]
print(f"hidden {hidden:.2f} N m, found {named.value:.2f} ({named.low:.2f} to {named.high:.2f})")
print(f"{100.0 * found.gap.removed:.0f} % of the gap on data that the fit has not seen")

# %% [markdown]
# The diagnosis writes a joint file with the effect and its interval. Use that joint for
# simulation, randomisation and training from now on.

# %%
from pathlib import Path

from cjt_gym.joint import to_toml

Path("found.toml").write_text(to_toml(found.joint))
identified = cjt_gym.load_joint("found.toml", STRUCTURE)
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.plot(t, record["tau"], color="black", label="recorded")
for name, joint in (("nominal", nominal), ("identified", identified)):
    axes.plot(t, joint.simulate(command)["true_tau"], lw=0.9, label=name)
axes.set(xlabel="time [s]", ylabel="joint torque [N m]", xlim=(2.0, 2.6))
axes.legend(loc="lower right")

# %% [markdown]
# `cjt-gym diagnose record.npz --joint orange_80_6000 --out found` does the same and writes a report
# ([diagnosis](../../docs/diagnosis.md)).
