"""A run in which a program decides at every sample is the run that the simulator does by itself."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.blind import draw_case
from cjt_gym.blind.control import Gains
from cjt_gym.blind.plant import CHANNELS
from cjt_gym.blind.run import draw_chances, run
from cjt_gym.errors import ConfigurationError
from experiments.loop.live import Live

SAMPLES = 120


@pytest.mark.parametrize(
    ("structure", "effects"),
    [
        ("output_fixed_rigid_gearbox", ["command_delay", "torque_delay"]),
        ("full_dynamics", ["backlash", "coulomb:motor"]),
        ("rigid", ["cogging"]),
    ],
)
def test_same_commands_give_the_same_run(structure: str, effects: list[str]) -> None:
    world = draw_case(4, structure=structure, effects=effects, duration=2.0).world
    current = 2.0 * np.sin(2.0 * np.pi * 8.0 * np.arange(SAMPLES) * 1e-3)
    whole = run(world, current, Gains(), draw_chances(world, SAMPLES, np.random.default_rng(9)))
    live = Live(world, SAMPLES, seed=9)
    seen = [live.sample] + [live.step(i) for i in current[:-1]]
    found = np.array([[sample.measured[name] for name in CHANNELS] for sample in seen])
    np.testing.assert_array_equal(found, whole.measured)
    if effects[0] == "cogging":
        clean = whole.clean[:, CHANNELS.index("tau")]
        np.testing.assert_allclose([sample.tau for sample in seen], clean, atol=1e-12)


def test_true_torque_knows_nothing_of_the_sensor() -> None:
    case = draw_case(5, structure="output_fixed", effects=["torque_gain"], duration=2.0)
    live = Live(case.world, SAMPLES)
    for _ in range(SAMPLES - 1):
        live.step(3.0)
    gain = case.label["parameters"]["torque_gain"]["gain"]
    noise = 10.0 * max(case.sheet.noise[-1], case.sheet.resolution[-1]) + 0.2
    assert abs(live.sample.measured["tau"] - gain * live.sample.tau) < noise
    with pytest.raises(ConfigurationError, match=f"ends after {SAMPLES} samples"):
        live.step(0.0)


def test_cases_of_one_joint_share_its_datasheet_and_hide_different_things() -> None:
    cases = [
        draw_case(seed, joint=7, structure="output_fixed", effects=[name], duration=2.0)
        for seed, name in ((1, "coulomb"), (2, "stiffness"))
    ]
    assert cases[0].sheet == cases[1].sheet
    assert cases[0].label["true"]["I_m"] == cases[1].label["true"]["I_m"]
    assert cases[0].label["true"]["k_b"] != cases[1].label["true"]["k_b"]
