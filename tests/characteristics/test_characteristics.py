"""Characteristics against what they mean: integration, brute force, the simulated joint."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cjt_gym.characteristics import (
    CHARACTERISTICS,
    acting,
    best_efficiency,
    best_point,
    changing,
    characteristic,
    characteristics,
    coulomb,
    efficiency,
    friction,
    highest_speed,
    impedance_range,
    resonance,
    response,
    rms,
    steady_temperature,
    temperatures,
    time_to_critical,
    to_link,
    to_motor,
    torque_bandwidth,
    torque_limits,
    viscous,
)
from cjt_gym.characteristics.table import GROUPS
from cjt_gym.errors import ConfigurationError, ParameterError, UnknownNameError
from cjt_gym.joint import (
    JointFile,
    JointParameters,
    Quantity,
    joint_names,
    load_joint,
    load_joint_file,
)
from cjt_gym.joint.files.parameter_table import AXES


def shipped(name: str = "orange_80_6000") -> JointParameters:
    return load_joint_file(name).parameters


def heated(p: JointParameters, tau: float, t: np.ndarray, start: tuple[float, float]) -> np.ndarray:
    """Return the two temperatures by numerical integration."""
    current = tau / (p.k_t * p.n)
    c_w, c_h = p.T_thw / p.r_th1, p.T_thm / p.r_th2

    def rate(_: float, x: np.ndarray) -> list[float]:
        loss = p.r * (1.0 + p.a_CU * (x[0] - p.Tmp_ANom)) * current**2
        flow = (x[0] - x[1]) / p.r_th1
        return [(loss - flow) / c_w, (flow - (x[1] - p.Tmp_ANom) / p.r_th2) / c_h]

    found = solve_ivp(rate, (0.0, t[-1]), start, t_eval=t, rtol=1e-10, atol=1e-9, method="LSODA")
    return np.asarray(found.y.T)


class TestTable:
    def test_rows_are_complete(self) -> None:
        for row in CHARACTERISTICS.values():
            assert row.group in GROUPS
            assert row.text.endswith(".")
            assert all(row.unit(axis) for axis in AXES)

    @pytest.mark.parametrize("name", joint_names())
    def test_every_shipped_joint_has_those_that_its_parameters_allow(self, name: str) -> None:
        values = characteristics(shipped(name))
        assert all(not math.isnan(value) and value >= 0.0 for value in values.values())
        assert len(values) == (2 if name == "emps" else len(CHARACTERISTICS))
        endless = {name for name, value in values.items() if math.isinf(value)}
        assert all(CHARACTERISTICS[name].infinite for name in endless)

    def test_a_name_or_parameter_that_is_missing(self) -> None:
        with pytest.raises(UnknownNameError, match="Did you mean 't_p'"):
            characteristic(shipped(), "t_pp")
        with pytest.raises(ParameterError, match="i_p"):
            characteristic(JointParameters.from_values("bare", {"k_t": 0.1, "n": 50.0}), "t_p")

    def test_tolerances_are_propagated(self) -> None:
        p = shipped()
        assert CHARACTERISTICS["t_p"].tolerance(p) is None
        p = p.replace(
            k_t=Quantity(0.078, "N m/A", tolerance=0.03), i_p=Quantity(30.0, "A", tolerance=0.04)
        )
        assert CHARACTERISTICS["t_p"].tolerance(p) == pytest.approx(0.05 * 187.2, rel=1e-3)
        p = p.replace(r=Quantity(0.318, "Ohm", tolerance=0.02))
        expected = math.hypot(0.02, 0.06) * p.r / (p.k_t * p.n) ** 2
        assert CHARACTERISTICS["dq_over_dm"].tolerance(p) == pytest.approx(expected, rel=1e-3)


class TestPlane:
    def test_the_steady_speed_of_the_simulated_joint_is_the_no_load_speed(self) -> None:
        none = {f"d_c{body}{side}": 0.0 for body in "mgl" for side in ("", "_n")}
        joint = load_joint("orange_80_6000", "rigid", drive="static", effects={})
        record = joint.simulate(voltage=np.full(300, 48.0), dt_physics=1e-4)
        without = characteristic(joint.parameters.replace(**none), "dq_NL")
        assert record["true_dq_m"][-1] == pytest.approx(without, rel=1e-6)

    def test_highest_speed_without_damping_and_with_a_peak_speed(self) -> None:
        p = shipped().replace(d_m=0.0, d_m_n=0.0, d_g=0.0, d_g_n=0.0, dq_p=3.0)
        speeds = highest_speed(p, np.array([1.0, 6.0, 100.0, 200.0]))
        assert speeds.tolist() == [0.0, 3.0, 3.0, 0.0]
        assert highest_speed(p, np.array([18.0]), continuous=True).tolist() == [0.0]

    def test_the_best_point_beats_a_fine_grid(self) -> None:
        for name in ("orange_80_6000", "lime_50_21000", "example"):
            p = shipped(name)
            tau = np.linspace(0.0, characteristic(p, "t_p"), 801)[:, None]
            dq = np.linspace(0.0, characteristic(p, "dq_0"), 801)[None, :]
            grid = float(np.nanmax(efficiency(p, tau, dq)))
            assert grid <= best_efficiency(p) <= grid + 2e-3
            best = float(efficiency(p, *(np.array(x) for x in best_point(p))))
            assert best == pytest.approx(best_efficiency(p), rel=1e-9)

    def test_power_is_balanced(self) -> None:
        p, tau, dq = shipped(), 60.0, 5.0
        current = tau / (p.k_t * p.n)
        heat = p.r * current**2 + friction(p, dq) * dq
        supply = (p.r * current + p.k_t * p.n * dq) * current
        assert 1.0 - heat / supply == pytest.approx(float(efficiency(p, tau, dq)))
        assert np.isnan(efficiency(p, np.array([1.0, 180.0]), np.array([5.0, 7.6]))).all()


class TestHeat:
    def test_temperatures_are_those_of_integration(self) -> None:
        p, t = shipped(), np.arange(0.0, 401.0)
        profile = np.where(np.arange(400) < 150, 60.0, 20.0)
        ours = temperatures(p, profile, 1.0, winding=70.0, housing=30.0)
        first = heated(p, 60.0, t[:151], (70.0, 30.0))
        second = heated(p, 20.0, t[:251], tuple(first[-1]))
        np.testing.assert_allclose(ours[:151], first, rtol=1e-6)
        np.testing.assert_allclose(ours[150:], second, rtol=1e-6)

    @pytest.mark.parametrize(
        ("tau", "winding", "housing"),
        [(187.2, None, None), (40.0, 80.0, 30.0), (25.0, 150.0, 25.0)],
    )
    def test_time_to_critical_ends_at_the_limit(
        self, tau: float, winding: float | None, housing: float | None
    ) -> None:
        p = shipped()
        time = time_to_critical(p, tau, winding, housing)
        assert 0.0 < time < math.inf
        start = (winding or p.Tmp_ANom, housing or p.Tmp_ANom)
        assert heated(p, tau, np.array([0.0, time]), start)[-1, 0] == pytest.approx(p.Tmp_WMax)

    def test_a_hot_winding_that_cools_first_is_followed_past_the_turn(self) -> None:
        p = shipped()
        time = time_to_critical(p, 25.0, 150.0, 25.0)
        seen = heated(p, 25.0, np.linspace(0.0, time, 500), (150.0, 25.0))[:, 0]
        assert seen.min() < 149.0
        assert seen.max() <= p.Tmp_WMax * (1.0 + 1e-6)

    def test_the_rated_torque_ends_at_the_limit_and_never_passes_it(self) -> None:
        for name in ("orange_80_6000", "generic"):
            p = shipped(name)
            rated = characteristic(p, "t_r")
            assert float(steady_temperature(p, rated)) == pytest.approx(p.Tmp_WMax)
            assert time_to_critical(p, 0.999 * rated) == math.inf
            assert time_to_critical(p, 1.01 * rated) < math.inf
            assert time_to_critical(p, 0.0, p.Tmp_WMax + 1.0) == 0.0

    def test_without_heat_from_the_resistance(self) -> None:
        p = shipped().replace(a_CU=0.0)
        assert float(steady_temperature(p, 500.0)) > 1000.0
        assert steady_temperature(shipped(), 500.0) == math.inf

    def test_rms(self) -> None:
        assert rms([3.0, -3.0, 3.0]) == 3.0


class TestFrequency:
    def test_the_locked_response_is_that_of_a_mass_on_a_spring(self) -> None:
        p, f = shipped(), np.array([1.0, 10.0, 22.0, 60.0])
        s, inertia = 2j * np.pi * f, p.I_m + p.I_g
        torque, speed = response(p, f)
        expected = p.k_b / (inertia * s**2 + (p.d_m + p.d_g) * s + p.k_b)
        np.testing.assert_allclose(torque, expected, rtol=1e-10)
        np.testing.assert_allclose(speed, expected * s / p.k_b, rtol=1e-10)
        assert resonance(p) == pytest.approx(math.sqrt(p.k_b / inertia) / (2.0 * math.pi))

    def test_limits_are_reached_together_with_what_they_limit(self) -> None:
        p, f = shipped(), np.array([5.0, 30.0, 80.0])
        limits = torque_limits(p, f, load=1.0)
        torque, speed = response(p, f, load=1.0)
        k = p.k_t * p.n
        current = limits.voltage / np.abs(torque) / k
        volts = np.abs((p.r + 2j * np.pi * f * p.l_a) * current + k * speed * current * k)
        np.testing.assert_allclose(volts, p.v_0, rtol=1e-9)
        np.testing.assert_allclose(limits.current / np.abs(torque) / k, p.i_p, rtol=1e-9)
        motor = limits.continuous / np.abs(torque)
        assert rms(motor[0] * np.sin(np.arange(1000) * 2.0 * np.pi / 1000.0)) == pytest.approx(
            characteristic(p, "t_r")
        )
        assert np.all(limits.lasting <= limits.peak)

    def test_a_simulated_sine_has_the_limited_current(self) -> None:
        joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects={})
        f, amplitude = 10.0, float(torque_limits(joint.parameters, np.array([10.0])).current[0])
        motor = joint.torque_limit * np.sin(2.0 * np.pi * f * np.arange(6000) * 1e-3)
        tau = joint.simulate(motor, dt_physics=1e-4)["true_tau"][-1000:]
        assert math.sqrt(2.0) * rms(tau) == pytest.approx(amplitude, rel=2e-3)

    def test_the_bandwidth_is_where_the_amplitude_ends(self) -> None:
        p = shipped()
        for load in (math.inf, 0.5):
            edge = torque_bandwidth(p, 100.0, load)
            below, above = torque_limits(p, np.array([edge * 0.9999, edge * 1.01]), load).peak
            assert above < 100.0 <= below * 1.001
        assert torque_bandwidth(p, 1e6) == 0.0
        with pytest.raises(ConfigurationError, match="amplitude"):
            torque_bandwidth(p, 0.0)
        with pytest.raises(ConfigurationError, match="> 0 Hz"):
            torque_limits(p, np.array([0.0, 1.0]))

    def test_a_compliant_gearbox_becomes_a_rigid_one(self) -> None:
        p, f = shipped(), np.geomspace(0.1, 60.0, 50)
        stiff = p.replace(k_g=1e11)
        np.testing.assert_allclose(
            response(stiff, f, 0.3, rigid_gearbox=False)[0], response(p, f, 0.3)[0], rtol=1e-5
        )


class TestImpedance:
    def test_own_is_inertia_below_and_spring_above(self) -> None:
        p = shipped()
        width = impedance_range(p, np.array([0.5, 500.0]), 0.01)
        s = 2j * np.pi * width.f
        low = (p.I_m + p.I_g) * s[0] + p.d_m + p.d_g
        assert width.own[0] == pytest.approx(low, rel=2e-3)
        assert width.own[1] == pytest.approx(p.k_b / s[1], rel=3e-3)
        assert width.held[1] == pytest.approx(p.k_b / s[1])

    def test_the_motor_makes_what_the_range_says(self) -> None:
        p, motion = shipped(), 0.002
        f = np.array([1.0, 5.0, 20.0])
        width = impedance_range(p, f, motion)
        gain = np.abs(response(p, f)[0])
        torque = width.radius * 2.0 * np.pi * f * motion / gain
        assert np.all(torque <= characteristic(p, "t_p") * (1.0 + 1e-12))
        assert torque[0] == pytest.approx(characteristic(p, "t_p"))
        assert np.all(width.low <= np.abs(width.own))
        smaller = impedance_range(p, f, motion / 2.0)
        assert np.all(smaller.high > width.high)

    def test_a_held_motor_behind_a_compliant_gearbox(self) -> None:
        p = shipped()
        width = impedance_range(p, np.array([0.01]), 0.01, rigid_gearbox=False)
        both = 1.0 / (1.0 / p.k_b + 1.0 / p.k_g)
        assert abs(width.held[0] * 2j * np.pi * 0.01) == pytest.approx(both, rel=1e-3)


class TestReflection:
    def test_there_and_back(self) -> None:
        inertia = Quantity(0.23, "kg m^2", low=0.2, high=0.25)
        rotor = to_motor(inertia, 80.0)
        assert rotor.number == pytest.approx(3.59375e-5)
        assert (rotor.low, rotor.unit) == (pytest.approx(0.2 / 6400.0), "kg m^2")
        assert to_link(rotor, 80.0).number == pytest.approx(0.23)

    def test_power_is_the_same_on_both_sides(self) -> None:
        torque, speed = Quantity(10.0, "N m"), Quantity(2.0, "rad/s")
        product = to_motor(torque, 50.0).number * to_motor(speed, 50.0).number
        assert product == pytest.approx(20.0)

    def test_a_unit_that_does_not_say_how(self) -> None:
        with pytest.raises(ParameterError, match="J/\\(kg K\\)"):
            to_link(Quantity(380.0, "J/(kg K)"), 80.0)
        with pytest.raises(ConfigurationError, match="must be finite and > 0"):
            to_link(Quantity(1.0, "N m"), 0.0)


class TestEffects:
    """Effects that are other values of parameters enter what the joint can do."""

    def found(self) -> JointFile:
        file = load_joint_file("orange_80_6000")
        interval = Quantity(4.0, "N m", low=3.8, high=4.2)
        return replace(
            file,
            effects={
                "coulomb": {"d_cm": interval},
                "damping": {"d_g": Quantity(3.0, "N m s/rad")},
                "cogging": {
                    "f": Quantity((480.0,), "1/rev"),
                    "a": Quantity((0.5,), "N m"),
                    "b": Quantity((0.0,), "N m"),
                },
            },
        )

    def test_friction_that_was_found_is_in_speed_and_efficiency(self) -> None:
        file = self.found()
        p, nominal = acting(file), file.parameters
        assert (coulomb(p), viscous(p)) == pytest.approx((4.0 + 3.28, 0.0036 + 3.0))
        new, old = characteristics(p), characteristics(nominal)
        slope = old["dq_over_dm"]
        expected = (old["dq_0"] - slope * 7.28) / (1.0 + slope * 3.0036)
        assert new["dq_NL"] == pytest.approx(expected)
        assert new["eta_max"] < old["eta_max"]
        assert changing(file) == ("damping", "coulomb")
        assert CHARACTERISTICS["Mc"].tolerance(p) == pytest.approx(0.4 / 3.92, rel=1e-4)

    def test_the_speed_that_friction_leaves_is_that_of_the_simulated_joint(self) -> None:
        p = acting(self.found())
        effects = {"coulomb": {"d_cm": 4.0}, "damping": {"d_g": 3.0}}
        joint = load_joint("orange_80_6000", "rigid", "static", effects=effects)
        record = joint.simulate(voltage=np.full(300, p.v_0), dt_physics=1e-4)
        assert record["true_dq_m"][-1] == pytest.approx(characteristic(p, "dq_NL"), rel=1e-3)

    def test_a_joint_without_effects_is_as_its_file_says(self) -> None:
        file = load_joint_file("lemon_50_6000")
        assert acting(file) == file.parameters
        assert changing(file) == ()
        breakaway = {"d_sm": Quantity(1.0, "N m"), "v_s": Quantity(0.02, "rad/s")}
        assert acting(replace(file, effects={"stribeck": breakaway})) == file.parameters

    def test_an_effect_on_one_body_leaves_none_of_it_on_the_others(self) -> None:
        file = load_joint_file("orange_80_6000")
        level = {"body": "motor", "d_cm": Quantity(5.0, "N m")}
        assert coulomb(acting(replace(file, effects={"coulomb": level}))) == 5.0

    def test_torque_constant_current_and_stiffness_move_torque_and_resonance(self) -> None:
        file = load_joint_file("orange_80_6000")
        effects = {
            "torque_constant": {"k_t": Quantity(0.07, "N m/A")},
            "stiffness": {"k_b": Quantity(5000.0, "N m/rad")},
            "current_saturation": {"i_p": Quantity(15.0, "A")},
        }
        p = acting(replace(file, effects=effects))
        assert characteristic(p, "t_p") == pytest.approx(0.07 * 80.0 * 15.0)
        ratio = characteristic(p, "f_0") / characteristic(file.parameters, "f_0")
        assert ratio == pytest.approx(np.sqrt(5000.0 / 6000.0))


def test_a_datasheet_without_friction_loses_nothing_without_torque() -> None:
    values = {"n": 50.0, "k_t": 0.06, "r": 0.4, "v_0": 48.0, "i_p": 20.0, "I_m": 0.75}
    assert best_efficiency(JointParameters.from_values("new", values)) == pytest.approx(1.0)
