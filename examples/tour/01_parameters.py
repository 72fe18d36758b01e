# %% [markdown]
# # A joint from its parameters
#
# A joint is a file of parameters, each with a unit and a source. This one is the example that the
# article on the Compliant Joint Toolbox builds step by step (Malzahn, Roozing, Tsagarakis, 2019,
# algorithm 1). Parameters that a file leaves out are zero, or cause an error where they are
# needed.

# %%
from pathlib import Path

import cjt_gym

source = "article on the Compliant Joint Toolbox, algorithm 1"
values = {
    "I_m": (0.09407, "kg m^2"),  # rotor, seen from the link
    "d_m": (2.188643e-3, "N m s/rad"),
    "d_cm": (2.64, "N m"),
    "k_t": (0.041, "N m/A"),
    "n": (100.0, "-"),  # gear ratio
    "d_g": (2.2, "N m s/rad"),
    "d_g_n": (2.1, "N m s/rad"),  # turning the other way
    "d_cg": (3.28, "N m"),
    "I_l": (1.137e-4, "kg m^2"),
    "k_b": (21000.0, "N m/rad"),  # torsion bar, the torque sensor
}
lines = ['name = "example"', f'source = "{source}"', "[parameters]"]
for name, (value, unit) in values.items():
    lines.append(f'{name} = {{ value = {value}, unit = "{unit}", source = "algorithm 1" }}')
text = "\n".join(lines) + "\n"
Path("example.toml").write_text(text)
print(text)

# %% [markdown]
# The structure of a joint says which of its three bodies are joined rigidly or fixed. Its effects
# are what makes it differ from a linear joint. Choose both when you load it.

# %%
joint = cjt_gym.load_joint(
    "example.toml",
    structure="output_fixed_rigid_gearbox",
    effects=["coulomb", "viscous_asym"],
)
print(joint.structure_row.summary)
for name, settings in joint.effects.items():
    print(name, dict(settings))

# %% [markdown]
# A mistake raises an error that says how to correct it.

# %%
from cjt_gym.errors import CjtGymError

for wrong in ({"k_b": -1.0}, {"k_bar": 21000.0}):
    try:
        cjt_gym.load_joint("example.toml", parameters=wrong)
    except CjtGymError as error:
        print(error)

# %% [markdown]
# ## Many at once
#
# A table of parameter sets, structures and effects gives a joint for every combination. On the
# command line, use `cjt-gym build table.toml`.

# %%
from cjt_gym.joint.build import build_joints

table = {
    "joints": {
        "plain": {"file": "example.toml"},
        "soft": {"file": "example.toml", "parameters": {"k_b": 6000.0}},
    },
    "structures": ["rigid_gearbox", "output_fixed_rigid_gearbox"],
    "effects": {"linear": {}, "rough": {"coulomb": {}, "viscous_asym": {}}},
}
for name, built in build_joints(table).items():
    print(f"{name:45} {built.state_space().nstates} states")
