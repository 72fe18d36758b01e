"""A bar whose torque is a table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from cjt_gym.errors import MissingFileError, ParameterError, UnknownNameError
from cjt_gym.joint import Joint, load_joint, to_toml
from cjt_gym.joint.build import file_of
from cjt_gym.joint.kernel.arrays import MEMORY
from cjt_gym.joint.kernel.spring_table import mean_torque, read_spring, spring_rows, table_torque
from cjt_gym.plant import SimulatedPlant

NAME = "orange_80_6000"
X = (-0.04, -0.02, -0.005, 0.0, 0.01, 0.03)
TAU = (-300.0, -120.0, -20.0, 0.0, 30.0, 200.0)


def tabled(structure: str = "output_fixed_rigid_gearbox", **more: Any) -> Joint:
    effects = {"spring_table": {"deflection": X, "torque": TAU}, **more.pop("effects", {})}
    return load_joint(NAME, structure, effects=effects, **more)


def memory_of(joint: Joint) -> np.ndarray[Any, Any]:
    return np.concatenate([np.zeros(MEMORY), spring_rows(joint.effects, NAME).ravel()])


def test_it_is_scipys_monotone_curve_with_straight_ends() -> None:
    memory, curve = memory_of(tabled()), PchipInterpolator(X, TAU)
    inside = np.linspace(X[0], X[-1], 401)
    found = np.array([table_torque(memory, float(x)) for x in inside])
    np.testing.assert_allclose(found[:, 0], curve(inside), rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(found[:, 1], curve.derivative()(inside), rtol=1e-9, atol=1e-6)
    for end, slope in ((X[0], curve.derivative()(X[0])), (X[-1], curve.derivative()(X[-1]))):
        beyond = end + 0.01 * np.sign(end)
        torque, stiffness = table_torque(memory, float(beyond))
        assert torque == pytest.approx(float(curve(end) + slope * (beyond - end)))
        assert stiffness == pytest.approx(float(slope))


@pytest.mark.parametrize(
    ("low", "high"), [(-0.035, 0.025), (0.012, 0.013), (0.01, 0.0), (0.02, 0.02)]
)
def test_the_mean_is_the_work_over_the_way(low: float, high: float) -> None:
    memory, curve = memory_of(tabled()), PchipInterpolator(X, TAU)
    if low == high:
        expected = float(curve(low))
    else:
        expected = float(curve.integrate(low, high)) / (high - low)
    assert mean_torque(memory, low, high) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_a_straight_table_is_the_linear_spring() -> None:
    straight = {"spring_table": {"deflection": (0.0, 0.01, 0.02), "torque": (0.0, 60.0, 120.0)}}
    tau = 50.0 * np.sign(np.sin(40.0 * np.arange(300) * 1e-3))
    for structure in ("output_fixed", "full_dynamics"):
        one = load_joint(NAME, structure, effects=straight).simulate(tau, dt_physics=1e-4)
        other = load_joint(NAME, structure, effects={}).simulate(tau, dt_physics=1e-4)
        np.testing.assert_allclose(one["true_tau"], other["true_tau"], rtol=0, atol=1e-3)


def test_the_joint_settles_where_the_table_says() -> None:
    """Statically the bar bears the motor's torque."""
    joint = tabled(parameters={"d_gl": 60.0})
    record = joint.simulate(np.full(1500, 100.0), dt=1e-3, dt_physics=1e-4)
    bend = record["true_q_g"][-1] - record["true_q_l"][-1]
    assert record["true_tau"][-1] == pytest.approx(100.0, rel=1e-3)
    assert float(PchipInterpolator(X, TAU)(bend)) == pytest.approx(100.0, rel=1e-3)


def test_its_scale_varies_and_a_batch_is_its_members() -> None:
    plant = SimulatedPlant(tabled(), 3, randomization={"spring_table.scale": (0.8, 1.2)})
    alone = [
        SimulatedPlant(tabled(), 1, randomization={"spring_table.scale": (0.8, 1.2)}) for _ in "abc"
    ]
    plant.reset(seed=1)
    for i, one in enumerate(alone):
        one.reset(seed=1 + i)
    assert len(set(plant.drawn()["spring_table.scale"])) == 3
    for _ in range(30):
        many = plant.step(np.full(3, 80.0)).tau
        each = [one.step(np.full(1, 80.0)).tau[0] for one in alone]
        np.testing.assert_array_equal(many, each)


def test_files_of_points_and_joint_files(tmp_path: Path) -> None:
    path = tmp_path / "bar.csv"
    path.write_text("deflection, torque\n0,0\n0.01,30\n0.03,200\n")
    joint = load_joint(NAME, effects={"spring_table": read_spring(path)})
    rows = spring_rows(joint.effects, NAME)
    np.testing.assert_array_equal(rows[:, 0], [-0.03, -0.01, 0.0, 0.01, 0.03])
    saved = tmp_path / "joint.toml"
    saved.write_text(to_toml(file_of(joint)))
    assert load_joint(saved).effects == joint.effects


def test_its_state_of_calibration_is_in_the_joint_file(tmp_path: Path) -> None:
    """The snippet of the page: a tolerance of the torques is one of their common factor."""
    page = (Path(__file__).parents[2] / "docs" / "joint_files.md").read_text(encoding="utf-8")
    (snippet,) = (b for b in page.split("```toml\n") if b.startswith("[effects.spring_table]"))
    bare = load_joint(NAME, effects={})
    path = tmp_path / "joint.toml"
    path.write_text(to_toml(file_of(bare)) + "\n" + snippet.split("```")[0])
    joint = load_joint(path)
    assert joint.file.effects["spring_table"]["torque"].source.startswith("load cell, calibrated")
    drawn = SimulatedPlant(joint, randomization="identified").randomization["spring_table.scale"]
    assert (drawn.distribution, drawn.std) == ("normal", 0.01)


def test_tables_that_are_none_are_refused(tmp_path: Path) -> None:
    def made(x: tuple[float, ...], tau: tuple[float, ...]) -> Joint:
        return load_joint(NAME, effects={"spring_table": {"deflection": x, "torque": tau}})

    with pytest.raises(ParameterError, match=r"spring_table\.torque of .* must rise"):
        made((0.0, 0.01, 0.02), (0.0, 30.0, 20.0))
    with pytest.raises(ParameterError, match=r"spring_table\.deflection of .* must rise"):
        made((0.01, -0.01), (1.0, 2.0))
    with pytest.raises(ParameterError, match="equal length"):
        made((0.0, 0.01), (0.0, 30.0, 20.0))
    with pytest.raises(MissingFileError, match="do not exist"):
        read_spring(tmp_path / "none.csv")
    for text, message in (
        ("a,b\n1,2\n", "first line"),
        ("deflection,torque\n1,x\n", "two numbers"),
        ("deflection,torque\n0,0\n", "a torque that is not 0"),
    ):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(ParameterError, match=message):
            read_spring(tmp_path / "bad.csv")


def test_a_signal_that_does_not_exist_is_told_from_its_neighbour() -> None:
    joint = load_joint("example", "output_fixed", effects={})
    with pytest.raises(UnknownNameError, match="output of the joint 'tua'. Did you mean 'tau'"):
        joint.transfer_function("tua")
    with pytest.raises(UnknownNameError, match="input of the joint 'tau_l'.* Known: dq_l, tau_m"):
        joint.transfer_function("tau", "tau_l")


def test_transfer_functions_are_minimal() -> None:
    """The free motion of the whole joint is in its angles alone, not in torque and velocities."""
    orders = {"full_dynamics": (5, 5, 6), "rigid_gearbox": (3, 3, 4), "output_fixed": (4, 4, 4)}
    for structure, expected in orders.items():
        joint = load_joint("example", structure, effects={})
        for dt in (None, 1e-3):
            system = joint.state_space(dt)
            for output, order in zip(("tau", "dq_m", "q_m"), expected, strict=True):
                transfer = joint.transfer_function(output, dt=dt)
                assert len(transfer.poles()) == order
                w = 2j * np.pi * np.array([1.0, 30.0])
                at = w if dt is None else np.exp(w * dt)
                whole = system(at)[system.output_labels.index(output), 0]
                np.testing.assert_allclose(transfer(at), whole, rtol=1e-5)
