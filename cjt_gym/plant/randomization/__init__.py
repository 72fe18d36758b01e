"""Randomised joints: from what a person writes to one `Variation` for each number.

Any base parameter ("k_b") and any scalar parameter of an active effect ("coulomb.d_cm") can vary.
A randomisation is a mapping of names to variations, the name of a preset, or both:

    {"k_b": (0.9, 1.1)}                          factors, drawn at each reset
    {"k_b": {"distribution": "normal", "mean": 1.0, "std": 0.05, "when": "once"}}
    "mild"                                       all base parameters and effects
    {"preset": "wide", "k_b": (0.5, 2.0), "I_m": None}

`mild` varies every base parameter in use by 10 % (by its tolerance where the joint file gives
one), the size of every active effect by 30 %, and makes delays up to a control step longer. `wide`
takes 0.7 to 1.4, 0 to 2, and two control steps. `identified` varies what the joint file gives a
95 % interval or a tolerance to, as a diagnosis of recordings writes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cjt_gym.errors import ConfigurationError, unknown_name
from cjt_gym.joint import Joint
from cjt_gym.plant.randomization.presets import PRESETS
from cjt_gym.plant.randomization.program import compile_plan
from cjt_gym.plant.randomization.target import find_target, variable_names
from cjt_gym.plant.randomization.variation import Variation, make_variation

__all__ = ["PRESETS", "Randomization", "Variation", "resolve_randomization", "variable_names"]

Randomization = Mapping[str, Any] | str | None


def resolve_randomization(
    joint: Joint, spec: Randomization, dt: float = 1e-3
) -> dict[str, Variation]:
    """Return every variation, fully spelt out and checked.

    Args:
        joint: The nominal joint.
        spec: None, the name of a preset, or a mapping of names to variations (see `Variation`),
            pairs of factors, or None to leave out what a preset varies; "preset" names one.
        dt: Control step [s].

    Raises:
        UnknownNameError: A preset, parameter or effect is not known.
        ConfigurationError: A variation is not valid, or a value could leave its domain.

    Example:
        >>> from cjt_gym import load_joint
        >>> joint = load_joint("orange_80_6000", "rigid", effects={})
        >>> resolve_randomization(joint, {"k_t": (0.9, 1.1)})["k_t"].span
        (0.9, 1.1)
    """
    if isinstance(spec, str):
        spec = {"preset": spec}
    if spec is not None and not isinstance(spec, Mapping):
        raise ConfigurationError(
            "randomization must be None, the name of a preset or a mapping of names to variations, "
            f"got {spec!r}."
        )
    given = dict(spec or {})
    name = given.pop("preset", None)
    if name is not None and name not in PRESETS:
        raise unknown_name("preset of randomization", str(name), PRESETS)
    variations = {} if name is None else PRESETS[name](joint, dt)
    for key, item in given.items():
        find_target(joint, key)
        if item is None:
            variations.pop(key, None)
        else:
            variations[key] = make_variation(key, item)
    compile_plan(joint, variations, dt)
    return variations
