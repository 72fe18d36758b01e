"""Comparison of a diagnosis's numbers with the true ones.

Labels carry the symbols of the effect table and of joint files, and a number of a diagnosis with
the same symbol is compared as it is. Numbers that it gives in another form have a row in `FORMS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from cjt_gym.blind.plant import STRUCTURES

Values = Mapping[str, float]
Label = Mapping[str, Any]

PHASES: Final = {"cogging": ("a", "b"), "gear_ripple": ("a", "b")}
"""Amplitudes of cos and sin: their phases count from different zeros, so their size is compared."""


def _excess(label: Label, symbol: str) -> float:
    """Return the excess of a parameter over its datasheet if it appears as the motor's, else 0."""
    if label["structure"] in ("full_dynamics", "output_fixed"):
        return 0.0
    return float(label["true"][symbol] - label["stated"][symbol])


def _drag(symbol: str) -> Callable[[Values, Label], float]:
    """Return a function for the damping of all bodies that move with the motor."""

    def drag(values: Values, label: Label) -> float:
        motor, *others, _ = STRUCTURES[label["structure"]].leads
        joined = [f"d_{b}" for b, lead in zip("gl", others, strict=True) if lead == motor]
        return values[symbol] + sum(float(label["true"][name]) for name in joined)

    return drag


FORMS: Final[dict[tuple[str, str], Callable[[Values, Label], float]]] = {
    ("thermal_derating", "T_thw"): lambda v, _: v["time_constant"],
    ("inertia", "I_m"): lambda v, label: v["I_m"] + _excess(label, "I_g"),
    ("damping", "d_m"): _drag("d_m"),
    ("viscous_asym", "d_m"): _drag("d_m"),
    ("viscous_asym", "d_m_n"): _drag("d_m_n"),
}
"""The true value of a number of a diagnosis, by effect and key, from the label's parameters and the
label."""


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
    rows = []
    for key, given in effect["parameters"].items():
        true = _true(name, key, values, label)
        if true is not None:
            rows.append(_row(name, key, true, given))
    both = [effect["parameters"].get(key) for key in PHASES.get(name, ())]
    if both and all(both):
        true = math.hypot(values["a"], values["b"])
        rows.append(_row(name, "amplitude", true, _size(*both)))
    return rows


def _true(name: str, key: str, values: Values, label: Label) -> float | None:
    if (name, key) in FORMS:
        return FORMS[name, key](values, label)
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
