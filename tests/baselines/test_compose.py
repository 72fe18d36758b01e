"""Controllers put together from parts keep their promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym import load_joint
from cjt_gym.baselines import CONTROLLERS, Controller, default_gains, get_entry, make_controller
from cjt_gym.baselines.linear_law import REFERENCE, TAU
from cjt_gym.baselines.parts import OBSERVER, PARTS
from cjt_gym.baselines.pid import FilteredDerivative
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.robust import PEAK, is_stable, make_bench
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement, SimulatedPlant, limits_of
from tests.baselines.test_laws import track

Floats = NDArray[np.float64]
DT = 1e-3
FIXED, FREE = "output_fixed_rigid_gearbox", "full_dynamics"
PD = {"kp": 0.4, "kd": 0.003, "lead": 0.0}


def a_joint(structure: str = FIXED, **effects: dict[str, float]) -> Joint:
    load = {} if structure == FIXED else {"I_l": 3.0}
    effects = {"coulomb": {}, "command_delay": {"delay": 1e-3}} | effects
    return load_joint("orange_80_6000", structure, effects=effects, parameters=load)


def commands(law: Controller, limit: float) -> Floats:
    """Return what a law commands along a random series, shape (samples, 2)."""
    law.torque_limit = limit
    rng = np.random.default_rng(0)
    values = np.cumsum(rng.normal(size=(60, 9, 2)), axis=0)
    wanted = np.cumsum(rng.normal(size=(60, 2)), axis=0)
    return np.array([law.act(Measurement(*v), r) for v, r in zip(values, wanted, strict=True)])


WORDS = [
    "p",
    "i",
    "pi",
    "pid",
    "pd+torque",
    "pid+torque+friction",
    "pd+position_pd+reference",
    "pd+reference+friction+mass_dob",
    "pi+reference+momentum_dob+friction",
    "position_pd+friction",
    "pd+damping+reference+extended_dob",
]


@pytest.mark.parametrize(
    ("word", "structure"), [*((w, FIXED) for w in WORDS), *((w, FREE) for w in WORDS[-5:])]
)
def test_what_is_put_together_is_robust_or_says_why_not(word: str, structure: str) -> None:
    joint, entry = a_joint(structure), get_entry(word)
    if structure not in entry.structures:
        with pytest.raises(ConfigurationError, match="zero at zero frequency"):
            make_controller(word, joint, DT)
        return
    gains = default_gains(word, joint, DT)
    assert list(gains) == [gain.name for gain in entry.tunable]
    law, bench = make_controller(word, joint, DT, gains), make_bench(SampledJoint(joint, DT))
    assert law.linear is not None
    assert law.torque_limit == limits_of(joint).tau
    assert all(is_stable(loop, law.linear) for loop in (bench.nominal, *bench.others))
    answer = law.linear.response(bench.f)[:, 1:]
    assert np.max(np.abs(1.0 / (1.0 - np.sum(answer * bench.plant[:, :-1], axis=1)))) <= PEAK


def torque_under(word: str, joint: Joint, gains: dict[str, float], wanted: Floats) -> Floats:
    law = make_controller(word, joint, DT, gains)
    law.torque_limit = 30.0
    return track(joint, law, wanted)


def test_friction_beside_an_integral_is_no_excess_that_the_integral_gives_back() -> None:
    """With friction fed forward, the torque still comes to rest where it is wanted."""
    joint = a_joint(torque_offset={"torque": 4.0})
    gains = {"kp": 0.3, "ki": 8.0, "kd": 0.004, "lead": 0.0, "share": 0.9, "smoothing": 0.02}
    wanted = np.where(np.arange(2500) < 500, 90.0, 10.0)  # at first beyond the limit
    found = torque_under("pid+reference+friction", joint, gains, wanted)
    assert np.mean(found[-200:]) == pytest.approx(10.0, abs=0.2)


def test_friction_fed_forward_helps_a_disturbance_observer() -> None:
    joint = a_joint()
    wanted = 20.0 * np.sin(2.0 * np.pi * 3.0 * DT * np.arange(1500))
    gains = PD | {"dob_hz": 4.0, "share": 0.8, "smoothing": 0.02}
    error = []
    for share in (0.8, 0.0):
        found = torque_under(
            "pd+reference+mass_dob+friction", joint, gains | {"share": share}, wanted
        )
        error.append(np.sqrt(np.mean((found - wanted)[500:] ** 2)))
    assert error[0] < 0.8 * error[1]


LEADING = [n for n, row in CONTROLLERS.items() if "lead" in {gain.name for gain in row.tunable}]


@pytest.mark.parametrize("name", LEADING)
def test_the_derivative_is_that_of_error_or_measurement(name: str) -> None:
    """A jump of the reference shows in the same sample, one of the torque shows either way."""
    joint, jump = a_joint(), FilteredDerivative(200.0, DT).b
    gains = default_gains(name, joint, DT) | {"kp": 0.2, "kd": 0.004}
    late, lead = (make_controller(name, joint, DT, gains | {"lead": x}).linear for x in (0.0, 1.0))
    assert late is not None
    assert lead is not None
    assert lead.d[REFERENCE] - late.d[REFERENCE] == pytest.approx(0.004 * jump)
    if name != "pid_outer_dob":  # whose observer inverts the loop, which the lead changes
        np.testing.assert_allclose(lead.d[TAU], late.d[TAU])
        np.testing.assert_allclose(lead.b[:, TAU], late.b[:, TAU], atol=1e-12)


@pytest.mark.parametrize(
    ("whole", "without"),
    [
        ("pi", "p"),
        ("pid", "pd"),
        ("pid_feedforward", "pd+reference"),
        ("pid+torque", "pd+torque"),
        ("integral_feedforward", "open_loop"),
    ],
)
def test_without_its_integral_a_law_is_the_one_without(whole: str, without: str) -> None:
    given = {"kp": 0.4, "kd": 2e-3, "ki": 0.0, "lead": 1.0}
    found = []
    for name in (whole, without):
        gains = {gain.name: given[gain.name] for gain in get_entry(name).tunable}
        found.append(commands(make_controller(name, a_joint(), DT, gains), 6.0))
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("value", ["much", None, float("nan"), 0.001, -1.0])
def test_a_gain_that_is_no_number_or_too_small_is_refused(value: object) -> None:
    with pytest.raises(ConfigurationError, match=r"ki of controller pi must be .* 1/s, or 0, got"):
        make_controller("pi", a_joint(), DT, {"kp": 0.2, "ki": value})  # type: ignore[dict-item]


def test_rows_with_a_lead_keep_the_derivative_that_they_had() -> None:
    usual = {n: get_entry(n).complete({}).get("lead") for n in ("pd", "mass_dob", "pid_inner_dob")}
    assert usual == {"pd": 1.0, "mass_dob": 0.0, "pid_inner_dob": 0.0}


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("pd+pid", "The parts pd and pid of the controller pd.pid do the same"),
        ("pd+reference+pd", "The parts pd and pd"),
        ("pd+inner_dob+mass_dob", "one disturbance observer at most, got inner_dob, mass_dob"),
    ],
)
def test_parts_that_do_not_go_together_are_refused(word: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        get_entry(word)


def test_a_part_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'friction'"):
        get_entry("pd+frictoin")
    with pytest.raises(UnknownNameError, match="Did you mean 'position_pd'"):
        get_entry("positon_pd")


def test_every_part_of_the_table_makes_a_controller() -> None:
    joint = a_joint()
    for part in PARTS.values():
        word = part.name if part.kind != OBSERVER else f"{part.name}+reference"
        gains = {g.name: g.high if g.usual is None else g.usual for g in part.tunable}
        law = make_controller(word, joint, DT, gains)
        assert replace(get_entry(word), name=word).check_structure(joint) is None
        assert np.isfinite(law.act(SimulatedPlant(joint, 1, DT).reset(seed=0), np.ones(1))).all()
