"""What users of the toolbox know it for, one row each, and what does it here."""

from __future__ import annotations

from dataclasses import dataclass

from cjt_gym.baselines import CONTROLLERS

FIXED = "--structure output_fixed_rigid_gearbox"
ORANGE = 'load_joint("orange_80_6000")'


@dataclass(frozen=True)
class Feature:
    """One feature.

    Attributes:
        group: What it belongs to.
        what: What the toolbox offers, in our words.
        command: What does it here: a line for the shell that begins with `cjt-gym` or `python`, or
            lines of Python, joined by "; ".
        note: What differs or is missing; the command may then be empty.
        slow: Whether it takes more than a second or two.
    """

    group: str
    what: str
    command: str
    note: str = ""
    slow: bool = False

    @property
    def is_shell(self) -> bool:
        """Whether the command is one for the shell."""
        return self.command.startswith(("cjt-gym ", "python "))


def _drawn(*calls: str) -> str:
    drawn = f"plt.figure().subplots(), {ORANGE}.parameters"
    head = "from cjt_gym.datasheet import plots; import matplotlib.pyplot as plt"
    return "; ".join([head, *(f"plots.{call}".replace("*", drawn) for call in calls)])


def _simulated(options: str, joint: str = "orange_80_6000") -> str:
    return f"cjt-gym simulate {joint} --duration 0.2 {options} --out run.csv"


MODELS = (
    Feature(
        "Models",
        "a joint from default values and a few changes",
        'load_joint("generic", parameters={"k_b": 21000.0, "n": 100.0})',
    ),
    Feature(
        "Models",
        "parameter files (`.m`)",
        "cjt-gym convert example_params.m --out example_params.toml --defaults generic",
        "parsed, not executed",
    ),
    Feature(
        "Models",
        "a collection of identified actuators with their parameters",
        "cjt-gym joints joints orange_80_6000",
    ),
    Feature(
        "Models",
        "model classes for many combinations of parameters, structures and effects",
        "cjt-gym build table.toml --out built",
    ),
    Feature(
        "Models",
        "five mechanical structures: full, rigid gearbox, rigid, and two with a fixed output",
        "cjt-gym analyse orange_80_6000 --structure full_dynamics rigid_gearbox rigid "
        "output_fixed output_fixed_rigid_gearbox --output dq_m --json",
    ),
    Feature("Models", "a prescribed motion of the output, or a load torque",
            f"{ORANGE}.simulate([10.0] * 50, load=[1.0] * 50)"),
    Feature("Models", "static electrical model", _simulated("--drive static")),
    Feature("Models", "one phase with inductance", _simulated("--drive rl")),
    Feature("Models", "two phases in d-q axes, for vector control", _simulated("--drive dq"),
            "includes its current controller"),
    Feature("Models", "asymmetric viscous friction",
            _simulated("--effect viscous_asym", "example")),
    Feature("Models", "symmetric and asymmetric Coulomb friction",
            _simulated("--effect coulomb_asym")),
    Feature("Models", "torque ripple as a Fourier series over the rotor angle",
            _simulated("--effect cogging=typical gear_ripple=typical")),
    Feature("Models", "noise and quantization of sensors and commands",
            _simulated("--effect noise quantization command_quantization=typical "
                       "command_noise=typical")),
    Feature("Models", "delays of commands and measurements",
            _simulated("--effect command_delay=typical measurement_delay=typical")),
    Feature("Models", "velocities from filtered differences; filtered torque",
            _simulated("--effect velocity_differentiation=typical torque_filter=typical")),
    Feature("Models", "nonlinear springs, and friction and springs with memory (announced only)",
            _simulated("--effect spring_table=typical spring_hysteresis=typical "
                       "presliding=typical")),
)  # fmt: skip
ANALYSIS = (
    Feature("Analysis", "state space and transfer functions, continuous",
            f'{ORANGE}.state_space(); {ORANGE}.transfer_function("tau", "tau_m")'),
    Feature("Analysis", "the same in discrete time",
            f'{ORANGE}.state_space(dt=1e-3); {ORANGE}.transfer_function("tau", "tau_m", dt=1e-3)',
            "exact instead of Tustin"),
    Feature("Analysis", "symbolic models, and numbers from them",
            'from cjt_gym.symbolic import transfer_function, to_latex; '
            'to_latex(transfer_function("output_fixed_rigid_gearbox"))', slow=True),
    Feature("Analysis", "parameters referred to the motor or load side",
            "from cjt_gym.characteristics import to_motor; "
            f'to_motor({ORANGE}.parameters.quantities["I_m"], n=80.0)'),
    Feature("Analysis", "torque-speed slope, no-load speed, stall torque and other constants",
            "cjt-gym datasheet orange_80_6000 --json"),
    Feature("Analysis", "spectra and empirical transfer functions of records",
            "cjt-gym analyse orange_80_6000 --effect coulomb --identify 5 --json", slow=True),
    Feature("Data sheets", "a PDF sheet with diagrams and parameters",
            "cjt-gym datasheet orange_80_6000 --out orange.pdf", "without LaTeX", slow=True),
    Feature("Data sheets", "a torque-speed diagram in your own figure",
            _drawn("torque_speed(*)")),
    Feature("Data sheets", "efficiency as curves and as a map",
            _drawn("efficiency_curves(*, [2.0, 5.0])", "efficiency_map(*)")),
    Feature("Data sheets", "heat: final temperatures, and how long a torque can be held",
            _drawn("final_temperature(*)", "time_held(*)")),
    Feature("Data sheets", "torque bandwidth over the load inertia",
            _drawn("torque_with_load(*)")),
    Feature("Data sheets", "torque bandwidth with a locked output, including thermal limits",
            _drawn("holding(*)")),
    Feature("Data sheets", "a comparison of joints",
            "cjt-gym datasheet orange_80_6000 lemon_50_6000 --out both.html", slow=True),
)  # fmt: skip


def _exported(observer: str, gains: str) -> str:
    return (
        f"cjt-gym export {observer} --to c --joint orange_80_6000 {FIXED} --effect none "
        f"--gain {gains} --out {observer}.h"
    )


OBSERVERS = (
    Feature("Observers", "Luenberger observer", _exported("luenberger", "bandwidth_hz=60")),
    Feature("Observers", "Kalman filter", _exported("kalman", "torque_noise=0.1 drift=0.05")),
    Feature(
        "Observers",
        "generalised-momentum disturbance observer",
        _exported("momentum", "bandwidth_hz=10"),
    ),
    Feature(
        "Observers",
        "disturbance observer based on transfer functions",
        _exported("disturbance", "bandwidth_hz=10"),
    ),
)
LAWS = {
    "open_loop": "feed-forward of the reference torque",
    "integral_feedforward": "feed-forward with integral action",
    "pd+mass_dob": "feedback with a disturbance observer for a rotating mass",
    "pd": "torque PD",
    "pd+position_pd+reference": "torque PD with an outer position PD",
    "pd_feedforward": "PD with feed-forward",
    "pid_feedforward": "PID with feed-forward",
    "pd+torque": "PD with compensation of the spring torque",
    "pd+reference+inner_dob+friction": "PD with a disturbance observer of the open loop and "
    "friction feed-forward",
    "pid_inner_dob": "PID with the same observer and feed-forward",
    "pid_outer_dob": "PID with a disturbance observer of the closed loop",
    "lqi": "linear-quadratic state feedback",
    "observer_feedback": "state feedback by pole placement, with an observer",
    "passivity": "passivity-based torque control",
    "passivity_momentum": "the same with a momentum observer",
    "cascade": "an inner velocity loop (mentioned, not implemented in the toolbox)",
    "impedance": "impedance control (mentioned, not implemented in the toolbox)",
}
CONTROL = (
    *(
        Feature("Controllers", what, _simulated(f"{FIXED} --effect none --controller {name}"))
        for name, what in LAWS.items()
    ),
    Feature("Controllers", "a template for your own controllers",
            _simulated("--controller ./mylaw.py:MyLaw")),
    Feature("Controllers", "a comparison of controllers",
            f"cjt-gym benchmark --joint orange_80_6000 {FIXED} --controller pd_feedforward lqg "
            "--task step --episodes 2 --out compared", slow=True),
    Feature("Hardware", "target code generated from a controller",
            f"cjt-gym export pd_feedforward --to c --joint orange_80_6000 {FIXED} --out law.h",
            "C99 instead of Simulink Coder"),
    Feature("Hardware", "a controller on a real actuator, recorded",
            "cjt-gym hardware joint.toml --emulated --arm --controller pd_feedforward "
            "--reference step --duration 0.5 --out run.csv", "here on an emulated joint",
            slow=True),
    Feature("Hardware", "actuators on EtherCAT", "",
            "not supported: CAN only; see [differences](differences.md)"),
    Feature("Examples", "examples and a tour", "python examples/tour/02_linear.py",
            "see [examples](examples.md)", slow=True),
    Feature("Examples", "joints in models of whole robots (announced only)",
            'import gymnasium; gymnasium.make("CJT/Arm-v0").reset(seed=0)', slow=True),
)  # fmt: skip
FEATURES = (*MODELS, *ANALYSIS, *OBSERVERS, *CONTROL)
assert {name for name in LAWS if "+" not in name} <= set(CONTROLLERS)
