"""The current controller inside a voltage drive."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cjt_gym.baselines.current_control import CurrentController
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint, load_joint
from cjt_gym.joint.batch import JointBatch
from cjt_gym.plant import SimulatedPlant

NAME, FIXED = "orange_80_6000", "output_fixed_rigid_gearbox"
VOLTAGE_DRIVES = ("static", "rl", "dq")
DRIVES = pytest.mark.parametrize("drive", VOLTAGE_DRIVES)
RATE = 1e4


def closed(drive: str, structure: str = FIXED, parameters: Any = None, **loop: float) -> Joint:
    effects = {"current_control": {"bandwidth": 300.0, "rate": RATE, **loop}}
    return load_joint(NAME, structure, drive, effects=effects, parameters=parameters)


def per_ampere(joint: Joint) -> float:
    return joint.parameters.k_t * joint.parameters.n


@DRIVES
def test_it_is_the_controller_that_commands_voltages(drive: str) -> None:
    """The same law outside, on the same joint without a loop, gives the same currents."""
    dt, steps = 1.0 / RATE, 400
    rng = np.random.default_rng(0)
    wanted = np.repeat(rng.uniform(-20.0, 20.0, steps // 40), 40)
    joint = closed(drive, "full_dynamics", {"I_l": 1.0})
    inside = joint.simulate(wanted * per_ampere(joint), dt=dt, dt_physics=dt / 5)
    bare = load_joint(NAME, "full_dynamics", drive, effects={}, parameters={"I_l": 1.0})
    law = CurrentController(bare, dt, 300.0)
    batch = JointBatch(bare, 1, dt, dt / 5, voltage=True)
    batch.restart(np.ones(1, dtype=np.bool_), np.zeros(1))
    outside = np.zeros((steps, 2))
    for k in range(steps):
        outside[k] = batch.arrays.currents[0]
        dq_m = batch.arrays.state[:, 3].copy()
        volts = law.act(wanted[k : k + 1], batch.arrays.currents, dq_m, np.array([k == 0]))
        batch.step(volts, np.zeros(1))
    np.testing.assert_allclose(inside["true_i"], outside[:, 0], rtol=0, atol=1e-12 * 20.0)
    np.testing.assert_allclose(inside["true_i_d"], outside[:, 1], rtol=0, atol=1e-12 * 20.0)


@DRIVES
def test_the_current_follows_as_a_first_order_lag(drive: str) -> None:
    joint, dt = closed(drive, bandwidth=100.0), 1e-5
    record = joint.simulate(np.full(2000, 25.0), dt=dt, dt_physics=dt)
    lag = 25.0 / per_ampere(joint) * (1.0 - np.exp(-2.0 * np.pi * 100.0 * record["t"]))
    late = 1.0 / RATE  # the voltage is held over a sample
    bound = 2.0 * np.pi * 100.0 * 2.0 * late * lag[-1]
    np.testing.assert_allclose(record["true_i"], lag, rtol=0, atol=bound)


@pytest.mark.parametrize("drive", ["rl", "dq"])
def test_the_voltage_is_held_over_a_sample_of_the_controller(drive: str) -> None:
    record = closed(drive).simulate(np.full(400, 25.0), dt=1e-5, dt_physics=1e-5)
    held = record["true_v"][1:].reshape(-1)[:390].reshape(-1, 10)
    assert (held == held[:, :1]).all()
    assert len(np.unique(held[:, 0])) > 20


def test_a_controller_that_is_told_wrongly_is_right_in_the_end() -> None:
    told = {"r": 0.9 * 0.318, "l_a": 2.6e-4, "k_t": 0.07}
    joint = closed("dq", parameters={"d_gl": 200.0}, **told)
    record = joint.simulate(np.full(3000, 25.0), dt=1e-4)
    np.testing.assert_allclose(record["true_tau_m"][-500:], 25.0, rtol=1e-3)
    exact = closed("dq").simulate(np.full(3000, 25.0), dt=1e-4)
    assert abs(record["true_i"][:30] - exact["true_i"][:30]).max() > 0.1


def test_the_axes_are_decoupled_at_speed() -> None:
    """A step of the q current leaves the d current near zero while the rotor turns."""
    joint = load_joint(
        NAME,
        "output_fixed_rigid_gearbox",
        "dq",
        effects={"current_control": {"bandwidth": 500.0, "rate": 2e4}},
    )
    speed, steps = 4.0, 4000
    x0 = [0.0, 0.0, 0.0, speed, speed, speed]
    tau = np.where(np.arange(steps) < 2000, 20.0, 60.0)
    record = joint.simulate(tau, np.full(steps, speed), dt=5e-5, dt_physics=2.5e-5, x0=x0)
    after = slice(2000, 2200)
    assert abs(record["true_i_d"][after]).max() < 0.1 * (40.0 / per_ampere(joint))


@DRIVES
def test_the_supply_does_not_wind_it_up(drive: str) -> None:
    """Where the back-EMF leaves too little voltage the current comes back without overshoot."""
    steps, speed = 6000, 7.5
    load = speed * np.clip(1.0 - (np.arange(steps) - 3000) / 1000, 0.0, 1.0)
    x0 = [0.0, 0.0, 0.0, speed, speed, speed]
    supply = 49.0 * (2.0 / 3.0 if drive == "dq" else 1.0)  # little more than the back-EMF
    joint = closed(drive, parameters={"d_gl": 200.0, "v_0": supply})
    record = joint.simulate(np.full(steps, 100.0), load, dt=1e-4, x0=x0)
    wanted = 100.0 / per_ampere(joint)
    assert abs(record["true_i"][2000:3000]).max() < 0.7 * wanted
    assert record["true_i"][3000:].max() < 1.1 * wanted
    np.testing.assert_allclose(record["true_i"][-500:], wanted, rtol=0.01)


def test_records_say_what_the_drive_does() -> None:
    joint = closed("dq")
    record = joint.simulate(np.full(50, 25.0), dt=1e-4)
    units = {n: record.units[n] for n in ("true_i_d", "true_v", "true_v_d", "true_tau_m")}
    assert units == {"true_i_d": "A", "true_v": "V", "true_v_d": "V", "true_tau_m": "N m"}
    np.testing.assert_allclose(record["true_tau_m"], per_ampere(joint) * record["true_i"])
    ideal = load_joint(NAME, FIXED, "dq", effects={}).simulate(np.full(50, 25.0), dt=1e-4)
    p, turn = joint.parameters, per_ampere(joint)
    held = p.r * 25.0 / turn + 2.0 / 3.0 * turn * ideal["true_dq_m"][1:]
    np.testing.assert_allclose(ideal["true_v"][1:], held, rtol=0, atol=1e-2)
    assert "true_v" not in load_joint(NAME, FIXED).simulate(np.zeros(5))


@DRIVES
def test_a_plant_has_one_unless_it_is_told_otherwise(drive: str) -> None:
    plant = SimulatedPlant(load_joint(NAME, FIXED, drive, effects={}))
    assert plant.joint.effects["current_control"]["bandwidth"] == 500.0
    off = load_joint(NAME, FIXED, drive, effects={"current_control": {"bandwidth": 0.0}})
    currents = []
    for one in (plant, SimulatedPlant(off)):
        one.reset(seed=0)
        command = np.full(1, 25.0)
        currents.append([one.step(command).i[0] for _ in range(20)])
        told = one.drive_signals()
        assert told["tau_m"] == pytest.approx(25.0, rel=0.01)
        assert set(told) == {"i_d", "v", "v_d", "tau_m"}
    assert currents[0] != currents[1]
    varied = SimulatedPlant(load_joint(NAME, FIXED, drive, effects={}), randomization="mild")
    assert "current_control.bandwidth" in varied.randomization
    torque = SimulatedPlant(load_joint(NAME, FIXED))
    assert "current_control" not in torque.joint.effects
    assert set(torque.drive_signals()) == {"tau_m"}


def test_a_slow_simulation_gets_a_slow_loop() -> None:
    plant = SimulatedPlant(load_joint(NAME, FIXED, "static", effects={}), dt_physics=1e-3)
    loop = plant.joint.effects["current_control"]
    assert (loop["rate"], loop["bandwidth"]) == (1000.0, 50.0)


def test_a_loop_that_is_too_fast_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"bandwidth of effect current_control .* <= 795"):
        closed("dq", bandwidth=2000.0).simulate(np.zeros(5))
    with pytest.raises(
        ConfigurationError, match=r"dt_physics must be <= 0.0001 s, as .*current_con"
    ):
        closed("dq").simulate(np.zeros(5), dt=1e-3, dt_physics=5e-4)
    volts = closed("rl").simulate(voltage=np.ones(5), dt=1e-3, dt_physics=5e-4)
    assert np.isfinite(volts["true_i"]).all()
