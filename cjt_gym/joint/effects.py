"""The effect table: everything that separates a real joint from the linear one.

One row per effect. From this table come the options of the environments, the names that can
be randomised, the candidates of a diagnosis, the documentation and the contract tests. An
effect is one row here and one term in the kernel; `fields` name the kernel's parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

STAGES = ("drive", "motor", "transmission", "sensing", "load")
TOOLBOX = "Malzahn, Roozing, Tsagarakis, The Compliant Joint Toolbox for MATLAB"


@dataclass(frozen=True)
class EffectParameter:
    """One number (or series of numbers) of an effect.

    Attributes:
        symbol: Its name.
        unit: SI unit on the link side of a rotary joint.
        neutral: The value at which the effect is off; None where that is the value of
            `relative_to`.
        low: Low end of the plausible range.
        high: High end of the plausible range.
        description: What it is.
        fields: Kernel parameters that it sets.
        joint_parameter: Parameter or `sensors.<channel>.<key>` of the joint file it defaults to.
        default: Value where neither the user nor the joint file gives one; None asks for it.
        relative_to: Kernel parameter that is subtracted from it.
        series: Whether it is a series of numbers.
    """

    symbol: str
    unit: str
    neutral: float | None
    low: float
    high: float
    description: str
    fields: tuple[str, ...] = ()
    joint_parameter: str | None = None
    default: float | None = None
    relative_to: str | None = None
    series: bool = False


@dataclass(frozen=True)
class Effect:
    """One row of the table.

    Attributes:
        name: Its name in every interface.
        stage: Where it shows itself, one of `STAGES`.
        summary: One line of physics.
        source: Where that comes from.
        parameters: Its numbers.
        excludes: Effects that set the same kernel parameters.
    """

    name: str
    stage: str
    summary: str
    source: str
    parameters: tuple[EffectParameter, ...]
    excludes: tuple[str, ...] = ()

    @property
    def bodies(self) -> tuple[str, ...]:
        """Bodies on which it can act; empty where that is not a choice."""
        names = {"m": "motor", "g": "gear", "l": "load"}
        found = {p.symbol.removesuffix("_n")[-1] for p in self.parameters if _of_body(p)}
        return tuple(names[key] for key in "mgl" if key in found)

    @property
    def channels(self) -> tuple[str, ...]:
        """Measured channels on which it can act; empty where that is not a choice."""
        return tuple(p.symbol for p in self.parameters if p.symbol in CHANNEL_UNITS)

    def parameter(self, symbol: str) -> EffectParameter | None:
        """Return the parameter of that symbol, or None."""
        return next((p for p in self.parameters if p.symbol == symbol), None)


CHANNEL_UNITS = {"i": "A", "q_m": "rad", "q_g": "rad", "q_l": "rad", "tau": "N m"}
_CHANNEL_HIGH = {"i": 0.5, "q_m": 1e-3, "q_g": 1e-3, "q_l": 1e-3, "tau": 1.0}
_BODY_NAMES = {"m": "motor", "g": "gear", "l": "load"}


def _of_body(parameter: EffectParameter) -> bool:
    return parameter.symbol.removesuffix("_n") in {
        f"d_{c}{body}" for c in ("", "c") for body in "mgl"
    }


def body_of(symbol: str) -> str | None:
    """Return the body on which a friction parameter acts, or None."""
    core = symbol.removesuffix("_n")
    return _BODY_NAMES.get(core[-1]) if core[:-1] in ("d_", "d_c") else None


def _coulomb(asymmetric: bool) -> tuple[EffectParameter, ...]:
    rows = []
    for key, body in _BODY_NAMES.items():
        fields = (f"d_c{key}",) if asymmetric else (f"d_c{key}", f"d_c{key}_n")
        way = ", positive direction" if asymmetric else ""
        text = f"Coulomb level of the {body}{way}"
        rows.append(
            EffectParameter(
                f"d_c{key}", "N m", 0.0, 0.0, 20.0, text, fields, f"d_c{key}", default=0.0
            )
        )
        if asymmetric:
            text = f"Coulomb level of the {body}, negative direction"
            rows.append(
                EffectParameter(
                    f"d_c{key}_n",
                    "N m",
                    0.0,
                    0.0,
                    20.0,
                    text,
                    (f"d_c{key}_n",),
                    f"d_c{key}_n",
                    default=0.0,
                )
            )
    text = "Velocity over which the sign is smoothed; 0 is the sharp, set-valued law"
    rows.append(EffectParameter("dq_0", "rad/s", 0.002, 0.0, 0.05, text, ("dq_0",), default=0.002))
    return tuple(rows)


def _viscous() -> tuple[EffectParameter, ...]:
    return tuple(
        EffectParameter(
            f"d_{key}_n",
            "N m s/rad",
            None,
            0.0,
            50.0,
            f"Viscous damping of the {body} at negative velocity; neutral is d_{key}",
            (f"d_{key}_extra_n",),
            f"d_{key}_n",
            relative_to=f"d_{key}",
        )
        for key, body in _BODY_NAMES.items()
    )


def _ripple(unit: str, scale: str) -> tuple[EffectParameter, ...]:
    text = "Periods per revolution of q_m (the k-th harmonic of the rotor is n k)"
    return (
        EffectParameter("f", "1/rev", 0.0, 0.5, 10000.0, text, series=True),
        EffectParameter("a", unit, 0.0, -5.0, 5.0, "Amplitudes of cos(f q_m)", series=True),
        EffectParameter("b", unit, 0.0, -5.0, 5.0, "Amplitudes of sin(f q_m)", series=True),
        EffectParameter(
            "scale", "-", 0.0, 0.0, 2.0, "Factor on all amplitudes", (scale,), default=1.0
        ),
    )


def _per_channel(field: str, key: str, text: str) -> tuple[EffectParameter, ...]:
    return tuple(
        EffectParameter(
            channel,
            unit,
            0.0,
            0.0,
            _CHANNEL_HIGH[channel],
            f"{text} of {channel}",
            (f"{field}_{channel}",),
            f"sensors.{channel}.{key}",
            default=0.0,
        )
        for channel, unit in CHANNEL_UNITS.items()
    )


_COMMAND_DELAY = EffectParameter(
    "delay", "s", 0.0, 0.0, 0.02, "Dead time, to the nearest substep", ("command_delay",)
)
_COMMAND_RESOLUTION = EffectParameter(
    "resolution", "A", 0.0, 0.0, 0.5, "Step of the command (V in voltage)", ("command_resolution",)
)
_COMMAND_NOISE = EffectParameter(
    "std", "N m", 0.0, 0.0, 1.0, "Standard deviation per control step", ("command_noise",)
)
_TORQUE_OFFSET = EffectParameter(
    "torque", "N m", 0.0, -5.0, 5.0, "Constant torque on the motor", ("torque_offset",)
)
_MEASUREMENT_DELAY = EffectParameter(
    "delay", "s", 0.0, 0.0, 0.02, "Lateness of all channels", ("measurement_delay",)
)
_TORQUE_DELAY = EffectParameter(
    "delay", "s", 0.0, 0.0, 0.02, "Lateness of the torque sensor", ("torque_delay",)
)
_VELOCITY_CUTOFF = EffectParameter(
    "cutoff", "Hz", 0.0, 10.0, 1e4, "Cut-off of the low pass; 0 is off", ("velocity_cutoff",)
)
_TORQUE_CUTOFF = EffectParameter(
    "cutoff", "Hz", 0.0, 10.0, 1e4, "Cut-off of the low pass; 0 is off", ("torque_cutoff",)
)

EFFECTS: dict[str, Effect] = {
    row.name: row
    for row in (
        Effect(
            "command_delay",
            "drive",
            "Dead time between the command and the current.",
            f"{TOOLBOX}, section Noise, Quantization, and Delays",
            (_COMMAND_DELAY,),
        ),
        Effect(
            "command_quantization",
            "drive",
            "The command has a finite resolution; values are rounded to the nearest step.",
            f"{TOOLBOX}, section Noise, Quantization, and Delays",
            (_COMMAND_RESOLUTION,),
        ),
        Effect(
            "command_noise",
            "drive",
            "White noise on the motor torque, held over a control step.",
            f"{TOOLBOX}, section Noise, Quantization, and Delays",
            (_COMMAND_NOISE,),
        ),
        Effect(
            "torque_offset",
            "motor",
            "A constant torque: offset of the amplifier or of the current sensor.",
            "Janot, Gautier, Brunot (2019), Data Set and Reference Models of EMPS",
            (_TORQUE_OFFSET,),
        ),
        Effect(
            "coulomb",
            "motor",
            "Coulomb friction, -d_c tanh(dq / dq_0), equal in both directions.",
            f"{TOOLBOX}, section Nonlinear Dynamics",
            _coulomb(asymmetric=False),
            excludes=("coulomb_asym",),
        ),
        Effect(
            "coulomb_asym",
            "motor",
            "Coulomb friction whose level differs between the two directions.",
            f"{TOOLBOX}, section Nonlinear Dynamics",
            _coulomb(asymmetric=True),
            excludes=("coulomb",),
        ),
        Effect(
            "viscous_asym",
            "motor",
            "Viscous friction with another coefficient at negative velocity.",
            f"{TOOLBOX}, section Nonlinear Dynamics",
            _viscous(),
        ),
        Effect(
            "cogging",
            "motor",
            "Torque periodic in the rotor angle: sum_j a_j cos(f_j q_m) + b_j sin(f_j q_m).",
            f"{TOOLBOX}, section Torque Ripple (type 1)",
            _ripple("N m", "cogging_scale"),
        ),
        Effect(
            "gear_ripple",
            "motor",
            "The same series times the transmitted torque: the meshing of teeth.",
            f"{TOOLBOX}, section Torque Ripple (type 2)",
            _ripple("-", "gear_ripple_scale"),
        ),
        Effect(
            "noise",
            "sensing",
            "White noise on a measured channel.",
            f"{TOOLBOX}, section Noise, Quantization, and Delays",
            _per_channel("noise", "noise", "Standard deviation per sample"),
        ),
        Effect(
            "quantization",
            "sensing",
            "Finite resolution of a measured channel; b bits per turn are 2 pi / 2^b rad.",
            f"{TOOLBOX}, section Noise, Quantization, and Delays",
            _per_channel("resolution", "resolution", "Step"),
        ),
        Effect(
            "measurement_delay",
            "sensing",
            "All measurements arrive late.",
            f"{TOOLBOX}, section Noise, Quantization, and Delays",
            (_MEASUREMENT_DELAY,),
        ),
        Effect(
            "torque_delay",
            "sensing",
            "The torque sensor is late, on top of the delay of all channels.",
            f"{TOOLBOX}, section Noise, Quantization, and Delays",
            (_TORQUE_DELAY,),
        ),
        Effect(
            "velocity_differentiation",
            "sensing",
            "Velocities are the filtered backward difference of the measured angles.",
            f"{TOOLBOX}, section Modeling (mechanical subsystem block)",
            (_VELOCITY_CUTOFF,),
        ),
        Effect(
            "torque_filter",
            "sensing",
            "The measured torque passes a first-order low pass.",
            f"{TOOLBOX}, section Modeling (mechanical subsystem block)",
            (_TORQUE_CUTOFF,),
        ),
    )
}
