"""Effects between the command and the current."""

from __future__ import annotations

from cjt_gym.joint.effects.row import Effect, EffectParameter
from cjt_gym.joint.effects.sources import CATALOGUE, TOOLBOX

_SAMPLING = f"{TOOLBOX}, section Noise, Quantization, and Delays"

DRIVE_EFFECTS = (
    Effect(
        "command_delay",
        "drive",
        "Dead time between the command and the current, in fractions of a sample.",
        _SAMPLING,
        (
            EffectParameter(
                "delay",
                "s",
                0.0,
                0.0,
                0.02,
                "Dead time, to the nearest substep",
                ("command_delay",),
                typical=1.5e-3,
            ),
        ),
        size=("delay",),
    ),
    Effect(
        "current_lag",
        "drive",
        "Finite bandwidth of the current loop: a first-order lag of the commanded current.",
        TOOLBOX + ", section Modeling (electrical subsystem)",
        (
            EffectParameter(
                "bandwidth",
                "Hz",
                0.0,
                5.0,
                5000.0,
                "Cut-off frequency of the loop; 0 is off (no lag)",
                ("current_bandwidth",),
                typical=300.0,
            ),
        ),
        size=("bandwidth",),
    ),
    Effect(
        "current_saturation",
        "drive",
        "The current is limited below what the nominal model allows.",
        CATALOGUE,
        (
            EffectParameter(
                "i_p",
                "A",
                None,
                0.1,
                500.0,
                "Peak current that the drive really gives",
                ("i_p",),
                relative_to="i_p",
                typical=0.5,
                typical_of="current",
            ),
        ),
        size=("i_p",),
    ),
    Effect(
        "voltage_saturation",
        "drive",
        "The supply voltage sags below its nominal value.",
        CATALOGUE,
        (
            EffectParameter(
                "v_0",
                "V",
                None,
                1.0,
                800.0,
                "Supply voltage that there really is",
                ("v_0",),
                relative_to="v_0",
                typical=0.8,
                typical_of="v_0",
            ),
        ),
        size=("v_0",),
        needs="voltage",
    ),
    Effect(
        "current_rate_limit",
        "drive",
        "The drive slews the commanded current at a limited rate.",
        CATALOGUE,
        (
            EffectParameter(
                "rate",
                "A/s",
                0.0,
                10.0,
                1e6,
                "Largest rate; 0 is off (no limit)",
                ("current_rate",),
                typical=100.0,
                typical_of="current",
            ),
        ),
        size=("rate",),
    ),
    Effect(
        "command_quantization",
        "drive",
        "The command has a finite resolution; values are rounded to the nearest step.",
        _SAMPLING,
        (
            EffectParameter(
                "resolution",
                "A",
                0.0,
                0.0,
                0.5,
                "Step of the command (V in voltage)",
                ("command_resolution",),
                typical=0.01,
            ),
        ),
        size=("resolution",),
    ),
    Effect(
        "command_noise",
        "drive",
        "White noise on the motor torque, held over a control step.",
        _SAMPLING,
        (
            EffectParameter(
                "std",
                "N m",
                0.0,
                0.0,
                1.0,
                "Standard deviation per control step",
                ("command_noise",),
                typical=1e-3,
                typical_of="torque",
            ),
        ),
        size=("std",),
    ),
)
