"""Effects between the command and the current."""

from __future__ import annotations

from functools import partial

from cjt_gym.joint.effects.row import effect, number, own_value
from cjt_gym.joint.effects.sources import CATALOGUE, TOOLBOX

_SAMPLING = f"{TOOLBOX}, section Noise, Quantization, and Delays"

row = partial(effect, "drive")

DRIVE_EFFECTS = (
    row(
        "command_delay",
        "Dead time between the command and the current, in fractions of a sample.",
        _SAMPLING,
        number(
            "delay", "s", 0.02, "Dead time, to the nearest substep", "command_delay", typical=1.5e-3
        ),
    ),
    row(
        "current_lag",
        "Finite bandwidth of the current loop: a first-order lag of the commanded current.",
        TOOLBOX + ", section Modeling (electrical subsystem)",
        number(
            "bandwidth",
            "Hz",
            5000.0,
            "Cut-off frequency of the loop; 0 is off (no lag)",
            "current_bandwidth",
            low=5.0,
            typical=300.0,
        ),
    ),
    row(
        "current_control",
        "A PI controller turns the commanded current into a voltage, at its own sample rate.",
        "Harnefors, Nee (1998), IEEE Transactions on Industry Applications 34(1)",
        number(
            "bandwidth",
            "Hz",
            5000.0,
            "Bandwidth of the loop; 0 is none (the voltage that would hold the current)",
            "loop_bandwidth",
            low=5.0,
            typical=500.0,
        ),
        number(
            "rate",
            "Hz",
            1e6,
            "Sample rate of the controller, to the nearest substep",
            "loop_rate",
            low=100.0,
            default=1e4,
        ),
        number(
            "r",
            "Ohm",
            1e3,
            "Winding resistance that the controller assumes",
            "loop_r",
            low=1e-4,
            joint_parameter="r",
            typical=1.0,
            typical_of="r",
        ),
        number(
            "l_a",
            "H",
            10.0,
            "Inductance that the controller assumes",
            "loop_l_a",
            joint_parameter="l_a",
            default=0.0,
            typical=1.0,
            typical_of="l_a",
        ),
        number(
            "k_t",
            "N m/A",
            1e3,
            "Torque per ampere that the controller assumes",
            "loop_k_t",
            low=1e-4,
            joint_parameter="k_t",
            typical=1.0,
            typical_of="k_t",
        ),
        size=("bandwidth",),
        needs="voltage",
    ),
    row(
        "current_saturation",
        "The current is limited below what the nominal model allows.",
        CATALOGUE,
        own_value(
            "i_p", "A", 0.1, 500.0, "Peak current that the drive really gives", 0.5, "current"
        ),
    ),
    row(
        "voltage_saturation",
        "The supply voltage sags below its nominal value.",
        CATALOGUE,
        own_value("v_0", "V", 1.0, 800.0, "Supply voltage that there really is", 0.8),
        needs="voltage",
    ),
    row(
        "current_rate_limit",
        "The drive slews the commanded current at a limited rate.",
        CATALOGUE,
        number(
            "rate",
            "A/s",
            1e6,
            "Largest rate; 0 is off (no limit)",
            "current_rate",
            low=10.0,
            typical=100.0,
            typical_of="current",
        ),
    ),
    row(
        "command_quantization",
        "The command has a finite resolution; values are rounded to the nearest step.",
        _SAMPLING,
        number(
            "resolution",
            "A",
            0.5,
            "Step of the command (V in voltage)",
            "command_resolution",
            typical=0.01,
        ),
    ),
    row(
        "command_noise",
        "White noise on the motor torque, held over a control step.",
        _SAMPLING,
        number(
            "std",
            "N m",
            1.0,
            "Standard deviation per control step",
            "command_noise",
            typical=1e-3,
            typical_of="torque",
        ),
    ),
)
