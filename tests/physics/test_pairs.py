"""Every pair of effects that can act together: finite, repeatable, both at work, passive.

Each pair runs for 40 ms with typical values on a joint that moves, turns round and is loaded. A
pair whose effects only store or take energy is then left alone and may not gain any.
"""

from __future__ import annotations

import functools
import itertools
from typing import Any

import numpy as np
import pytest

from cjt_gym.joint import DRIVES, EFFECTS, STRUCTURES, Joint, load_joint
from tests.physics import cases
from tests.physics.cases import EPS, Effects, Floats, stiffness_number, traced

NAME = "orange_80_6000"
LOADED = {"I_l": 0.5}
MEASURED = ("i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
SHARED_DQ_0 = 0.002
SAMPLES, H = 40, 5e-4
# They put energy in by themselves, or hold a voltage against the motor's speed.
ACTIVE = {
    *("command_noise", "torque_offset", "cogging", "gear_ripple", "commutation_ripple"),
    *("current_offset", "human_torque", "load_motion"),
}
FAST = 7.0  # [rad/s], where the supply limits the current


@functools.cache
def typical(name: str) -> dict[str, Any]:
    values = cases.typical(EFFECTS[name])
    if "dq_0" in values:
        values["dq_0"] = SHARED_DQ_0
    if name == "contact":
        values |= {"position": -0.02, "damping": 0.1}
    if name == "viscous_asym":  # the typical value is also that of `damping`
        values["d_m_n"] *= 3.0
    if name == "thermal_derating":
        values["T_thw"] = 1.0
    return values


def place(one: str, other: str) -> tuple[str, str] | None:
    """Return a structure and a drive in which both act, if there is one."""
    rows = EFFECTS[one], EFFECTS[other]
    if other in rows[0].excludes or one in rows[1].excludes:
        return None
    for drive in DRIVES:
        for structure in STRUCTURES.values():
            if all(row.acts_in(structure, drive) for row in rows):
                return structure.name, drive
    return None


PAIRS = [pair for pair in itertools.combinations(EFFECTS, 2) if place(*pair) is not None]
APART = [pair for pair in itertools.combinations(EFFECTS, 2) if place(*pair) is None]


def made(effects: Effects, structure: str, drive: str) -> Joint:
    return load_joint(NAME, structure, drive, effects=effects, parameters=LOADED)


def substep(*names: str) -> float:
    """Return the substep [s] for these effects: a current controller samples every 0.1 ms."""
    return 1e-4 if "current_control" in names else H


def driven(joint: Joint, h: float, seed: int = 1) -> Floats:
    """Return what is measured while the joint is driven to its limits, shape (SAMPLES, 8)."""
    t = np.arange(SAMPLES) * 1e-3
    tau_m = 1.2 * joint.torque_limit * np.sign(np.sin(2 * np.pi * 60.0 * t + 0.1))
    tau_m = tau_m * np.where(t < 0.02, 1.0, 0.3)
    tau_m[0] = 0.0  # delay and rate limit begin with what is commanded first
    fixed = joint.structure_row.output_fixed
    load = (0.3 if fixed else 20.0) * np.cos(2 * np.pi * 40.0 * t)
    speed = -1.0  # against the first command: it turns round
    if joint.drive != "current":
        speed = FAST if fixed else -FAST
    x0 = [0.002, 0.001, 0.0, speed, speed, 0.0 if fixed else speed]
    record = joint.simulate(tau_m, load, dt_physics=h, seed=seed, x0=x0)
    return np.column_stack([record[name] for name in MEASURED])


@functools.cache
def alone(name: str, structure: str, drive: str, h: float) -> bytes:
    return driven(made({name: typical(name)}, structure, drive), h).tobytes()


def left_alone(joint: Joint, h: float) -> tuple[float, float]:
    """Return the largest gain of energy in a control step without input, and what is rounding."""
    fixed = joint.structure_row.output_fixed
    x0 = np.array([0.002, 0.001, 0.0, 1.0, -1.0, 0.0 if fixed else 0.5])
    energy = traced(joint, np.zeros(SAMPLES), h=h, x0=x0).energy
    allowed = 64.0 * EPS * max(1.0, stiffness_number(joint, h)) * energy[0]
    return float(np.diff(energy).max()), allowed


def check(one: str, other: str) -> None:
    structure, drive = place(one, other) or ("", "")
    effects = {one: typical(one), other: typical(other)}
    joint = made(effects, structure, drive)
    h = substep(one, other)
    both = driven(joint, h)
    assert np.isfinite(both).all(), (one, other)
    assert np.array_equal(both, driven(joint, h)), (one, other)
    for name, partner in ((one, other), (other, one)):
        lost = both.tobytes() == alone(name, structure, drive, h)
        assert not lost, f"{partner} is lost beside {name} in {structure} with {drive}"
    if not {one, other} & ACTIVE:
        gain, allowed = left_alone(joint, h)
        assert gain <= allowed, f"{one} with {other} gains {gain:g} J in {structure}"


@pytest.mark.parametrize("name", EFFECTS)
def test_pairs(name: str) -> None:
    """All pairs of an effect with those that come after it in the table."""
    for one, other in PAIRS:
        if one == name:
            check(one, other)


def test_all_pairs_are_there() -> None:
    """Only what excludes one another or lives in different structures is left out."""
    count = len(EFFECTS)
    assert len(PAIRS) + len(APART) == count * (count - 1) // 2
    for one, other in APART:
        rows = EFFECTS[one], EFFECTS[other]
        apart = {rows[0].needs, rows[1].needs} == {"free_load", "fixed_load"}
        assert apart or other in rows[0].excludes or one in rows[1].excludes
