# %% [markdown]
# # Controllers, with and without an observer
#
# A torque controller takes measurements and a reference and returns a motor torque. The loop is
# short enough to write out.

# %%
import numpy as np
from matplotlib import pyplot as plt

import cjt_gym
from cjt_gym.baselines import make_controller
from cjt_gym.plant import SimulatedPlant

DT = 1e-3
joint = cjt_gym.load_joint(
    "orange_80_6000",
    "output_fixed_rigid_gearbox",
    effects={"coulomb": {}, "stribeck": {"d_sm": 1.0, "v_s": 0.02}, "noise": {}},
)
t = DT * np.arange(1500)
wanted = 20.0 * np.sin(2.0 * np.pi * 1.0 * t)


def controlled(name, reference=wanted):
    law, plant = make_controller(name, joint, DT), SimulatedPlant(joint, 1, DT)
    seen, tau = plant.reset(seed=0), []
    for value in reference:
        tau.append(plant.batch.arrays.tau[0])
        seen = plant.step(law.act(seen, np.array([value])))
    return np.array(tau)


# %% [markdown]
# Open loop, a PD law with feed-forward, the same with a disturbance observer around it, and state
# feedback on a Luenberger observer that sees the joint torque alone. None of these controllers
# knows the friction at the motor; an observer infers it from the motion.

# %%
names = ("open_loop", "pd_feedforward", "pid_outer_dob", "observer_feedback")
runs = {name: controlled(name) for name in names}
figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(7, 4.8), layout="constrained")
for name, tau in runs.items():
    upper.plot(t, tau, label=name)
    lower.plot(t, wanted - tau)
upper.plot(t, wanted, ":", color="black", label="wanted")
upper.set(ylabel="torque [N m]")
upper.legend(loc="upper right", fontsize=8)
lower.set(xlabel="time [s]", ylabel="error [N m]")
for name, tau in runs.items():
    print(f"{name:18} rms error {np.sqrt(np.mean((wanted - tau) ** 2)):.2f} N m")

# %% [markdown]
# ## What it costs
#
# The linear loop shows how far each controller is from instability, how fast it is, how much
# sensor noise reaches the motor, and whether the joint stays passive in contact.

# %%
from cjt_gym.analysis import analyse, figures_of

print(f"{'':18} delay margin  bandwidth   noise  passive")
for name in names[1:]:
    found = figures_of(analyse(make_controller(name, joint, DT), joint, DT))
    print(
        f"{name:18} {1e3 * found.delay_margin:9.2f} ms {found.bandwidth_hz:7.1f} Hz "
        f"{found.noise_amplification:7.2f}  {'yes' if found.port_passive else 'no'}"
    )

# %% [markdown]
# ## An observer by itself
#
# Observers can also be used alone. The momentum observer estimates the torque that opposes the
# motor without differentiating the speed; here that torque is the simulated friction.

# %%
from cjt_gym.baselines.observers import momentum_observer
from cjt_gym.baselines.plant_model import SampledJoint

law, plant = make_controller("pd_feedforward", joint, DT), SimulatedPlant(joint, 1, DT)
observer = momentum_observer(SampledJoint(joint, DT), bandwidth_hz=30.0)
seen, command, fresh = plant.reset(seed=0), np.zeros(1), np.array([True])
estimates, true = [], []
for value in wanted:
    estimates.append(observer.step(seen, command, fresh)["disturbance"][0])
    speed = plant.batch.arrays.state[0, 3:]  # of motor, gear and load
    true.append(-joint.nonlinear_torque(np.zeros(3), speed).sum())
    command, fresh = law.act(seen, np.array([value])), np.array([False])
    seen = plant.step(command)

figure, axes = plt.subplots(figsize=(7, 2.8), layout="constrained")
axes.plot(t, true, label="friction in the simulation")
axes.plot(t, estimates, lw=0.9, label="estimated")
axes.set(xlabel="time [s]", ylabel="torque [N m]", ylim=(-8.0, 11.0))
axes.legend(loc="upper right", ncols=2)

# %% [markdown]
# [The page on controllers](../../docs/controllers.md) lists all controllers and observers with
# their equations and sources.
