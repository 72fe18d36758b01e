"""Error over one second against an independent integrator, for several substeps."""

from __future__ import annotations

from benchmarks.report import Table
from cjt_gym.joint import STRUCTURES, load_joint
from tests.physics.cases import DT, excitation, smooth_effects, states
from tests.physics.independent import peak_errors, reference_states

STEPS = (1e-4, 5e-5, 2e-5, 1e-5, 5e-6)
CASES = [
    *(("orange_80_6000", structure) for structure in STRUCTURES),
    ("generic", "full_dynamics"),
    ("lime_50_21000", "rigid_gearbox"),
    ("example", "output_fixed"),
    ("emps", "rigid"),
]


def errors(name: str, structure: str) -> list[float]:
    """Return the largest error of any state relative to its peak, per step."""
    joint = load_joint(name, structure, effects=smooth_effects(name))
    tau_m, load = excitation(joint, 1001)
    numbers = {symbol: q.value for symbol, q in joint.parameters.quantities.items()}
    effects = {key: dict(values) for key, values in joint.effects.items()}
    exact = reference_states(numbers, structure, effects, tau_m, load, DT)
    return [
        float(peak_errors(states(joint.simulate(tau_m, load, dt=DT, dt_physics=h)), exact).max())
        for h in STEPS
    ]


def table() -> Table:
    """Measure all cases."""
    rows = [
        [name, structure, *(f"{error:.1e}" for error in errors(name, structure))]
        for name, structure in CASES
    ]
    return Table(
        "Accuracy",
        "Largest error of any of the six states over 1 s, relative to that state's peak, against "
        "`tests/physics/independent.py` (dop853, rtol 1e-10). Coulomb friction with dq_0 = 0.002 "
        "rad/s, asymmetric damping and cogging; inputs held over 1 ms. `Joint.simulate` takes "
        "substeps of 10 us, environments 100 us.",
        ["joint", "structure", *(f"{h * 1e6:g} us" for h in STEPS)],
        rows,
    )
