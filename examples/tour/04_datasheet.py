# %% [markdown]
# # What the joint can do
#
# The parameters of a joint determine its torque, speed, power and heat limits. The data sheet
# shows them on two pages; here are single quantities and two of its maps.

# %%
import numpy as np
from matplotlib import pyplot as plt

from cjt_gym.characteristics import CHARACTERISTICS, characteristics
from cjt_gym.joint import load_joint_file

file = load_joint_file("avocado_100_21000")
p = file.parameters
found = characteristics(p)
for name in ("t_r", "t_p", "t_stall", "dq_NL", "eta_max", "t_hold_cold", "f_0", "f_p"):
    row = CHARACTERISTICS[name]
    print(f"{row.title:32} {found[name]:10.4g} {row.unit(p.axis)}")

# %% [markdown]
# ## Efficiency over the whole plane

# %%
from cjt_gym.characteristics import best_point, efficiency

tau = np.linspace(0.0, found["t_p"], 200)
speed = np.linspace(0.0, found["dq_0"], 200)
figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
shown = axes.contourf(tau, speed, 100.0 * efficiency(p, tau[None, :], speed[:, None]), 9)
axes.plot(*best_point(p), "o", color="red", clip_on=False, label=f"{found['eta_max']:.0f} %")
axes.set(xlabel="motor torque at the link [N m]", ylabel="speed [rad/s]")
axes.legend(loc="upper right")
figure.colorbar(shown, label="efficiency [%]")

# %% [markdown]
# ## Torque over frequency
#
# With a locked output, the torque is limited by the current, times the gain of the resonance. At
# the resonance itself the supply voltage is the limit, and above it the inertia of the rotor.

# %%
from cjt_gym.characteristics import torque_limits

f = np.geomspace(0.5, 200.0, 400)
limits = torque_limits(p, f)
figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
for name in ("current", "continuous", "voltage"):
    axes.loglog(f, getattr(limits, name), label=name)
axes.loglog(f, limits.peak, color="black", lw=2.5, alpha=0.3, label="available")
axes.set(xlabel="frequency [Hz]", ylabel="joint torque, amplitude [N m]")
axes.legend(loc="upper right")

# %% [markdown]
# ## The sheet
#
# `cjt-gym datasheet avocado_100_21000 --out avocado.pdf` writes the data sheet. Several joints
# can be compared, and `--json` prints every number.

# %%
from cjt_gym.datasheet import make_sheet, write_sheet

(path,) = write_sheet(make_sheet([file]), "avocado.html")
print(path, path.stat().st_size // 1000, "kB")
