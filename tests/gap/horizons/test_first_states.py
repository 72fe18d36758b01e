"""How long the states from which predictions start are smoothed."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap.horizons.prediction.case import make_case, sharp
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.gap.horizons.prediction.windows import relative
from cjt_gym.gap.horizons.selection.judge import judge
from cjt_gym.joint import Joint, get_structure
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.records import Record
from tests.gap.horizons.rotor import datasheet
from tests.gap.test_rough_logs import DT, TRUE, nominal

HELD = get_structure("output_fixed_rigid_gearbox")
SOONEST = ("q_m", 0.02)
DRY = 3.0


def dry_joint() -> Joint:
    effects = resolve_effects({"coulomb": {"d_cm": DRY}}, nominal(), HELD, "current")
    return quiet(Joint(nominal(), HELD.name, "current", effects))


def record(noise: float) -> Record:
    """Return a held joint that sticks and slips, its angle with noise [rad]."""
    t, rng = DT * np.arange(10_000), np.random.default_rng(3)
    amps = 1.5 * np.sin(2.0 * np.pi * 1.3 * t) + np.sin(2.0 * np.pi * (2.0 + 1.1 * t) * t)
    made = dry_joint().simulate(amps * TRUE["k_t"] * TRUE["n"], dt=DT)
    q_m = made["true_q_m"] + rng.normal(0.0, noise, len(t))
    columns = {"t": t, "i_cmd": amps, "q_m": q_m}
    return Record(columns, {"t": "s", "i_cmd": "A", "q_m": "rad"}, structure=HELD.name)


def test_turns_of_a_speed_that_an_angle_resolves_are_not_smoothed_away() -> None:
    case = make_case([record(1e-7)], [], nominal(), HELD)
    sharper = sharp(case, [case.joint])
    before, after = (relative(c.test, c.test.errors(dry_joint()))[SOONEST] for c in (case, sharper))
    assert after < 0.5 * before
    assert np.array_equal(case.logs[0].speed, sharper.logs[0].speed), "regressions stay the same"


def test_the_noise_of_a_coarse_angle_is_filtered() -> None:
    case = make_case([record(1e-4)], [], nominal(), HELD)
    sharper = sharp(case, [case.joint, dry_joint()])
    before, after = (relative(c.test, c.test.errors(dry_joint()))[SOONEST] for c in (case, sharper))
    assert after < 0.9 * before
    assert sharper.logs[0].filtered
    assert np.array_equal(case.logs[0].first, sharper.logs[0].first)


@pytest.mark.parametrize(("steps", "smoothed"), [(48, True), (8192, False)])
def test_the_speed_of_an_angle_in_coarse_steps_is_smoothed_for_longer(
    steps: int, *, smoothed: bool
) -> None:
    """A wheel with hall sensors: a step of its angle is as large as its motion in a window."""
    joint = Joint(datasheet(1.0), "rigid", "current", {})
    t = 5e-3 * np.arange(4000)
    amps = 0.5 * np.sign(np.sin(0.9 * t)) + 0.2
    made = joint.simulate(amps, dt=5e-3)["true_q_m"]
    step = 2.0 * np.pi / steps
    columns = {"t": t, "i": amps, "q_m": step * np.round(made / step)}
    told = Record(columns, {"t": "s", "i": "A", "q_m": "rad"}, structure="rigid")
    case = make_case([told], [], datasheet(1.0), get_structure("rigid"))
    calmer = sharp(case, [case.joint])
    before, after = (relative(c.test, c.test.errors(joint))["q_m", 0.5] for c in (case, calmer))
    assert (after < 0.3 * before) == smoothed


@pytest.mark.slow
@pytest.mark.parametrize("noise", [1e-5, 1e-3])
def test_the_true_joint_is_the_answer_however_its_angle_was_measured(noise: float) -> None:
    case = make_case([record(noise)], [], nominal(), HELD)
    assert judge(case, dry_joint(), lambda _: None, ["coulomb"]).answer == "stages"


def test_a_slow_log_starts_from_what_the_joint_says_between_its_rows() -> None:
    """At 100 Hz the slope over three rows is that of two commands."""
    t = 0.01 * np.arange(1200)
    amps = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 600), 2)
    joint = Joint(datasheet(1.0), "rigid", "current", {})
    made = joint.simulate(amps * joint.parameters.k_t * joint.parameters.n, dt=0.01)
    columns = {"t": t, "i_cmd": amps, "q_m": made["true_q_m"]}
    units = {"t": "s", "i_cmd": "A", "q_m": "rad"}
    seen = Record(columns, units, structure="rigid")
    case = make_case([seen], [], joint.file, get_structure("rigid"))
    better = sharp(case, [case.joint])
    before, after = (relative(c.test, c.test.errors(case.joint))[SOONEST] for c in (case, better))
    assert before > 0.1
    assert after < 0.01


@pytest.mark.slow
def test_a_slow_log_without_an_angle_is_judged() -> None:
    full = record(0.0)
    tau = dry_joint().parameters.k_b * full["q_m"]
    columns = {"t": full["t"], "i_cmd": full["i_cmd"], "tau": tau}
    slow = {name: x[::5] for name, x in columns.items()}
    seen = Record(slow, {"t": "s", "i_cmd": "A", "tau": "N m"}, structure=HELD.name)
    case = make_case([seen], [], nominal(), HELD)
    rows = judge(case, dry_joint(), lambda _: None, ["coulomb"]).rows
    assert {row.channel for row in rows} == {"tau"}
    assert all(np.isfinite(row.found) for row in rows)
