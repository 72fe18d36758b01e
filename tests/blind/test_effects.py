"""Every effect of the two tables: it changes the log, and at no strength it changes nothing."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from cjt_gym.blind.control import Gains
from cjt_gym.blind.hidden import Draw
from cjt_gym.blind.joints import Datasheet, draw_joint
from cjt_gym.blind.known import KNOWN
from cjt_gym.blind.outside import OUTSIDE
from cjt_gym.blind.plant import STRUCTURES, World
from cjt_gym.blind.run import Run, draw_chances, run
from cjt_gym.blind.scales import Scales, scales_of
from tests.blind.joints import two_tones

ROWS = KNOWN | OUTSIDE
WHERE = [
    (name, structure, place)
    for name, effect in ROWS.items()
    for structure in STRUCTURES
    for place in effect.places(STRUCTURES[structure])
]
SAMPLES = 400
# fmt: off
CONTRACT = (
    "command_delay", "current_lag", "current_saturation", "command_quantization",
    "torque_constant", "thermal_derating", "torque_offset", "inertia", "damping", "coulomb",
    "coulomb_asym", "viscous_asym", "stribeck", "presliding", "load_friction", "cogging",
    "gear_ripple", "backlash", "stiffness", "gear_stiffness", "hardening", "spring_hysteresis",
    "torque_gain", "torque_bias", "torque_delay", "quantization", "noise", "load_inertia",
    "load_coulomb", "gravity",
)
# fmt: on


def driven(joint: World, sheet: Datasheet) -> Run:
    torque = 0.1 * sheet.values["k_t"] * sheet.values["n"] * sheet.i_p
    size = torque / (joint.plant.k_t * joint.plant.n) / 5.5
    chances = draw_chances(joint, SAMPLES, np.random.default_rng(2))
    return run(joint, two_tones(SAMPLES, size), Gains(limit=sheet.i_p), chances, fine_step=2e-5)


@functools.cache
def without(structure: str) -> tuple[World, Datasheet, Run, Scales]:
    joint, sheet = draw_joint(STRUCTURES[structure], np.random.default_rng(5))
    result = driven(joint, sheet)
    return joint, sheet, result, scales_of(joint, result)


def measured(name: str, structure: str, place: str, strength: float) -> np.ndarray:
    joint, sheet, _, scales = without(structure)
    draw = Draw(np.random.default_rng(3), scales, strength, place)
    changed, parameters = ROWS[name].apply(joint, draw)
    assert set(parameters) <= set(ROWS[name].units)
    return driven(changed, sheet).measured


@pytest.mark.parametrize(("name", "structure", "place"), WHERE)
def test_effect_changes_the_log_by_its_strength(name: str, structure: str, place: str) -> None:
    plain = without(structure)[2].measured
    assert not np.array_equal(measured(name, structure, place, 1.0), plain)
    np.testing.assert_allclose(measured(name, structure, place, 0.0), plain, rtol=0, atol=1e-9)


def test_table_is_the_contracts() -> None:
    assert sorted(KNOWN) == sorted(CONTRACT)
    assert not set(KNOWN) & set(OUTSIDE)


def test_every_effect_fits_a_structure() -> None:
    assert {name for name, _, _ in WHERE} == set(ROWS)
