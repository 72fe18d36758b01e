"""Cogging is read off the torque over the angle, where no prediction shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.findings.by_torque import told_by_torque
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.selection.judge import _misses_wave
from cjt_gym.gap.horizons.selection.judgement import Judgement
from cjt_gym.gap.horizons.torque.inverse import (
    seen_in_torque,
    spent,
)
from cjt_gym.gap.horizons.torque.over_angle import over_angle
from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.joint import Joint
from cjt_gym.records import Record
from tests.gap.horizons.arm import DT, held_record
from tests.gap.horizons.rotor import datasheet


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_cogging_is_read_off_the_torque_over_the_angle(arm: JointFile, seed: int) -> None:
    case = make_case([held_record(seed, cogging=1.5)], [], arm, get_structure("rigid"))
    found = seen_in_torque(case.joint, case.logs)["cogging"]
    f, a, b = found.values
    assert f == pytest.approx(60.0, abs=0.2)
    assert b == pytest.approx(1.5, rel=0.1)
    assert abs(a) < 0.4
    assert "cogging" not in seen_in_torque(case.joint, case.logs, ["cogging"])
    plain = make_case([held_record(seed)], [], arm, get_structure("rigid"))
    assert "cogging" not in seen_in_torque(plain.joint, plain.logs)


def test_a_joint_without_the_wave_that_the_torque_shows_needs_a_search(arm: JointFile) -> None:
    cogged, plain = (
        make_case([held_record(0, cogging=x)], [], arm, get_structure("rigid")) for x in (1.5, 0.0)
    )
    wave = {"cogging": {"f": 60.0, "a": 0.0, "b": 1.5}}
    assert _misses_wave(cogged, cogged.joint)
    assert not _misses_wave(cogged, Joint(arm, "rigid", "current", wave))
    assert not _misses_wave(plain, plain.joint)


def ramps(cogging: float) -> Record:
    """Return slow ramps of a light rotor by a PD controller, by a coarse and noisy encoder."""
    rng, h, count, mass = np.random.default_rng(0), 1e-4, 100_000, 0.036
    at = h * np.arange(count)
    wanted = np.abs((0.3 * at) % 2.0 - 1.0)
    q = speed = 0.0
    rows = []
    for k in range(count):
        if k % 10 == 0:
            slope = (wanted[min(k + 10, count - 1)] - wanted[k]) / (10.0 * h)
            torque = 30.0 * (wanted[k] - q) + 1.2 * (slope - speed)
            rows.append((at[k], q, torque))
        speed += h / mass * (torque - 0.04 * speed + cogging * np.sin(126.0 * q))
        q += h * speed
    t, angle, torques = np.array(rows).T
    angle = 4e-5 * np.round((angle + 2e-5 * rng.standard_normal(len(t))) / 4e-5)
    columns = {"t": t, "q_m": angle, "i": torques + 0.03 * rng.standard_normal(len(t))}
    return Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")


@pytest.mark.slow
def test_cogging_is_read_off_slow_ramps_though_the_acceleration_is_noise() -> None:
    """Smoothed over ten milliseconds it is, so that no regression of it shows the wave."""
    values = {"I_m": 0.03, "I_g": 0.0, "I_l": 0.0, "d_m": 0.04, "n": 1.0, "k_t": 1.0}
    sheet = JointFile(JointParameters.from_values("rotor", values))
    found = [
        over_angle(case.joint, case.logs)
        for case in (make_case([ramps(x)], [], sheet, get_structure("rigid")) for x in (0.3, 0.0))
    ]
    assert found[0] is not None
    assert found[0].values[0] == pytest.approx(126.0, abs=0.3)
    assert found[0].size == pytest.approx(0.3, rel=0.15)
    assert found[1] is None


@pytest.mark.slow
def test_cogging_that_a_controller_hides_is_named(arm: JointFile) -> None:
    found = diagnose(held_record(0, cogging=1.5), arm)
    effects = {effect.name: effect for effect in found.effects}
    assert effects["cogging"].parameters["f"].value == pytest.approx(60.0, abs=0.2)
    assert effects["cogging"].status == "tentative", "it may be a ripple of the gear"
    assert "gear_ripple" in effects["cogging"].confusable_with
    assert "coulomb" in effects


@pytest.mark.slow
def test_a_search_takes_cogging_that_the_torque_shows() -> None:
    """Where the motor moves freely, its own kernel predicts it better with the wave."""
    waves = {"f": (7.0,), "a": (0.0,), "b": (0.1,), "scale": 1.0}
    cogged = Joint(datasheet(1.0), "rigid", "current", {"cogging": waves})
    t = 2e-3 * np.arange(5000)
    torque = 0.35 * np.sin(2.0 * np.pi * 0.7 * t) + 0.25 * np.sin(2.0 * np.pi * 2.3 * t + 1.0)
    q = cogged.simulate(torque, dt=2e-3)["true_q_m"]
    record = Record(
        {"t": t, "q_m": q, "i": torque}, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid"
    )
    found = diagnose(record, datasheet(1.0))
    (effect,) = (effect for effect in found.effects if effect.name == "cogging")
    assert effect.parameters["b"].value == pytest.approx(0.1, rel=0.1)
    assert found.joint.effects["cogging"]


@pytest.mark.parametrize(("n", "alike"), [(100.0, ("gear_ripple",)), (1.0, ())])
def test_a_direct_drive_has_no_gear_whose_ripple_its_cogging_could_be(
    arm: JointFile, n: float, alike: tuple[str, ...]
) -> None:
    file = replace(arm, parameters=arm.parameters.replace(n=n, k_t=10.0 / n))
    case = make_case([held_record(0, 0.05, cogging=1.0)], [], file, get_structure("rigid"))
    seen = seen_in_torque(case.joint, case.logs)
    told = told_by_torque(Judgement(case, "found", case.joint, ()), seen, (), alone=True)
    assert [e.confusable_with for e in told if e.name == "cogging"] == [alike]


def test_a_fast_stretch_does_not_hide_cogging_of_a_slow_one(arm: JointFile) -> None:
    record = held_record(0, 0.05, cogging=1.0)
    columns = {name: record[name].copy() for name in ("t", "q_m", "i")}
    way, t = slice(0, 200), record.t[:200]
    columns["q_m"][way] = 0.2 * np.sin(12.0 * t)  # far faster than the rest, without its torque
    columns["i"][way] = 0.0
    case = make_case([Record(columns, record.units, structure="rigid")], [], arm,
                     get_structure("rigid"))  # fmt: skip
    wave = seen_in_torque(case.joint, case.logs)["cogging"]
    assert wave.values[0] == pytest.approx(60.0, abs=1.0)
    assert wave.size == pytest.approx(1.0, rel=0.2)


def test_three_periods_of_cogging_are_told_from_friction(arm: JointFile) -> None:
    """Slow ways to and fro over three periods and a half, of which only the risen halves are there.

    Friction and an offset alone then take up half of a wave: its frequency shows beside them only.
    """
    rng, frequency, size = np.random.default_rng(0), 12.0, 2.0
    q = np.concatenate([np.linspace(0.0, 1.8, 3000), np.linspace(1.8, 0.0, 3000)])
    way = np.repeat([1.0, -1.0], 3000)
    rises = way * np.sin(frequency * q) > -0.1
    torque = size * np.sin(frequency * q) + 0.4 * way + 0.05 * rng.standard_normal(6000)
    t = DT * np.arange(6000)
    columns = {"t": t[rises], "q_m": q[rises], "i": torque[rises] / 10.0}
    record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
    case = make_case([record], [], arm, get_structure("rigid"))
    seen = seen_in_torque(case.joint, case.logs)
    assert seen["cogging"].values[0] == pytest.approx(frequency, abs=0.2)
    assert seen["cogging"].size == pytest.approx(size, rel=0.1)
    (alone,) = (one for one in spent(case.joint, case.logs, ["coulomb"]))
    assert alone.values[0] > 1.0, "friction takes up what is the wave's"
    assert seen["coulomb"].values[0] == pytest.approx(0.4, rel=0.25)
