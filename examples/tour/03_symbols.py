# %% [markdown]
# # The joint in symbols
#
# The same equations with symbols instead of numbers (SymPy) show what each parameter does.

# %%
from cjt_gym.symbolic import S, dynamics, lock_output, transfer_function

matrices = dynamics("full_dynamics")
print("I =", matrices.inertia)
print("D =", matrices.damping)
print("K =", matrices.stiffness)

# %% [markdown]
# From the motor's current to the torque of the torsion bar:

# %%
G = transfer_function("output_fixed_rigid_gearbox", "tau", "i")
G

# %% [markdown]
# ## Simplifications
#
# Structures are limits of each other. A load that is infinitely heavy is a locked output, and an
# infinitely stiff gearbox is a rigid one:

# %%
from sympy import simplify

from cjt_gym.symbolic import stiffen_gearbox

free = transfer_function("full_dynamics")
locked = transfer_function("output_fixed_rigid_gearbox")
print(simplify(stiffen_gearbox(lock_output(free)) - locked))

# %% [markdown]
# Without damping, what is left is the resonance:

# %%
from sympy import solve

from cjt_gym.symbolic import to_zero

undamped = to_zero(locked, "d_m", "d_g", "d_gl")
print(undamped)
print(solve(1 / undamped, S**2)[0])

# %% [markdown]
# ## Back to numbers, to code, to LaTeX

# %%
import cjt_gym
from cjt_gym.symbolic import evaluate, to_code, to_latex

p = cjt_gym.load_joint("orange_80_6000").parameters
print(evaluate(G, p))
print(to_code(G, "c"))
print(to_latex(undamped))
