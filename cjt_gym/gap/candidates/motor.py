"""Candidates of the motor stage, without dry friction."""

from __future__ import annotations

from cjt_gym.gap.candidates.candidate import Candidate, Scales, Values
from cjt_gym.gap.candidates.friction import damping_of
from cjt_gym.gap.candidates.nuisances import active_parameters, guesses_of
from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.candidates.released import released
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting


def motor_rows(setting: Setting, size: Scales) -> list[Candidate]:
    """Return the candidates of the motor, without dry friction."""
    active = active_parameters(setting)
    rows = [released(setting, "k_t", "torque_constant", "motor")]
    if not guesses_of(setting, "m"):  # a guess is free in every fit
        rows.append(released(setting, "I_m", "inertia", "motor"))
    if "I_g" in active and not guesses_of(setting, "g"):
        rows.append(released(setting, "I_g", "inertia", "motor"))
    rows += [damping_of(setting, size, body) for body in ("mg" if setting.has_gear else "m")]
    heat = Number("time_constant", "s", 5.0, 0.8, log=True, low=1.0, high=500.0, shape=True)
    derate = Number("loss", "1/A^2", 0.0, 0.3 / size.current**2, low=0.0)
    rows.append(
        Candidate(
            "thermal_derating",
            "motor",
            (derate, heat),
            lambda f, v: f.update(derate=v["loss"], heat=v["time_constant"]),
            ("motor",),
            starts=tuple((0.1 / size.current**2, tau) for tau in (2.0, 5.0, 15.0)),
            family="thermal",
        )
    )
    offset = Number("torque", "N m", 0.0, size.torque)
    rows.append(
        Candidate(
            "torque_offset",
            "motor",
            (offset,),
            lambda f, v: f.update(offset=f["offset"] + v["torque"]),
            ("motor",),
            starts=((0.0,),),
            family="offset",
        )
    )
    rows.append(_periodic("cogging", "cog", size.torque, "N m"))
    if setting.has_gear or setting.nominal["n"] != 1.0:  # a direct drive has no teeth
        rows.append(_periodic("gear_ripple", "rip", 1.0, "-"))
    return rows


def _periodic(name: str, prefix: str, scale: float, unit: str) -> Candidate:
    f = Number("f", "1/rev", 0.0, 1.0, low=0.0, prior=False, shape=True)
    a, b = (Number(symbol, unit, 0.0, scale) for symbol in "ab")

    def apply(fields: Fields, v: Values) -> None:
        fields[f"{prefix}_f"], fields[f"{prefix}_a"], fields[f"{prefix}_b"] = v["f"], v["a"], v["b"]

    return Candidate(name, "motor", (f, a, b), apply, ("motor",), family="periodic", search=prefix)
