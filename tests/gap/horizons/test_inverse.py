"""A joint whose motion a controller holds: its torque still shows what it is spent on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.findings.by_torque import beside_torque, told_by_torque
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.selection.judgement import Judgement
from cjt_gym.gap.horizons.torque.bristles import bent, ways
from cjt_gym.gap.horizons.torque.cross_validated import CLEAR, gain, steady_gain
from cjt_gym.gap.horizons.torque.inverse import (
    DRAGS,
    ONE_WAY,
    drag_law,
    feels_weight,
    inverse,
    leans,
    seen_in_torque,
    spent,
)
from cjt_gym.joint import JointFile, Quantity, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import Record
from tests.gap.horizons.arm import DAMPING, DRY, DT, INERTIA, WEIGHT, held_record, judgement
from tests.gap.horizons.rotor import INERTIA as ROTOR
from tests.gap.horizons.rotor import datasheet


def test_inverse_dynamics_find_what_moves_without_a_disturbance(arm: JointFile) -> None:
    case = make_case([held_record(0, 0.02)], [], arm, get_structure("rigid"))
    found = inverse(case.joint, case.logs)[-1]
    assert found.inertia == pytest.approx(INERTIA, rel=0.1)
    assert found.damping == pytest.approx(DAMPING, rel=0.05)
    assert found.effects["coulomb"] == pytest.approx((DRY,), rel=0.05)
    assert found.effects["gravity"] == pytest.approx((0.0, WEIGHT), abs=0.15)


def test_fast_motion_does_not_make_the_inertia_larger(arm: JointFile) -> None:
    t, w = 1e-3 * np.arange(8000), 2.0 * np.pi * np.array([0.7, 7.3])
    q = 0.5 * np.sin(w[0] * t) + 0.02 * np.sin(w[1] * t)
    dq = np.gradient(q, t)
    torque = INERTIA * np.gradient(dq, t) + DAMPING * dq + DRY * np.sign(dq)
    columns = {"t": t, "q_m": q, "i": torque / 10.0}
    fast = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
    case = make_case([fast], [], arm, get_structure("rigid"))
    for found in inverse(case.joint, case.logs):
        assert found.inertia == pytest.approx(INERTIA, rel=0.02)


def test_what_is_not_there_is_not_seen(arm: JointFile) -> None:
    case = make_case([held_record(1)], [], arm, get_structure("rigid"))
    seen = spent(case.joint, case.logs, ["damping", "coulomb", "torque_offset", "gravity"])
    assert {one.name for one in seen} >= {"coulomb", "gravity"}
    assert "torque_offset" not in {one.name for one in seen}


def test_a_damping_too_small_to_be_seen_does_not_make_friction_larger(arm: JointFile) -> None:
    off = []
    for seed in range(6):
        case = make_case([held_record(seed, 3.0)], [], arm, get_structure("rigid"))
        asked = ["coulomb", "gravity", "damping"]
        seen = {one.name: one for one in spent(case.joint, case.logs, asked)}
        assert "damping" not in seen, "3 N m of disturbance hide it"
        alone = {one.name: one for one in spent(case.joint, case.logs, asked[:2])}
        off.append([one["coulomb"].values[0] - DRY for one in (seen, alone)])
    beside, taken = np.mean(off, axis=0)
    assert taken > 0.5, "of its torque on average, were it left out"
    assert abs(beside) < 0.5 * taken


@pytest.mark.slow
@pytest.mark.parametrize(("exponent", "law"), [(1.0, ""), (2.0, "faster"), (0.5, "more slowly")])
def test_the_law_of_the_drag_is_told(exponent: float, law: str) -> None:
    t = 2e-3 * np.arange(6000)
    pull = 0.3 * np.sin(2.0 * np.pi * 0.5 * t) + 0.2 * np.sin(2.0 * np.pi * 1.7 * t + 1.0)
    q, v, h, angle = 0.0, 0.0, 1e-4, np.zeros(len(t))
    for k, torque in enumerate(pull):
        angle[k] = q
        for _ in range(20):
            free = v + h * (torque - 0.08 * np.sign(v) * abs(v) ** exponent) / ROTOR
            v = free - min(max(free, -h * 0.05 / ROTOR), h * 0.05 / ROTOR)
            q += h * v
    columns = {"t": t, "i_cmd": pull, "q_m": angle}
    record = Record(columns, {"t": "s", "i_cmd": "A", "q_m": "rad"}, structure="rigid")
    case = make_case([record], [], datasheet(1.0), get_structure("rigid"))
    assert drag_law(case.joint, case.logs) == law
    named = {e.name: e for e in diagnose(record, datasheet(1.0), "rigid").effects}
    if law and "damping" in named:
        assert named["damping"].status == "tentative"
    elif not law:
        assert {"damping", "coulomb"} <= named.keys()
        assert "in proportion" not in named["damping"].doubt


def test_a_constant_torque_is_felt_as_no_weight(arm: JointFile) -> None:
    weighs = held_record(0)
    rubs, t = 10.0 * weighs["i"] - WEIGHT * np.sin(weighs["q_m"]), weighs.t
    for torque, felt in ((rubs + WEIGHT, False), (rubs + WEIGHT * np.sin(weighs["q_m"]), True)):
        columns = {"t": t, "q_m": 0.7 + weighs["q_m"], "i": torque / 10.0}
        record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
        case = make_case([record], [], arm, get_structure("rigid"))
        assert feels_weight(case.joint, case.logs) == felt


def test_the_ground_that_pushes_a_leg_from_one_side_is_told_from_a_weight(arm: JointFile) -> None:
    weighs = held_record(0, 0.1)
    q, t = weighs["q_m"], weighs.t
    rubs = 10.0 * weighs["i"] - WEIGHT * np.sin(q)
    pushes = {"weight": WEIGHT * np.sin(q + 0.7), "ground": -WEIGHT * (q > -0.2)}
    found = {}
    for name, push in pushes.items():
        columns = {"t": t, "q_m": q, "i": (rubs + push) / 10.0}
        record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
        case = make_case([record], [], arm, get_structure("rigid"))
        assert feels_weight(case.joint, case.logs), name
        found[name] = leans(case.joint, case.logs)
    assert found == {"weight": False, "ground": True}


def test_a_wheel_that_runs_out_shows_its_friction_beyond_the_noise_of_its_speed() -> None:
    t = 0.02 * np.arange(6000)
    slowing, dry = 0.02, 0.002 / ROTOR  # of the speed [1/s], and by dry friction [rad/s^2]
    speed = (60.0 + dry / slowing) * np.exp(-slowing * t) - dry / slowing
    noisy = speed + 0.1 * np.random.default_rng(0).standard_normal(len(t))
    columns = {"t": t, "tau_cmd": np.zeros(len(t)), "dq_m": noisy}
    wheel = Record(columns, {"t": "s", "tau_cmd": "N m", "dq_m": "rad/s"}, structure="rigid")
    case = make_case([wheel], [], datasheet(1.0, 0.02), get_structure("rigid"))
    seen = seen_in_torque(case.joint, case.logs, {"torque_offset", "coulomb_asym"})
    assert seen["coulomb"].values[0] == pytest.approx(0.002, rel=0.1)
    assert seen["damping"].values[0] == pytest.approx(slowing * ROTOR, rel=0.1)
    assert set(seen) == {"coulomb", "damping"}


@pytest.mark.slow
def test_the_damping_of_the_datasheet_is_no_cause(arm: JointFile) -> None:
    plain, known = (judgement(arm, **d).case for d in ({}, {"d_m": DAMPING}))
    assert "damping" in seen_in_torque(plain.joint, plain.logs)
    assert "damping" not in seen_in_torque(known.joint, known.logs)


def test_the_torque_adds_what_has_no_name_yet(arm: JointFile) -> None:
    judged = judgement(arm)
    seen = seen_in_torque(judged.case.joint, judged.case.logs)
    alone = told_by_torque(judged, seen, (), alone=True)
    assert [e.name for e in alone] == sorted(seen, key=lambda name: -seen[name].share)
    beside = told_by_torque(judged, seen, [replace(alone[0], name="stribeck")], alone=False)
    assert {e.name for e in beside} == set(seen) - {"coulomb"}, "it is a part of the other"
    assert {(e.status, e.gap_removed) for e in beside} == {("tentative", 0.0)}
    guessed = judgement(arm, d_m=Quantity(DAMPING, "N m s/rad", "guess", guess=True))
    corrected = told_by_torque(guessed, seen, (), alone=False)
    assert "damping" not in {e.name for e in corrected}, "a guess is corrected"


def test_negative_friction_is_none_nor_is_what_stands_beside_it(arm: JointFile) -> None:
    judged = judgement(arm)
    seen = seen_in_torque(judged.case.joint, judged.case.logs)
    for name in ("damping", "coulomb"):
        against = seen | {name: replace(seen[name], values=(-1.0,))}
        told = told_by_torque(judged, against, (), alone=True)
        assert {e.name for e in told} == {"gravity"}
        fitted = [replace(told[0], name=name), told[0]]
        assert beside_torque(judged, against, fitted) == (fitted[0],), "a fit tells it instead"
        assert not beside_torque(judged, seen, fitted)


def test_a_weight_counts_that_shows_in_few_postures() -> None:
    less = np.geomspace(2.0, 1e3, 12)
    noisy = np.array([0.8, 1.1, 0.9, 1.2, 1.0, 0.9, 1.1, 1.0, 0.8, 1.2, 1.0, 1.1])
    assert gain(noisy, less)[1] < CLEAR < steady_gain(noisy, less)
    once = np.array([1e2, *noisy[1:]])
    assert steady_gain(noisy, once) < CLEAR, "a single stretch is no evidence"
    assert steady_gain(noisy, np.roll(noisy, 1)) < CLEAR


def test_friction_that_one_speed_does_not_tell_hides_no_weight(arm: JointFile) -> None:
    t = DT * np.arange(4000)
    turn = 2.0 * np.pi * t / 20.0
    dq = 0.5 * np.sign(np.cos(turn))
    q = np.cumsum(dq) * DT
    torque = DRY * np.sign(dq) + 0.3 * WEIGHT * np.sin(q)
    columns = {"t": t, "q_m": np.round(q / 1e-4) * 1e-4, "i": torque / 10.0}
    record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
    case = make_case([record], [], arm, get_structure("rigid"))
    seen = seen_in_torque(case.joint, case.logs, DRAGS)
    assert seen.keys() in ({"gravity", "damping"}, {"gravity", "coulomb"})
    assert seen["gravity"].values == pytest.approx((0.0, 0.3 * WEIGHT), abs=0.1 * WEIGHT)
    weight = spent(case.joint, case.logs, ["torque_offset", "gravity"])
    assert not weight, "without the friction in the regression it is not seen"


@pytest.mark.slow
def test_friction_and_weight_are_named_where_the_torque_hardly_tells_the_motion(
    arm: JointFile,
) -> None:
    found = diagnose([held_record(0)], arm, validate=[held_record(50)])
    named = {effect.name: effect for effect in found.effects}
    assert named.keys() >= {"coulomb", "gravity"}
    assert named.keys() <= {"coulomb", "gravity", "damping"}  # no inertia of many times the guess
    assert {effect.status for effect in found.effects} == {"tentative"}
    removed = [effect.gap_removed for effect in found.effects]
    assert removed == sorted(removed, reverse=True)
    dry, weight = named["coulomb"].parameters["d_cm"], named["gravity"].parameters["torque"]
    assert dry.value == pytest.approx(DRY, rel=0.2)
    assert weight.low < WEIGHT < weight.high
    assert "regression of the torque" in found.unexplained.text


@pytest.mark.slow
def test_the_weight_of_a_pendulum_without_a_motor_is_confirmed() -> None:
    t = DT * np.arange(2000)
    swing = solve_ivp(
        lambda _, x: [x[1], -(0.4 * np.sin(x[0]) + 0.001 * x[1]) / ROTOR],
        (0.0, t[-1]), [1.2, 0.0], t_eval=t, rtol=1e-9, atol=1e-9,
    )  # fmt: skip
    columns = {"t": t, "q_m": 1.5e-3 * np.round(swing.y[0] / 1.5e-3), "i": np.zeros(len(t))}
    record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
    found = diagnose(record, datasheet(1.0, tolerance=0.2), "rigid")
    (weight,) = (e for e in found.effects if e.name == "gravity")
    torque = weight.parameters["torque"]
    assert weight.status == "confirmed"
    assert torque.low < 0.4 < torque.high
    assert torque.high - torque.low > 0.2 * torque.value, "as its inertia, known to 20 %"


@pytest.mark.slow
def test_a_weight_at_small_travel_may_be_a_spring() -> None:
    t = DT * np.arange(6000)
    u = 0.3 * np.sin(2.0 * np.pi * 0.5 * t) + 0.2 * np.sin(2.0 * np.pi * 1.1 * t)
    motion = solve_ivp(
        lambda at, x: [x[1], (np.interp(at, t, u) - 4.0 * x[0] - 0.2 * x[1]) / ROTOR],
        (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    columns = {"t": t, "q_m": 1e-5 * np.round(motion.y[0] / 1e-5), "i": u}
    record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
    found = diagnose(record, datasheet(1.0, tolerance=0.2), "rigid")
    (pull,) = (e for e in found.effects if e.name == "gravity")
    assert pull.status == "tentative"
    assert "contact" in pull.confusable_with
    assert "half a revolution" in found.suggestion.text


def test_bristles_turn_round_over_their_path() -> None:
    there = np.linspace(0.0, 1.0, 1001)
    q = np.concatenate([there, 1.0 - there])
    s = bent(q, 0.1)
    assert s[1000] == pytest.approx(1.0 - np.exp(-10.0))
    assert s[1000 + 100] == pytest.approx(-1.0 + (1.0 + s[1000]) * np.exp(-1.0), abs=2e-2)
    assert np.allclose(bent(np.repeat(q, 3), 0.1)[2::3], s), "at rest nothing changes"
    assert np.array_equal(bent(np.zeros(5), 0.1), np.zeros(5))
    assert [ways(np.tile(q, 3), path) for path in (0.5, 1.5)] == [6, 0]


@pytest.mark.slow
@pytest.mark.parametrize(("path", "name"), [(0.15, "presliding"), (1e-4, "coulomb")])
def test_friction_over_a_path_is_told_from_damping_by_the_torque(
    arm: JointFile, path: float, name: str
) -> None:
    """Of bristles whose motion a machine imposes, a regression without them shows damping."""
    rng, t = np.random.default_rng(5), DT * np.arange(6000)
    q = np.sin(2.0 * np.pi * 0.5 * t) * (1.0 - 0.5 * np.cos(2.0 * np.pi * t / 12.0))
    s, before = np.zeros(len(t)), 0.0
    for k, step in enumerate(np.diff(q, prepend=q[0])):
        before = np.clip(before + step / path * (1.0 - before * np.sign(step)), -1.0, 1.0)
        s[k] = before
    torque = DRY * s + 0.02 * DRY * rng.standard_normal(len(t))
    columns = {"t": t, "q_m": q, "i": torque / 10.0}
    record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
    case = make_case([record], [], arm, get_structure("rigid"))
    seen = seen_in_torque(case.joint, case.logs)
    assert seen.keys() == {name}
    assert seen[name].values[0] == pytest.approx(DRY, rel=0.1)
    if name == "presliding":
        assert seen[name].values[1] == pytest.approx(DRY / path, rel=0.5)
        assert seen_in_torque(case.joint, case.logs, {"presliding"}).keys() != {"coulomb"}
        (told,) = told_by_torque(Judgement(case, "found", case.joint, ()), seen, (), alone=True)
        assert set(told.parameters) == {"d_cm", "sigma_m"}


@pytest.mark.slow
def test_motion_in_one_direction_shows_friction_that_an_offset_may_be(arm: JointFile) -> None:
    rng = np.random.default_rng(7)
    t = DT * np.arange(4000)
    speed = 1.0 + 0.4 * np.sin(0.9 * t)
    torque = INERTIA * 0.36 * np.cos(0.9 * t) + DRY + 0.05 * rng.standard_normal(len(t))
    columns = {"t": t, "q_m": np.cumsum(speed) * DT, "i": torque / 10.0}
    record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
    case = make_case([record], [], arm, get_structure("rigid"))
    seen = seen_in_torque(case.joint, case.logs, ONE_WAY)
    assert seen["coulomb"].values == pytest.approx((DRY,), rel=0.02)
    assert "torque_offset" not in seen
    (told,) = (e for e in diagnose(record, arm, structure="rigid").effects if e.name == "coulomb")
    assert told.status == "tentative"
    assert "torque_offset" in told.confusable_with


@pytest.mark.slow
def test_friction_of_one_speed_is_told_as_either_law(arm: JointFile) -> None:
    rng = np.random.default_rng(9)
    t = DT * np.arange(4000)
    speed = 0.5 * np.tanh(40.0 * np.sin(1.1 * t))
    torque = INERTIA * np.gradient(speed, DT) + DRY * np.sign(speed)
    torque += 0.3 * rng.standard_normal(len(t))
    columns = {"t": t, "q_m": np.cumsum(speed) * DT, "i": torque / 10.0}
    record = Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")
    case = make_case([record], [], arm, get_structure("rigid"))
    assert len(DRAGS & seen_in_torque(case.joint, case.logs, DRAGS).keys()) == 1
    found = diagnose(record, arm, structure="rigid")
    assert {row.name for row in found.examination.cannot_tell} >= DRAGS
    told = {e.name: e for e in found.effects if e.name in DRAGS}
    assert told
    for name, effect in told.items():
        assert effect.status == "tentative"
        assert DRAGS - {name} <= {*effect.confusable_with}


def test_the_torque_of_a_voltage_shows_friction_and_weight() -> None:
    """The back-EMF is no damping, and what r and k_t leave open of it is not told as such."""
    rng = np.random.default_rng(4)
    k_t, r, dt = 0.05, 2.0, 2e-3
    values = {"I_m": 1e-4, "I_g": 0.0, "I_l": 0.0, "d_m": 0.0, "n": 1.0, "k_t": k_t, "r": r}
    sheet = JointFile(JointParameters.from_values("motor", values))
    t = dt * np.arange(10_000)
    w = 2.0 * np.pi * np.array([0.11, 0.31, 0.83])
    angle = np.outer(t, w) + rng.uniform(0.0, 2.0 * np.pi, 3)
    q, dq = np.sin(angle) @ [1.5, 0.6, 0.2], np.cos(angle) @ (np.array([1.5, 0.6, 0.2]) * w)
    ddq = -np.sin(angle) @ (np.array([1.5, 0.6, 0.2]) * w**2)
    torque = 1e-4 * ddq + 2e-3 * np.sign(dq) + 8e-3 * np.sin(q)
    v = r / k_t * torque + k_t * dq + 0.02 * rng.standard_normal(len(t))
    told = Record({"t": t, "v": v, "q_m": q}, {"t": "s", "v": "V", "q_m": "rad"}, structure="rigid")
    case = make_case([told], [], replace(sheet, drive="static"), get_structure("rigid"))
    seen = seen_in_torque(case.joint, case.logs)
    assert seen["coulomb"].values == pytest.approx((2e-3,), rel=0.05)
    assert seen["gravity"].values == pytest.approx((0.0, 8e-3), abs=4e-4)
    assert "damping" not in seen
