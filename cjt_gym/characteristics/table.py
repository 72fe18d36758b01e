"""The table of characteristics: every quantity with its name, symbol, unit, formula and function.

Names are those of the Compliant Joint Toolbox where it has the quantity. Symbols and formulas are
plain text in which an underscore begins an index: k_t n i_c.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from cjt_gym.characteristics import bandwidth, motor, thermal
from cjt_gym.errors import ParameterError, check_name
from cjt_gym.joint import JointParameters, linear
from cjt_gym.joint.files.parameter_table import axis_units

GROUPS = ("constants", "rated", "no load", "stall", "peak", "heat", "dynamics")
STEP = 1e-4
"""Share of a parameter by which it is moved to see what its tolerance does."""
FOREVER = "for ever: the winding does not reach its limit"
_PRISMATIC = {
    "N m/W^0.5": "N/W^0.5",
    "rad/(s V)": "m/(s V)",
    "rad/(s N m)": "m/(s N)",
}


@dataclass(frozen=True)
class Characteristic:
    """One row of the table.

    Attributes:
        name: Its name in every interface.
        group: One of `GROUPS`.
        title: What it is, in a few words.
        symbol: How it is written.
        rotary_unit: Unit on a rotary axis.
        formula: How it follows from parameters and other rows.
        text: What it says to a user of the joint.
        function: Computes it.
        infinite: What it means where it is infinite; empty where it cannot be.
    """

    name: str
    group: str
    title: str
    symbol: str
    rotary_unit: str
    formula: str
    text: str
    function: Callable[[JointParameters], float]
    infinite: str = ""

    def unit(self, axis: str = "rotary") -> str:
        """Return the unit on that kind of axis."""
        if axis == "rotary":
            return self.rotary_unit
        return _PRISMATIC.get(self.rotary_unit, axis_units(self.rotary_unit, axis)[0])

    def value(self, p: JointParameters) -> float | None:
        """Return the value [unit], or None where the joint lacks a parameter that it needs."""
        try:
            return self.function(p)
        except ParameterError:
            return None

    def tolerance(self, p: JointParameters) -> float | None:
        """Return one sigma of the value [unit] from the tolerances of the parameters.

        The parameters are taken as independent and the quantity as linear in them.

        Returns:
            The standard deviation; None where no parameter that matters has a tolerance, or where
            the value is not finite.
        """
        value, variance = self.value(p), 0.0
        if value is None or not math.isfinite(value):
            return None
        for symbol, quantity in p.quantities.items():
            if quantity.tolerance and quantity.number:
                moved = self.value(p.replace(**{symbol: quantity.number * (1.0 + STEP)}))
                if moved is not None:
                    variance += ((moved - value) / STEP * quantity.tolerance) ** 2
        return math.sqrt(variance) if variance > 0.0 else None


_ROWS = (
    Characteristic("k_w", "constants", "speed constant", "k_w", "rad/(s V)", "1 / k_t",
                   "Rotor speed per volt of back-EMF.",
                   lambda p: p.n / motor.torque_per_ampere(p)),
    Characteristic("k_m", "constants", "motor constant", "k_M", "N m/W^0.5", "k_t n / √r",
                   "Torque per root of copper loss: compares motors of any winding.",
                   lambda p: motor.torque_per_ampere(p) / math.sqrt(p.r)),
    Characteristic("dq_over_dm", "constants", "speed drop", "s", "rad/(s N m)", "r / (k_t n)²",
                   "How much slower the joint gets per torque at full voltage.", motor.speed_drop),
    Characteristic("T_mech", "constants", "mechanical time constant", "T_mech", "s",
                   "(I_m + I_g + I_l) s",
                   "Time to 63 % of the final speed after a step of voltage.",
                   lambda p: (p.I_m + p.get("I_g", 0.0) + p.get("I_l", 0.0)) * motor.speed_drop(p)),
    Characteristic("T_el", "constants", "electrical time constant", "T_el", "s", "l_a / r",
                   "Time to 63 % of the final current after a step of voltage.",
                   lambda p: p.l_a / p.r),
    Characteristic("dv", "constants", "viscous friction", "d_v", "N m s/rad", "d_m + d_g + d_l",
                   "All bodies together.", motor.viscous),
    Characteristic("Mc", "constants", "Coulomb friction", "τ_C", "N m", "d_cm + d_cg + d_cl",
                   "All bodies together, in motion; to break away may take more.", motor.coulomb),
    Characteristic("i_c", "rated", "rated current", "i_c", "A",
                   "√(ΔT / ((r_th1 + r_th2) r (1 + a_CU ΔT)))",
                   "Holds the winding at its highest temperature; ΔT is that over ambient.",
                   motor.continuous_current),
    Characteristic("t_r", "rated", "rated torque", "τ_r", "N m", "k_t n i_c",
                   "Continuous torque of the motor, friction included.", motor.rated_torque),
    Characteristic("dq_r", "rated", "rated speed", "ω_r", "rad/s", "ω_0 - s τ_r",
                   "Highest speed at the rated torque.", motor.rated_speed),
    Characteristic("p_cm", "rated", "rated mechanical power", "P_r", "W", "τ_r ω_r",
                   "At the motor, friction included.",
                   lambda p: motor.rated_torque(p) * motor.rated_speed(p)),
    Characteristic("p_ce", "rated", "rated electrical power", "P_r,el", "W", "v_0 i_c",
                   "From the supply at the rated point.",
                   lambda p: p.v_0 * motor.continuous_current(p)),
    Characteristic("dq_0", "no load", "zero-torque speed", "ω_0", "rad/s", "v_0 / (k_t n)",
                   "Where the back-EMF is the supply; no friction.", motor.zero_torque_speed),
    Characteristic("dq_NL", "no load", "no-load speed", "ω_NL", "rad/s",
                   "(ω_0 - s τ_C) / (1 + s d_v)",
                   "Highest speed with nothing attached, whatever $ω_p$.",
                   motor.no_load_speed),
    Characteristic("t_NL", "no load", "no-load torque", "τ_NL", "N m", "τ_C + d_v ω_NL",
                   "Friction at that speed.", motor.no_load_torque),
    Characteristic("i_NL", "no load", "no-load current", "i_NL", "A", "τ_NL / (k_t n)",
                   "Current at that speed.",
                   lambda p: motor.no_load_torque(p) / motor.torque_per_ampere(p)),
    Characteristic("i_start", "stall", "starting current", "i_start", "A", "v_0 / r",
                   "At rest and full voltage, if not limited to $i_p$.", motor.starting_current),
    Characteristic("t_stall", "stall", "stall torque", "τ_stall", "N m", "k_t n i_start",
                   "Torque of that current: end of the torque-speed line.", motor.stall_torque),
    Characteristic("t_p", "peak", "peak torque", "τ_p", "N m", "k_t n i_p",
                   "Torque of the peak current, for a short while.", motor.peak_torque),
    Characteristic("p_pm", "peak", "peak mechanical power", "P_p", "W",
                   "τ (ω_0 - s τ), τ = min(τ_p, τ_stall / 2)",
                   "Largest power on the torque-speed line, whatever $ω_p$.",
                   motor.peak_mechanical_power),
    Characteristic("p_pe", "peak", "peak electrical power", "P_p,el", "W", "v_0 i_p",
                   "From the supply at peak current and full voltage.",
                   lambda p: p.v_0 * p.i_p),
    Characteristic("eta_max", "peak", "largest efficiency", "η_max", "%",
                   "max (τ - τ_C - d_v ω) ω / (r i² + τ ω)",
                   "Over all torques and speeds that supply and peak current allow; motoring.",
                   lambda p: 100.0 * motor.best_efficiency(p)),
    Characteristic("T_ss_p", "heat", "steady temperature at peak torque", "T_∞(τ_p)", "degC",
                   "T_A + R P / (1 - a_CU R P), P = r i_p²",
                   "Where the winding would end.",
                   lambda p: float(thermal.steady_temperature(p, motor.peak_torque(p))),
                   "there is none: the resistance rises faster than heat leaves, until it burns"),
    Characteristic("t_hold_cold", "heat", "peak torque from cold", "t_hold", "s",
                   "two-stage model, from T_A", "How long peak torque can be held from ambient.",
                   lambda p: thermal.time_to_critical(p, motor.peak_torque(p)), FOREVER),
    Characteristic("t_hold_warm", "heat", "peak torque from half warm", "t_hold,½", "s",
                   "two-stage model, from (T_A + T_max) / 2",
                   "Likewise with the winding half-way to its limit for long.",
                   lambda p: thermal.time_to_critical(
                       p, motor.peak_torque(p), 0.5 * (p.Tmp_ANom + p.Tmp_WMax)), FOREVER),
    Characteristic("f_0", "dynamics", "resonance, locked output", "f_0", "Hz",
                   "√(k_b / (I_m + I_g)) / 2π", "Undamped, with a rigid gearbox.",
                   linear.resonance),
    Characteristic("f_p", "dynamics", "bandwidth of the peak torque", "f_p", "Hz",
                   "highest f with all short-time limits ≥ τ_p",
                   "Locked output; up to it the joint delivers the peak torque.",
                   lambda p: bandwidth.torque_bandwidth(p, motor.peak_torque(p))),
    Characteristic("f_r", "dynamics", "bandwidth of the rated torque", "f_r", "Hz",
                   "highest f with all limits ≥ τ_r",
                   "Locked output; up to it the joint delivers the rated torque continuously.",
                   lambda p: bandwidth.torque_bandwidth(p, motor.rated_torque(p), lasting=True)),
)  # fmt: skip

CHARACTERISTICS: Mapping[str, Characteristic] = MappingProxyType({row.name: row for row in _ROWS})


def characteristics(p: JointParameters) -> dict[str, float]:
    """Return all characteristics of a joint that its parameters allow, by name.

    Example:
        >>> from cjt_gym.joint import load_joint_file
        >>> values = characteristics(load_joint_file("orange_80_6000").parameters)
        >>> round(values["t_r"], 3), round(values["dq_NL"], 3)
        (17.177, 7.509)
    """
    values = {name: row.value(p) for name, row in CHARACTERISTICS.items()}
    return {name: value for name, value in values.items() if value is not None}


def characteristic(p: JointParameters, name: str) -> float:
    """Return one characteristic of a joint [unit of its row].

    Raises:
        UnknownNameError: The name is unknown.
        ParameterError: The joint lacks a parameter that it needs.
    """
    check_name("characteristic", name, CHARACTERISTICS)
    return CHARACTERISTICS[name].function(p)
