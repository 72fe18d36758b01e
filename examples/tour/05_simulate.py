# %% [markdown]
# # Friction, ripple, noise and delay
#
# `simulate` takes motor torques and returns a record with the sensor readings and the true
# values.

# %%
import numpy as np
from matplotlib import pyplot as plt

import cjt_gym

t = 1e-3 * np.arange(1000)
command = 8.0 * np.sin(2.0 * np.pi * 2.0 * t)


def simulated(**effects):
    joint = cjt_gym.load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects=effects)
    return joint.simulate(command, seed=1)


linear = simulated()
print(f"{linear['tau'].max():.2f} N m of {command.max():.2f} N m arrive")

# %% [markdown]
# ## Friction
#
# Coulomb friction opposes motion with a constant torque; below that torque nothing moves. With
# Stribeck friction it takes more torque to start moving than to keep moving.

# %%
runs = {
    "linear": linear,
    "coulomb": simulated(coulomb={}),
    "coulomb and stribeck": simulated(coulomb={}, stribeck={"d_sm": 1.5, "v_s": 0.02}),
}
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for name, record in runs.items():
    axes.plot(t, record["true_tau"], label=name)
axes.plot(t, command, ":", color="black", label="commanded")
axes.set(xlabel="time [s]", ylabel="torque [N m]", xlim=(0.0, 0.6))
axes.legend(loc="lower left")

# %% [markdown]
# ## Ripple
#
# Cogging and gear meshing are periodic in the motor angle, so their frequency rises with speed.
# Here the joint accelerates a free load, and the ripple in the torque is largest as it passes the
# resonance at 28 Hz.

# %%
push = 4.0 * np.minimum(2.0 * t, 1.0)
moved = {}
cogging = {"f": (480.0,), "a": (0.8,), "b": (0.3,)}
for name, effects in (("smooth", {}), ("ripple", {"cogging": cogging})):
    joint = cjt_gym.load_joint(
        "orange_80_6000", "rigid_gearbox", effects=effects, parameters={"I_l": 0.5}
    )
    moved[name] = joint.simulate(push)
figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(7, 4), layout="constrained")
upper.plot(t, moved["ripple"]["true_tau"] - moved["smooth"]["true_tau"])
upper.set(ylabel="added torque [N m]")
lower.plot(t, 480.0 * moved["smooth"]["true_dq_m"] / (2.0 * np.pi))
lower.axhline(28.2, color="black", ls=":")
lower.set(xlabel="time [s]", ylabel="frequency of ripple [Hz]")

# %% [markdown]
# ## What the controller sees
#
# Noise, resolution and delay lie between the joint and its controller.

# %%
record = simulated(noise={"tau": 0.1}, quantization={"tau": 0.2}, measurement_delay={"delay": 3e-3})
figure, axes = plt.subplots(figsize=(7, 2.6), layout="constrained")
axes.plot(t[:150], record["true_tau"][:150], label="true")
axes.plot(t[:150], record["tau"][:150], lw=0.8, label="measured")
axes.set(xlabel="time [s]", ylabel="torque [N m]")
axes.legend(loc="upper left")

# %% [markdown]
# ## What is left of the linear joint
#
# A nonlinear joint has no frequency response, but a best linear approximation that depends on the
# size of the signal. Multisines measure it together with the distortion, which is what comes out at
# frequencies that were not put in. With friction it differs at every size: `cjt-gym analyse
# orange_80_6000 --effect coulomb --identify 10 --out seen.html` draws it over the linear one.

# %%
from cjt_gym.analysis import identify
from cjt_gym.analysis.open_loop import frequency_response
from cjt_gym.baselines import make_controller

joint = cjt_gym.load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects=["coulomb"])
law = make_controller("open_loop", joint, 1e-3)
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
f = np.geomspace(1.0, 150.0, 500)
axes.loglog(f, np.abs(frequency_response(joint, f, dt=1e-3)), color="black", label="linear")
for rms in (40.0, 10.0, 4.0):
    seen = identify(law, joint, 1e-3, rms, low=1.0, high=150.0, phases=3)
    axes.loglog(seen.f, np.abs(seen.response), "o", ms=3, label=f"{rms:.0f} N m rms")
    print(f"{rms:4.0f} N m rms: distortion {100.0 * seen.distortion:.1f} % of the output")
axes.set(xlabel="frequency [Hz]", ylabel="joint torque over motor torque")
axes.legend(loc="upper right")

# %% [markdown]
# Every effect, with its equation and parameters, is on the page [effects](../../docs/effects.md).
