# %% [markdown]
# # Linear analysis
#
# State-space models and transfer functions take one line each, for every structure. They leave
# out the effects: friction has no linear model.

# %%
import numpy as np
from matplotlib import pyplot as plt

import cjt_gym

joint = cjt_gym.load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects={})
system = joint.state_space()  # of python-control
print(system.state_labels, system.input_labels, system.output_labels)
G = joint.transfer_function("tau", "tau_m")
poles_of_G = np.roots(G.den[0][0])
print(poles_of_G)

# %% [markdown]
# For an input that is held for a millisecond, as a drive holds it, the poles are exp(s T):

# %%
held = joint.transfer_function("tau", "tau_m", 1e-3)
print(np.roots(held.den[0][0]), "=", np.exp(poles_of_G * 1e-3))

# %% [markdown]
# ## Modes
#
# Poles and zeros are named after the place of their energy. With a free load, the zeros of the
# motor speed are the load swinging against a motor at rest.

# %%
from cjt_gym.analysis.open_loop import frequency_response, poles, step, zeros

arm = cjt_gym.load_joint(
    "orange_80_6000", "full_dynamics", effects={}, parameters={"I_l": 0.5, "d_mg": 5.0}
)
for kind, modes in (("pole", poles(arm)), ("zero", zeros(arm, "tau_m", "dq_m"))):
    for mode in modes:
        print(f"{kind}  {mode.name:17} {mode.frequency:8.2f} Hz  damping {mode.damping:.3f}")

# %% [markdown]
# ## Structures over each other
#
# The gearbox of this joint is about three times as stiff as its torsion bar. Treating it as rigid
# moves the resonance by a few hertz and removes the gearbox mode.

# %%
f = np.geomspace(1.0, 500.0, 800)
figure, (gain, phase) = plt.subplots(2, 1, sharex=True, figsize=(7, 4.5), layout="constrained")
for structure in ("output_fixed", "output_fixed_rigid_gearbox"):
    joint = cjt_gym.load_joint("orange_80_6000", structure, effects={}, parameters={"d_mg": 5.0})
    response = frequency_response(joint, f)
    gain.semilogx(f, 20.0 * np.log10(np.abs(response)), label=structure)
    phase.semilogx(f, np.degrees(np.unwrap(np.angle(response))))
gain.set(ylabel="gain [dB]")
gain.legend(loc="upper right")
phase.set(xlabel="frequency [Hz]", ylabel="phase [deg]")

# %% [markdown]
# The input may be the current or, with a drive that has a voltage, the voltage behind resistance
# and inductance: `cjt-gym analyse orange_80_6000 --drive rl --input v --out linear.html` draws all
# of it.

# %%
driven = cjt_gym.load_joint("orange_80_6000", "output_fixed_rigid_gearbox", "rl", effects={})
for name, given in (("torque", "tau_m"), ("current", "i"), ("voltage", "v")):
    answer = step(driven, given)
    print(f"step of {name:8} ends at {answer.final:6.2f} N m, overshoot {answer.overshoot:.2f}")
