"""Effects between the true values and what is measured."""

from __future__ import annotations

from functools import partial

from cjt_gym.joint.effects.row import EffectParameter, effect, number, per_channel
from cjt_gym.joint.effects.sources import CATALOGUE, RANDOM_WALK, TOOLBOX

_SAMPLING = f"{TOOLBOX}, section Noise, Quantization, and Delays"
_FILTERS = f"{TOOLBOX}, section Modeling (mechanical subsystem block)"
_FINE = {"i": 0.5, "q_m": 1e-3, "q_g": 1e-3, "q_l": 1e-3, "tau": 1.0}
_ENCODERS = {"q_m": 0.01, "q_g": 0.01, "q_l": 0.01}
_OTHERS = {"i": 1.0, "q_m": 0.1, "q_g": 0.1, "q_l": 0.1}


row = partial(effect, "sensing")

SENSING_EFFECTS = (
    row(
        "torque_gain",
        "The torque sensor's scale differs from one.",
        CATALOGUE,
        EffectParameter(
            "gain", "-", 1.0, 0.5, 2.0, "Reading per true torque", ("gain_tau",), typical=1.1
        ),
    ),
    row(
        "torque_bias",
        "The torque sensor's zero is off.",
        CATALOGUE,
        number("bias", "N m", 10.0, "Reading at no torque", "bias_tau", low=-10.0, typical=0.2),
    ),
    row(
        "torque_delay",
        "The torque sensor is late, on top of the delay of all channels.",
        _SAMPLING,
        number("delay", "s", 0.02, "Lateness of the torque sensor", "late_tau", typical=1.5e-3),
    ),
    row(
        "sensor_gain",
        "A channel's scale differs from one.",
        CATALOGUE,
        *per_channel(
            "gain",
            "Reading per true value",
            dict.fromkeys(_OTHERS, 2.0),
            {"i": 1.05},
            unit="-",
            neutral=1.0,
        ),
    ),
    row(
        "sensor_bias",
        "A channel's zero is off.",
        CATALOGUE,
        *per_channel("bias", "Zero", _OTHERS, {"i": 0.1, "q_m": 1e-3, "q_l": -1e-3}, signed=True),
    ),
    row(
        "channel_delay",
        "A channel is late by itself, in fractions of a sample.",
        _SAMPLING,
        *per_channel(
            "late", "Lateness", dict.fromkeys(_OTHERS, 0.02), {"i": 5e-4, "q_l": 1e-3}, unit="s"
        ),
    ),
    row(
        "measurement_delay",
        "All measurements arrive late.",
        _SAMPLING,
        number("delay", "s", 0.02, "Lateness of all channels", "measurement_delay", typical=1e-3),
    ),
    row(
        "noise",
        "White noise on a measured channel.",
        _SAMPLING,
        *per_channel(
            "noise",
            "Standard deviation per sample",
            _FINE,
            {"i": 0.02, "q_m": 1e-5, "q_g": 1e-5, "q_l": 1e-5, "tau": 0.05},
            sensor_key="noise",
        ),
    ),
    row(
        "drift",
        "The zero of a channel walks at random.",
        RANDOM_WALK,
        *per_channel(
            "drift",
            "Standard deviation after one second",
            _FINE,
            {"i": 0.01, "tau": 0.05},
            unit="{}/s^0.5",
        ),
    ),
    row(
        "quantization",
        "Finite resolution of a measured channel; b bits per turn are 2 pi / 2^b rad.",
        _SAMPLING,
        *per_channel(
            "resolution",
            "Step",
            _FINE,
            {"i": 0.01, "q_m": 1.2e-5, "q_g": 1.2e-5, "q_l": 2.4e-5, "tau": 0.05},
            sensor_key="resolution",
        ),
    ),
    row(
        "eccentricity",
        "An encoder's disc runs off centre: e sin(f q + phase), once per turn of its shaft.",
        "Geometry of a disc whose centre is off its axis",
        *per_channel("eccentricity", "Amplitude", _ENCODERS, {"q_m": 1e-4, "q_l": 5e-4}),
        number(
            "phase",
            "rad",
            3.2,
            "Phase at q = 0",
            "eccentricity_phase",
            low=-3.2,
            default=0.0,
            typical=0.5,
        ),
        number(
            "turns",
            "1/rev",
            300.0,
            "Turns of the shaft of q_m per revolution; n where the encoder is on the rotor",
            "eccentricity_turns",
            low=1.0,
            joint_parameter="n",
            default=1.0,
            typical=1.0,
            typical_of="n",
        ),
        size=tuple(_ENCODERS),
    ),
    row(
        "dropout",
        "Frames are lost or repeated: the measurement before is reported again.",
        _SAMPLING,
        number(
            "probability",
            "-",
            1.0,
            "Share of frames that are lost",
            "dropout",
            maximum=1.0,
            typical=0.02,
        ),
    ),
    row(
        "velocity_differentiation",
        "Velocities are the filtered backward difference of the measured angles.",
        _FILTERS,
        number(
            "cutoff",
            "Hz",
            1e4,
            "Cut-off of the low pass; 0 is off",
            "velocity_cutoff",
            typical=100.0,
        ),
    ),
    row(
        "torque_filter",
        "The measured torque passes a first-order low pass.",
        _FILTERS,
        number(
            "cutoff", "Hz", 1e4, "Cut-off of the low pass; 0 is off", "torque_cutoff", typical=200.0
        ),
    ),
)
