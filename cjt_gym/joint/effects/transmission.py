"""Effects between the motor and the load: gear and torsion bar."""

from __future__ import annotations

from functools import partial

from cjt_gym.joint.effects.row import EffectParameter, effect, number, own_value
from cjt_gym.joint.effects.sources import BOUC_WEN, CATALOGUE, MAXWELL_SLIP, NORDIN, TOOLBOX


def _stiffness(symbol: str, text: str, factor: float) -> EffectParameter:
    return own_value(symbol, "N m/rad", 10.0, 1e6, text, factor)


row = partial(effect, "transmission")

TRANSMISSION_EFFECTS = (
    row(
        "backlash",
        "Play in series with the gear's spring, or with the bar where the gear is rigid.",
        NORDIN,
        number("gap", "rad", 0.02, "Total play", "play_gap", typical=1e-3),
        number(
            "offset",
            "rad",
            0.02,
            "Deflection at the middle of the play",
            "play_offset",
            low=-0.02,
            default=0.0,
        ),
        size=("gap",),
        needs="spring",
    ),
    row(
        "stiffness",
        "The torsion bar's stiffness differs from nominal.",
        CATALOGUE,
        _stiffness("k_b", "Stiffness that the bar really has", 0.85),
        needs="bar",
    ),
    row(
        "gear_stiffness",
        "The gearbox's stiffness differs from nominal.",
        f"{CATALOGUE}; {TOOLBOX}, structures with a compliant gearbox",
        _stiffness("k_g", "Stiffness that the gearbox really has", 0.7),
        needs="gear",
    ),
    row(
        "hardening",
        "The torsion bar stiffens with deflection: k_b x + k_3 x^3.",
        "Duffing's spring",
        number("k_3", "N m/rad^3", 1e9, "Cubic stiffness", "k_3", typical=1e6),
        needs="bar",
    ),
    row(
        "spring_table",
        "The torsion bar's torque over its deflection by a table, in place of k_b.",
        "Fritsch, Butland (1984), SIAM Journal on Scientific and Statistical Computing 5(2)",
        number(
            "deflection",
            "rad",
            1.0,
            "Deflections of the points, rising; >= 0 alone count for both directions",
            low=-1.0,
            series=True,
            typical=(0.01, 0.03),
        ),
        number(
            "torque",
            "N m",
            5000.0,
            "Torques there, rising",
            low=-5000.0,
            series=True,
            typical=(0.3, 1.2),
            typical_of="torque",
        ),
        number("scale", "-", 2.0, "Common factor of the torques", "table_scale", default=1.0),
        size=("torque",),
        needs="bar",
    ),
    row(
        "spring_hysteresis",
        "The bar's torque depends on its past: Bouc-Wen, or Maxwell slip with several elements.",
        f"{BOUC_WEN}; {MAXWELL_SLIP}",
        number(
            "tau_h",
            "N m",
            20.0,
            "Half height of the large loop",
            "tau_h",
            typical=0.01,
            typical_of="torque",
        ),
        number(
            "delta_h",
            "rad",
            0.05,
            "Deflection over which a new loop rises to 63 %",
            "delta_h",
            low=1e-5,
            default=1e-3,
        ),
        number(
            "elements",
            "-",
            8.0,
            "Elements of the Maxwell slip model; 0 is Bouc-Wen",
            "slip_elements",
            default=0.0,
            maximum=8.0,
        ),
        size=("tau_h",),
        needs="bar",
    ),
)
