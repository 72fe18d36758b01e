"""Resonance frequencies of the joint, from its nominal values."""

from __future__ import annotations

from math import pi, sqrt

from cjt_gym.gap.check.view import View


def resonance(view: View) -> float:
    """Return the resonance frequency of the joint on its torsion bar [Hz]; 0 if unknown."""
    if not view.structure.has_spring:
        return 0.0
    motor = view.value("I_m") + view.value("I_g")
    load = float("inf") if view.structure.output_fixed else view.value("I_l")
    return _frequency(view.value("k_b"), motor, load)


def gear_resonance(view: View) -> float:
    """Return the resonance frequency of motor and gear on the gearbox [Hz]; 0 if unknown."""
    return _frequency(view.value("k_g"), view.value("I_m"), view.value("I_g"))


def _frequency(stiffness: float, one: float, other: float) -> float:
    if stiffness <= 0.0 or one <= 0.0 or other <= 0.0:
        return 0.0
    return sqrt(stiffness * (1.0 / one + 1.0 / other)) / (2.0 * pi)
