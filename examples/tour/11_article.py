# %% [markdown]
# # The article, reproduced
#
# Every figure and table of the toolbox article that shows a joint, with the printed numbers next
# to those of this package. Figures 1, 2, 6 and 7 show software and hardware: the architecture, a
# browser of examples, photos of actuators and the wiring of EtherCAT.
#
# J. Malzahn, W. Roozing, N. Tsagarakis, "The Compliant Joint Toolbox for MATLAB", IEEE Robotics and
# Automation Magazine 26(3), 2019.

# %% [markdown]
# ## Algorithm 1: a joint from a handful of deviations
#
# What is not given is a class default of the toolbox, which is the joint `generic`. Values for
# the negative direction default to those of the positive one; the toolbox keeps those of another
# motor.

# %%
import numpy as np
import sympy as sp
from matplotlib import pyplot as plt

import cjt_gym

ALGORITHM_1 = {
    "I_m": 9.407e-2,
    "d_m": 2.188643e-3,
    "d_cm": 2.64,
    "k_t": 4.1e-2,
    "n": 100.0,
    "d_g": 2.2,
    "d_g_n": 2.1,
    "d_cg": 3.28,
    "I_l": 1.137e-4,
    "k_b": 21000.0,
}
printed = cjt_gym.load_joint("generic", parameters=ALGORITHM_1).parameters
shipped = cjt_gym.load_joint("example").parameters
print({name: (printed.get(name, 0.0), shipped.get(name, 0.0)) for name in ("d_g_n", "d_cm_n")})

# %% [markdown]
# ## Algorithms 3 and 5: a class of its own, and an object of it
#
# The electrical dynamics are the drive `rl` (or `dq`); nothing has to be built beforehand.

# %%
joint = cjt_gym.load_joint(
    "example", "output_fixed_rigid_gearbox", "rl", effects=["coulomb", "viscous_asym"]
)
record = joint.simulate(20.0 * np.sign(np.sin(20.0 * np.arange(1000) * 1e-3)))
print(joint.structure, joint.drive, list(joint.effects), f"{record['true_tau'].max():.2f} N m")

# %% [markdown]
# ## Algorithm 6: transfer functions and state space
#
# `exTF(7, 1)` is from the motor's side to the joint torque. It is minimal: a free joint loses the
# pole of its free motion. The toolbox makes it discrete by Tustin's rule, here it is exact for an
# input that is held.

# %%
for structure in ("output_fixed_rigid_gearbox", "full_dynamics"):
    linear = cjt_gym.load_joint("example", structure, effects={})
    system, torque = linear.state_space(), linear.transfer_function("tau", "tau_m")
    print(f"{structure}: {system.nstates} states, order {len(torque.poles())}")
linear = cjt_gym.load_joint("example", "output_fixed_rigid_gearbox", effects={})
print(linear.transfer_function("tau", "tau_m"))
print(linear.transfer_function("tau", "tau_m", dt=1e-3))

# %% [markdown]
# ## Algorithm 7: the same in symbols

# %%
from cjt_gym.symbolic import dynamics, transfer_function

transfer_function("output_fixed_rigid_gearbox")

# %% [markdown]
# ## Table 1: the linear models
#
# Inertia, damping and stiffness of each structure are as printed. The table differs from the text
# in these places, through a misprint or the scan:
#
# * B of the full dynamics is the stiffness matrix there; it is the input of the two torques.
# * Signs are missing in A: in the row of the motor the entries are -k_g / I_m and k_g / I_m, and
#   the damping of a body is negative on its diagonal.
# * The fixed-output models have coordinates q_m, q_l; they are q_m and q_g, and q_l is an input.

# %%
for structure in (
    "full_dynamics",
    "rigid_gearbox",
    "rigid",
    "output_fixed",
    "output_fixed_rigid_gearbox",
):
    found = dynamics(structure)
    print(structure)
    for name in ("inertia", "damping", "stiffness"):
        print(f"  {name:9} {getattr(found, name).tolist()}")

# %%
I_m, I_g, I_l, k_g, k_b = sp.symbols("I_m I_g I_l k_g k_b", positive=True)
d_m, d_g, d_l, d_mg, d_gl = sp.symbols("d_m d_g d_l d_mg d_gl", positive=True)
TABLE_1 = {
    "full_dynamics": (
        [[I_m, 0, 0], [0, I_g, 0], [0, 0, I_l]],
        [[d_m + d_mg, -d_mg, 0], [-d_mg, d_g + d_mg + d_gl, -d_gl], [0, -d_gl, d_l + d_gl]],
        [[k_g, -k_g, 0], [-k_g, k_g + k_b, -k_b], [0, -k_b, k_b]],
    ),
    "rigid_gearbox": (
        [[I_m + I_g, 0], [0, I_l]],
        [[d_m + d_g + d_gl, -d_gl], [-d_gl, d_l + d_gl]],
        [[k_b, -k_b], [-k_b, k_b]],
    ),
    "rigid": ([[I_m + I_g + I_l]], [[d_m + d_g + d_l]], [[0]]),
    "output_fixed": (
        [[I_m, 0], [0, I_g]],
        [[d_m + d_mg, -d_mg], [-d_mg, d_g + d_mg + d_gl]],
        [[k_g, -k_g], [-k_g, k_g + k_b]],
    ),
    "output_fixed_rigid_gearbox": ([[I_m + I_g]], [[d_m + d_g + d_gl]], [[k_b]]),
}
for structure, parts in TABLE_1.items():
    found = dynamics(structure)
    ours = (found.inertia, found.damping, found.stiffness)
    same = [
        sp.simplify(one - sp.Matrix(two)).is_zero_matrix
        for one, two in zip(ours, parts, strict=True)
    ]
    print(f"{structure:27} I, D, K as printed: {same}")
    assert all(same)

# %% [markdown]
# The stiffness of `rigid` is printed as infinite: the spring between masses that are one. Nothing
# pulls the one mass back, so that it is zero in its own equation.
#
# ## Figures 3 and 4: masses, springs, and what is added to them
#
# ![](../../docs/figures/joint.svg)
#
# The nonlinear term g of Figure 4 is a torque on each body that depends on the state: here friction
# of `example` over speed, as in Algorithm 1.

# %%
rough = cjt_gym.load_joint("example", effects=["coulomb", "viscous_asym"])
speed = np.linspace(-4.0, 4.0, 401)
torque = rough.nonlinear_torque(np.zeros((401, 3)), np.repeat(speed[:, None], 3, axis=1))
figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.plot(speed, torque[:, 0], label="motor")
axes.plot(speed, torque[:, 1], label="gear")
axes.set(xlabel="speed [rad/s]", ylabel="g [N m]")
axes.legend(loc="upper right")

# %% [markdown]
# ## Algorithm 8 and Figure 5: the data sheet
#
# The sheet that is printed is not that of Algorithm 1: it has almost no friction. Without the lines
# on friction, d_cm is a class default of 0.1858 N m and the gear has none, which gives the printed
# numbers. Both joints ship: `example` is Algorithm 1, `example_figure_5` the sheet.

# %%
from cjt_gym.characteristics import characteristics
from cjt_gym.datasheet import plots

PRINTED = {  # as far as the small print can be read
    "I_m": 0.0941,
    "I_l": 0.0001,
    "T_mech": 0.0019,
    "dv": 0.0022,
    "Mc": 0.1856,
    "r": 0.0885,
    "l_a": 0.0001,
    "T_el": 0.0016,
    "Tmp_WMax": 120.0,
    "T_thw": 3.96,
    "r_th1": 0.29,
    "r_th2": 3.45,
}
sheets = {}
for name in ("example", "example_figure_5"):
    p = cjt_gym.load_joint(name).parameters
    sheets[name] = {s: q.number for s, q in p.quantities.items()} | characteristics(p)
print(f"{'':9} {'printed':>10} {'example':>10} {'figure 5':>10}")
for name, value in PRINTED.items():
    one, other = (sheets[joint][name] for joint in sheets)
    print(f"{name:9} {value:10.4f} {one:10.4f} {other:10.4f}")

# %% [markdown]
# What differs, and why:
#
# * `dv` and `Mc` of `example`: the printed sheet is without the friction of Algorithm 1, see above.
#   `Mc` reads 0.1856 in print, the class default is 0.1858.
# * `k_t` is printed as 0.0110 and the generator constant as 24.3: Algorithm 1 has 0.041 N m/A,
#   whose inverse is 24.39. The unit of 1 / k_t is rad/(s V); a generator constant in V s/rad is
#   k_t itself.
# * Diameter, length and gear inertia are printed as 120, 120 mm and 0.262 kg m^2; the class
#   defaults are 100, 150 mm and 0.263 kg m^2.

# %%
p = cjt_gym.load_joint("example_figure_5").parameters
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
plots.torque_speed(left, p)
left.set_title("Figure 5, diagram 1")
figure.colorbar(plots.holding(right, p), ax=right, label="time held [s]")
right.set_title("Figure 5, diagram 2")

# %% [markdown]
# The first diagram is the printed one, cut off at the peak speed. The second is the torque on a
# locked output with the time for which the winding bears it: the sinusoid heats by its rms, not
# by its amplitude, the housing warms up, too, and the limit of the voltage counts resistance and
# inductance besides the back-EMF.
