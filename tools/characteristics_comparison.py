"""The characteristics beside those of the MATLAB toolbox (`tests/golden`), row by row."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cjt_gym.characteristics import (
    CHARACTERISTICS,
    back_emf_limit,
    best_efficiency,
    characteristic,
    coulomb,
    efficiency,
    friction,
    highest_speed,
    resonance,
    speed_at_torque,
    steady_temperature,
    time_to_critical,
    torque_limits,
    viscous,
)
from cjt_gym.joint import JointParameters
from cjt_gym.joint.files.parameters import PARAMETERS
from tests.golden.loader import datasheet, datasheet_sets, oracle_parameters, oracle_sets, secondary

DROP = 10.0 ** (-3.0 / 20.0)
"""The toolbox divides torque amplitudes by 3 dB."""
Pair = tuple[ArrayLike, ArrayLike]


@dataclass(frozen=True)
class Row:
    """One quantity of both.

    Attributes:
        name: What is compared.
        pair: Returns ours and the toolbox's for a parameter set.
        reason: Why they differ; empty where they must agree.
        change: What the difference is: "relative" to the largest value, or the largest "factor".
    """

    name: str
    pair: Callable[[JointParameters], Pair]
    reason: str = ""
    change: str = "relative"

    def difference(self, p: JointParameters) -> float:
        """Return the difference for one parameter set, NaN where nothing can be compared."""
        ours, theirs = (np.atleast_1d(np.asarray(x, dtype=float)) for x in self.pair(p))
        finite = np.isfinite(ours) & np.isfinite(theirs)
        if not finite.any():
            return math.nan
        ours, theirs = ours[finite], theirs[finite]
        if self.change == "factor":
            both = (ours > 0.0) & (theirs > 0.0)
            return float(np.exp(np.max(np.abs(np.log(ours[both] / theirs[both])), initial=0.0)))
        scale = float(np.max(np.abs(theirs)))
        return float(np.max(np.abs(ours - theirs))) / (scale if scale > 0.0 else 1.0)

    def largest(self) -> float:
        """Return the largest difference over all parameter sets."""
        return float(np.nanmax([self.difference(parameters(name)) for name in datasheet_sets()]))


def parameters(name: str) -> JointParameters:
    """Return a golden parameter set, as far as characteristics need it."""
    values = {
        symbol: value
        for symbol, value in oracle_parameters(name).items()
        if symbol in PARAMETERS
        and not symbol.endswith("_n")
        and isinstance(value, int | float)
        and PARAMETERS[symbol].allows(value)
    }
    return JointParameters.from_values(name, values)


def secondary_differences() -> Iterator[tuple[str, float]]:
    """Yield the names of the toolbox's single figures, and how far ours are off at most."""
    for name in secondary(oracle_sets()[0]):
        if name in CHARACTERISTICS:
            off = [characteristic(parameters(s), name) / secondary(s)[name] for s in oracle_sets()]
            yield name, float(np.max(np.abs(np.array(off) - 1.0)))


def _golden(p: JointParameters, curve: str) -> np.ndarray:
    return np.asarray(datasheet(p.name, curve))


def _on_motor(p: JointParameters) -> JointParameters:
    """Return the same with all viscous friction on the motor, as the toolbox has it here."""
    return p.replace(d_m=viscous(p), d_g=0.0, d_l=0.0)


def _thermal(p: JointParameters, rated: bool) -> Pair:
    tau, golden = _golden(p, "thermal/tau"), _golden(p, "thermal/T_winding_steady")
    below = tau <= characteristic(p, "t_r")
    chosen = below if rated else ~below & (golden < 1083.0)
    return steady_temperature(p, tau[chosen]), golden[chosen]


def _hold(p: JointParameters) -> Pair:
    tau, golden = _golden(p, "thermal/tau"), _golden(p, "thermal/t_crit")
    return [time_to_critical(p, float(t)) for t in tau], golden


def _efficiency(p: JointParameters, same_friction: bool) -> Pair:
    tau = _golden(p, "efficiency/tau")
    dq = speed_at_torque(p, tau)
    golden = _golden(p, "efficiency/eta_percent")
    ours = 100.0 * efficiency(p, tau, dq)
    golden = np.where(golden > 0.0, golden, np.nan)
    if same_friction:
        lost = friction(p, dq) - characteristic(p, "t_NL")
        ours = ours + 100.0 * lost * dq / _golden(p, "efficiency/P_el").clip(1e-9)
    return ours, golden


def _loads(p: JointParameters) -> Pair:
    f, levels = _golden(p, "bandwidth_load/f_hz"), _golden(p, "bandwidth_load/log10_Il_over_I")
    inertia = p.I_m + p.I_g
    ours = [torque_limits(_on_motor(p), f, inertia * 10.0**x).current for x in levels]
    return np.array(ours) / DROP, _golden(p, "bandwidth_load/torque")


def _locked(p: JointParameters, kind: str) -> Pair:
    limits = torque_limits(_on_motor(p), _golden(p, "bandwidth_locked/f_hz"))
    ours = limits.current if kind == "peak" else limits.continuous / math.sqrt(2.0)
    return ours / DROP, _golden(p, f"bandwidth_locked/{kind}_amplitude")


def _feasible(p: JointParameters) -> Pair:
    golden = _golden(p, "bandwidth_locked/feasibility_limit")
    f = _golden(p, "bandwidth_locked/f_hz")
    if golden.size == 0:
        return np.nan, np.nan
    return torque_limits(p, f).peak / DROP, golden


def _bounded(p: JointParameters, continuous: bool) -> Pair:
    curve = "maxContSpeed" if continuous else "maxPeakSpeed"
    tau = _golden(p, "speed_limits/tau")
    return highest_speed(p, tau, continuous=continuous), _golden(p, f"speed_limits/{curve}")


def _points(p: JointParameters) -> Pair:
    value = {name: characteristic(p, name) for name in ("t_r", "dq_r", "t_NL", "dq_NL", "t_p")}
    ours = [value["t_r"], value["dq_r"], value["t_NL"], value["dq_NL"], value["t_p"]]
    names = ("rated_point", "noload_point", "peak_point")
    golden = np.concatenate([_golden(p, f"torque_speed/{name}") for name in names])
    return [*ours, float(speed_at_torque(p, value["t_p"]))], golden


def _less_friction(p: JointParameters) -> Pair:
    dq = _golden(p, "torque_speed_minus_friction/speed")
    tau = (characteristic(p, "dq_0") - dq) / characteristic(p, "dq_over_dm")
    return tau - friction(p, dq), _golden(p, "torque_speed_minus_friction/tau")


def _friction(p: JointParameters) -> Pair:
    dq = _golden(p, "torque_speed/friction_speed")
    return coulomb(p) + viscous(p) * dq, _golden(p, "torque_speed/friction_tau")


ROWS = (
    Row("torque-speed line", lambda p: (
        speed_at_torque(p, _golden(p, "torque_speed/tau")), _golden(p, "torque_speed/speed"))),
    Row("rated, no-load and peak point", _points),
    Row("friction over speed", _friction),
    Row("torque-speed line less friction", _less_friction),
    Row("highest speed at a torque, peak", lambda p: _bounded(p, False)),
    Row("highest speed at a torque, continuous", lambda p: _bounded(p, True)),
    Row("steady temperature up to the rated torque", lambda p: _thermal(p, True)),
    Row("resonance, locked output", lambda p: (
        resonance(p), _golden(p, "bandwidth_locked/f0_hz"))),
    Row("torque over frequency and load inertia", _loads),
    Row("torque with locked output, peak current", lambda p: _locked(p, "peak")),
    Row("torque with locked output, rated current", lambda p: _locked(p, "rated")),
    Row("back-EMF limit", lambda p: (
        back_emf_limit(p, _golden(p, "bandwidth_locked/f_hz")) / DROP,
        _golden(p, "bandwidth_locked/backemf_limit"))),
    Row("efficiency at full voltage, its friction", lambda p: _efficiency(p, True)),
    Row("efficiency at full voltage", lambda p: _efficiency(p, False),
        "friction follows the speed; the toolbox keeps that of the no-load speed"),
    Row("largest efficiency", lambda p: (
        100.0 * best_efficiency(p), _golden(p, "efficiency/max_point")[1]),
        "over all torques and speeds; the toolbox looks at full voltage only"),
    Row("steady temperature beyond the rated torque", lambda p: _thermal(p, False),
        "the resistance keeps rising with temperature up to thermal runaway; the toolbox stops "
        "its rise at the rated torque", "factor"),
    Row("time to the highest temperature", _hold,
        "the winding warms through r_th1 first and the housing slowly after it; the toolbox "
        "warms both resistances with the winding's time constant", "factor"),
    Row("torque that is available, locked output", _feasible,
        "the least of all limits, with resistance and inductance; the toolbox follows the "
        "back-EMF below the resonance", "factor"),
)  # fmt: skip
"""All curves that both have; those with a reason differ."""
