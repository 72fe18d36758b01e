"""Comparison of a diagnosis's numbers with the true ones.

Labels carry the symbols of the effect table and of joint files, and a number of a diagnosis with
the same symbol is compared as it is. Numbers that it gives in another form have a row in `FORMS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

Values = Mapping[str, float]
Label = Mapping[str, Any]

PHASES: Final = {"cogging": ("a", "b"), "gear_ripple": ("a", "b"), "gravity": ("a", "b")}
"""Amplitudes of cos and sin: their phases count from different zeros, so their size is compared."""
SUFFIX: Final = {"motor": "m", "gear": "g", "load": "l"}


def _level(values: Values, body: str) -> float:
    return values[f"d_c{body}"]


def _excess(label: Label, symbol: str) -> float:
    """Return the excess of a parameter over its datasheet if it appears as the motor's, else 0."""
    if label["structure"] in ("full_dynamics", "output_fixed"):
        return 0.0
    return float(label["true"][symbol] - label["stated"][symbol])


def _added(key: str) -> Callable[[Values, str, Label], float]:
    """Return a function for the damping added to the nominal one in one direction."""

    def added(values: Values, body: str, label: Label) -> float:
        of_gear = _excess(label, "d_g") if body == "m" else 0.0
        return values[key] - float(label["stated"][f"d_{body}"]) + of_gear

    return added


def _drag(values: Values, _body: str, label: Label) -> float:
    """Return the damping of the motor, including the gear's if they move together."""
    joined = label["structure"] not in ("full_dynamics", "output_fixed")
    return values["d_m"] + (float(label["true"]["d_g"]) if joined else 0.0)


FORMS: Final[dict[tuple[str, str], Callable[[Values, str, Label], float]]] = {
    ("current_saturation", "i_max"): lambda v, _b, _l: v["i_p"],
    ("stribeck", "d_s"): lambda v, b, _l: _level(v, b) + v[f"d_s{b}"],
    ("presliding", "z_s"): lambda v, b, _l: _level(v, b) / v[f"sigma_{b}"],
    ("load_friction", "mu"): lambda v, b, _l: v[f"mu_{b}"],
    ("backlash", "b"): lambda v, _b, _l: v["gap"],
    ("hardening", "c"): lambda v, _b, label: v["k_3"] / label["true"]["k_b"],
    ("spring_hysteresis", "h"): lambda v, _b, _l: v["tau_h"],
    ("inertia", "I_m"): lambda v, _b, label: v["I_m"] + _excess(label, "I_g"),
    ("damping", "d_m"): _drag,
    **{("viscous_asym", f"d_{b}{way}"): _added(f"d_{b}{way}") for b in "mgl" for way in ("", "_n")},
}
"""The true value of a number of a diagnosis, by effect and key, from the label's parameters, the
suffix of the body and the label."""


def compare(label: Label, effect: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the numbers of a named effect that can be compared, each with the true one.

    Returns:
        Rows with `effect`, `parameter`, `true`, `value`, `low`, `high` and whether the interval
        covers the true value, `covered`. Empty if the name or the place is wrong.
    """
    name = effect["name"]
    values = label["parameters"].get(name)
    place = label["places"].get(name)
    if values is None or place not in (None, effect.get("body"), effect.get("channel")):
        return []
    body = SUFFIX.get(place or "", "")
    rows = []
    for key, given in effect["parameters"].items():
        true = _true(name, key, values, body, label)
        if true is not None:
            rows.append(_row(name, key, true, given))
    both = [effect["parameters"].get(key) for key in PHASES.get(name, ())]
    if both and all(both):
        true = values["torque"] if "torque" in values else math.hypot(values["a"], values["b"])
        rows.append(_row(name, "amplitude", true, _size(*both)))
    return rows


def _true(name: str, key: str, values: Values, body: str, label: Label) -> float | None:
    if (name, key) in FORMS:
        return FORMS[name, key](values, body, label)
    if key in PHASES.get(name, ()) or key not in values:
        return None
    return values[key]


def _size(a: Mapping[str, float], b: Mapping[str, float]) -> dict[str, float]:
    """Return the amplitude of a cos + b sin and its interval, for independent errors."""
    size = math.hypot(a["value"], b["value"])
    halves = [0.5 * (x["high"] - x["low"]) * x["value"] for x in (a, b)]
    half = math.hypot(*halves) / size if size > 0.0 else 0.0
    return {"value": size, "low": size - half, "high": size + half}


def _row(name: str, key: str, true: float, given: Mapping[str, float]) -> dict[str, Any]:
    return {
        "effect": name,
        "parameter": key,
        "true": float(true),
        "value": given["value"],
        "low": given["low"],
        "high": given["high"],
        "covered": given["low"] <= true <= given["high"],
    }
