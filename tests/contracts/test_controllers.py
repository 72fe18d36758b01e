"""What every controller of the table keeps to."""

from __future__ import annotations

import re
import shlex
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cjt_gym import joint_names, load_joint
from cjt_gym.baselines import (
    CONTROLLERS,
    Controller,
    OpenLoop,
    PdFeedForward,
    default_gains,
    make_controller,
    shipped,
)
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.robust import is_stable
from cjt_gym.baselines.shipped import FOLDER, shipped_gains
from cjt_gym.envs.settings import default_load
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.joint import STRUCTURES, Joint
from cjt_gym.plant import Measurement, SimulatedPlant, limits_of
from tests.baselines.test_laws import track

Floats = NDArray[np.float64]
NAMES = sorted(CONTROLLERS)
LAWS = [*NAMES, "pid", "pid+reference+friction+momentum_dob", "pi+torque+position_pd"]
"""The table, and some that are put together."""
DT = 1e-3


@pytest.fixture(scope="module")
def joint() -> Joint:
    return load_joint(
        "orange_80_6000",
        "output_fixed_rigid_gearbox",
        effects={"coulomb": {}, "command_delay": {"delay": 1e-3}, "noise": {}},
    )


def made(name: str, joint: Joint) -> Controller:
    return make_controller(name, joint, DT)


def measurements(num: int, steps: int) -> list[Measurement]:
    rng = np.random.default_rng(0)
    values = np.cumsum(rng.normal(size=(steps, 9, num)), axis=0)
    return [Measurement(*rows) for rows in values]


def part(m: Measurement, rows: slice) -> Measurement:
    return replace(m, **{name: values[rows] for name, values in vars(m).items()})


@pytest.mark.parametrize("name", NAMES)
def test_the_row_and_the_controller_say_what_they_are(name: str, joint: Joint) -> None:
    row, law = CONTROLLERS[name], make_controller(name, joint, DT)
    assert row.name == name
    assert row.kind == "classical"
    assert row.summary.endswith(".")
    assert row.source
    assert law.dt == DT
    assert law.torque_limit == limits_of(joint).tau


@pytest.mark.parametrize("name", LAWS)
def test_a_reset_repeats_and_one_instance_serves_any_number(name: str, joint: Joint) -> None:
    law = made(name, joint)
    for num in (3, 1, 5):
        series = measurements(num, 20)
        wanted = np.linspace(-5.0, 5.0, num)
        runs = []
        for _ in range(2):
            law.reset()
            runs.append([law.act(m, wanted) for m in series])
        np.testing.assert_array_equal(runs[0], runs[1])
        assert runs[0][0].shape == (num,)


@pytest.mark.parametrize("name", LAWS)
def test_a_batch_does_what_its_members_do_alone(name: str, joint: Joint) -> None:
    batch, single = (made(name, joint) for _ in range(2))
    series = measurements(4, 30)
    wanted = np.array([1.0, -2.0, 3.0, 0.0])
    together = np.array([batch.act(m, wanted) for m in series])
    for i in range(4):
        single.reset()
        rows = slice(i, i + 1)
        alone = np.array([single.act(part(m, rows), wanted[rows]) for m in series])
        np.testing.assert_allclose(together[:, i], alone[:, 0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_a_partial_reset_forgets_some_and_keeps_the_others(name: str, joint: Joint) -> None:
    law, fresh, kept = (made(name, joint) for _ in range(3))
    series, wanted = measurements(2, 20), np.zeros(2)
    for m in series[:10]:
        law.act(m, wanted)
        kept.act(m, wanted)
    law.reset(np.array([True, False]))
    for m in series[10:]:
        command = law.act(m, wanted)
        assert command[0] == pytest.approx(fresh.act(m, wanted)[0], rel=1e-9, abs=1e-9)
        assert command[1] == pytest.approx(kept.act(m, wanted)[1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_commands_stay_within_the_limit_and_leave_their_inputs_alone(
    name: str, joint: Joint
) -> None:
    law = made(name, joint)
    wanted = np.array([1e6, -1e6])
    for m in measurements(2, 5):
        before = m.tau.copy()
        command = law.act(m, wanted)
        assert np.all(np.abs(command) <= law.torque_limit)
        np.testing.assert_allclose(np.abs(command), law.torque_limit, rtol=1e-9)
        np.testing.assert_array_equal(wanted, [1e6, -1e6])
        np.testing.assert_array_equal(m.tau, before)


def at_rest(joint: Joint, tau: float, shift: float = 0.0) -> Measurement:
    """A joint that stands still under a torque, its load at an angle."""
    bend = tau / joint.parameters.k_b
    values = dict.fromkeys(("t", "i", "dq_m", "dq_g", "dq_l"), 0.0)
    values |= {"q_m": shift + bend, "q_g": shift + bend, "q_l": shift, "tau": tau}
    return Measurement(**{name: np.array([value]) for name, value in values.items()})


@pytest.mark.parametrize("name", LAWS)
def test_the_first_command_after_a_reset_has_no_kick(name: str, joint: Joint) -> None:
    """At rest at the reference the command is the torque that holds the joint there, and stays."""
    law, m = made(name, joint), at_rest(joint, 12.0)
    static = {"pd": 0.0}  # feedback alone gives nothing
    for _ in range(2):
        for _ in range(5):
            command = law.act(m, np.array([12.0]))
            assert command == pytest.approx(static.get(name, 12.0), rel=1e-6)
        law.reset(np.array([True]))


@pytest.mark.parametrize("name", LAWS)
def test_commands_do_not_hang_on_where_the_load_stands(name: str, joint: Joint) -> None:
    here, there = (made(name, joint) for _ in range(2))
    for tau in (3.0, 4.0, 6.0, 5.0):
        one = here.act(at_rest(joint, tau), np.array([5.0]))
        other = there.act(at_rest(joint, tau, shift=0.3), np.array([5.0]))
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_nothing_winds_up_at_the_limit(name: str, joint: Joint) -> None:
    """While a limit holds the command, no state of the law grows."""
    law = made(name, joint)
    if law.linear is not None and len(law.linear.c):
        assert np.max(np.abs(np.linalg.eigvals(law.linear.a))) < 1.0 - 1e-6


@pytest.mark.parametrize("name", LAWS)
def test_another_number_of_joints_needs_a_reset(name: str, joint: Joint) -> None:
    law = made(name, joint)
    law.act(measurements(2, 1)[0], np.zeros(2))
    with pytest.raises(ConfigurationError, match=r"Call reset\(\)"):
        law.act(measurements(3, 1)[0], np.zeros(3))
    with pytest.raises(ConfigurationError, match="mask"):
        law.reset(np.array([True]))
    law.reset()
    assert law.act(measurements(3, 1)[0], np.zeros(3)).shape == (3,)


def settles(name: str, joint_name: str, structure: str) -> None:
    """Check that nothing diverges or goes on oscillating once the reference stands still.

    A law that leaves the joint's own resonance as it is may ring on, but must die out.
    """
    effects = {"coulomb": {}, "command_delay": {"delay": 2e-3}}
    parameters = {} if STRUCTURES[structure].output_fixed else {"I_l": 3.0}
    joint = load_joint(joint_name, structure, effects=effects, parameters=parameters)
    friction = joint.parameters.get("d_cm", 0.0) + joint.parameters.get("d_cg", 0.0)
    wanted = max(0.1 * limits_of(joint).tau, 3.0 * friction)
    torque = track(joint, make_controller(name, joint, DT), wanted * (np.arange(1500) < 50))
    assert np.abs(torque).max() < limits_of(joint).tau, joint_name
    assert np.ptp(torque[1300:]) < max(0.3 * wanted, 0.5 * np.ptp(torque[100:300])), joint_name


CLAIMS = [(name, structure) for name in NAMES for structure in CONTROLLERS[name].structures]
JOINTS = [name for name in joint_names() if name != "emps"]


@pytest.mark.parametrize("name", NAMES)
def test_a_joint_settles_under_every_controller(name: str) -> None:
    settles(name, "orange_80_6000", CONTROLLERS[name].structures[0])


@pytest.mark.slow
@pytest.mark.parametrize("joint_name", JOINTS)
@pytest.mark.parametrize(("name", "structure"), CLAIMS)
def test_every_joint_settles_under_every_controller(
    name: str, structure: str, joint_name: str
) -> None:
    settles(name, joint_name, structure)


@pytest.mark.parametrize("name", NAMES)
def test_a_structure_that_is_not_claimed_is_refused_with_the_reason(name: str) -> None:
    entry = CONTROLLERS[name]
    for structure in set(STRUCTURES) - set(entry.structures):
        reason = "no joint torque to measure" if structure == "rigid" else entry.refusal
        assert reason
        other = load_joint("orange_80_6000", structure)
        with pytest.raises(ConfigurationError, match=re.escape(reason)):
            make_controller(name, other, DT)


@pytest.mark.parametrize("name", NAMES)
def test_gains_have_names_and_ranges_and_the_defaults_keep_them(name: str, joint: Joint) -> None:
    entry, defaults = CONTROLLERS[name], default_gains(name, joint, DT)
    assert list(defaults) == [gain.name for gain in entry.tunable]
    entry.check_gains(defaults)
    for gain in entry.tunable:
        assert gain.low < gain.high
        assert not gain.log or gain.low > 0.0
        with pytest.raises(ConfigurationError, match=f"Gain {gain.name} of controller {name}"):
            make_controller(name, joint, DT, {gain.name: gain.high + 1.0})
    with pytest.raises(UnknownNameError, match="Unknown gain of controller"):
        make_controller(name, joint, DT, {"k_q": 1.0})
    m, wanted = measurements(1, 1)[0], np.ones(1)
    given, own = make_controller(name, joint, DT, defaults), make_controller(name, joint, DT)
    assert given.act(m, wanted) == own.act(m, wanted)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kp": -1.0}, "kp of PdFeedForward must be finite and >= 0, got -1.0"),
        ({"kd": float("nan")}, "kd of PdFeedForward must be finite and >= 0 s, got nan"),
        ({"dt": 0.0}, "dt of PdFeedForward must be finite and > 0 s, got 0.0"),
        ({"cutoff_hz": 500.0}, "below the Nyquist frequency, 500 Hz"),
        ({"cutoff_hz": 0.0}, "cutoff_hz of PdFeedForward must be finite and > 0 Hz"),
        ({"torque_limit": -3.0}, "torque_limit of PdFeedForward must be > 0 N m, got -3.0"),
    ],
)
def test_bad_gains_are_refused(arguments: dict[str, float], message: str) -> None:
    good = {"kp": 0.5, "kd": 0.001, "dt": DT}
    with pytest.raises(ConfigurationError, match=message):
        PdFeedForward(**{**good, **arguments})  # type: ignore[arg-type]


def test_unknown_names_are_refused_with_a_suggestion(joint: Joint) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'pd_feedforward'"):
        make_controller("pd_feedforwrd", joint, DT)
    with pytest.raises(UnknownNameError, match="Did you mean 'output'"):
        PdFeedForward(0.5, 0.001, DT, derivative="outptu")
    with pytest.raises(ConfigurationError, match="dt of OpenLoop"):
        OpenLoop(-1.0)


def test_the_derivative_is_that_of_a_ramp() -> None:
    law = PdFeedForward(0.0, 0.01, DT, derivative="output")
    m = measurements(1, 1)[0]
    commands = [law.act(replace(m, tau=np.array([3.0 * k * DT])), np.zeros(1)) for k in range(60)]
    assert commands[-1] == pytest.approx(-0.01 * 3.0)


SHIPPED = sorted(FOLDER.glob("*/*/*.toml"))


@pytest.mark.parametrize(
    "path", SHIPPED, ids=lambda path: "-".join(path.with_suffix("").parts[-3:])
)
def test_shipped_gains_are_those_of_the_command_that_they_name(path: Path) -> None:
    joint_name, structure, name = path.with_suffix("").parts[-3:]
    known = tomllib.loads(path.read_text(encoding="utf-8"))
    tuned, words = known["tuned"], shlex.split(known["tuned"]["command"])
    assert words[:3] == ["cjt-gym", "tune", name]
    assert words[words.index("--joint") + 1] == tuned["joint"] == joint_name
    assert words[words.index("--structure") + 1] == tuned["structure"] == structure
    assert known["controller"] == name
    assert tuned["feasible"]
    assert tuned["held_out"]["low"] <= 1.0 or not tuned["designed_feasible"]
    load = default_load(joint_name, structure, {})
    late = {"command_delay": {"delay": 2e-3}}
    joint = load_joint(joint_name, structure, effects=late, parameters=load)
    gains = shipped_gains(CONTROLLERS[name], joint, DT)
    assert gains == {key: number["value"] for key, number in known["gains"].items()}
    CONTROLLERS[name].check_gains(gains)
    assert shipped_gains(CONTROLLERS[name], joint, 0.5 * DT) is None


def test_shipped_gains_give_way_where_the_delay_is_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of a file are taken where the joint is stable with them, else the designed ones."""
    path = tmp_path / "orange_80_6000" / "output_fixed_rigid_gearbox" / "pd_feedforward.toml"
    path.parent.mkdir(parents=True)
    gains = {"kp": 0.35, "kd": 0.006, "lead": 0.0}
    lines = [f'[gains.{name}]\nvalue = {value}\nunit = "-"' for name, value in gains.items()]
    path.write_text("\n".join([*lines, "[tuned]", "dt = 0.001"]))
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)

    def used(delay: float, dt: float = DT) -> dict[str, float]:
        effects = {"command_delay": {"delay": delay}} if delay else {}
        joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects=effects)
        return default_gains("pd_feedforward", joint, dt)

    assert used(0.0) == used(2e-3) == gains
    assert used(12e-3)["kp"] < 0.5 * gains["kp"]
    assert used(0.0, 0.5 * DT) != gains


def test_the_sampled_loop_is_stable_where_a_simulation_of_it_is() -> None:
    joint = load_joint("orange_80_6000", "output_fixed", effects={"command_delay": {"delay": 2e-3}})
    loop = SampledJoint(joint, DT).loop
    for kp, kd in ((0.3, 0.004), (1.5, 0.004), (0.6, 0.0), (0.05, 0.001)):
        plant, law = SimulatedPlant(joint, 1, DT), PdFeedForward(kp, kd, DT)
        assert law.linear is not None
        now = plant.reset(start=np.array([[1e-5, 1e-5, 0.0, 0.0, 0.0, 0.0]]))
        first = abs(now.tau[0])
        for _ in range(1000):
            now = plant.step(law.act(now, np.zeros(1)))
        assert is_stable(loop, law.linear) == (abs(now.tau[0]) < first), (kp, kd)


def test_a_joint_without_spring_gets_gains_without_derivative() -> None:
    assert default_gains("pd_feedforward", load_joint("emps", "rigid"), DT)["kd"] == 0.0


def test_default_gains_of_pd_control_suit_a_slow_loop(joint: Joint) -> None:
    controller = make_controller("pd_feedforward", joint, 5e-3)
    assert isinstance(controller, PdFeedForward)
    assert controller.cutoff_hz == pytest.approx(80.0)
