"""Writes tests/golden/electric_motor.json: what gym-electric-motor computes for a motor of ours.

It needs gym-electric-motor, which is no dependency, in an environment of its own:

    python -m venv gem && gem/bin/pip install gym-electric-motor==3.0.3
    gem/bin/python tools/electric_motor.py
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from gym_electric_motor import physical_systems as gem
from gym_electric_motor.constraints import SquaredConstraint
from gym_electric_motor.core import ElectricMotorEnvironment
from gym_electric_motor.physical_systems.physical_systems import SynchronousMotorSystem
from gym_electric_motor.reference_generators import ConstReferenceGenerator
from gym_electric_motor.reward_functions import WeightedSumOfErrors

PAGE = Path(__file__).parents[1] / "tests" / "golden" / "electric_motor.json"
MOTOR = {"p": 6, "r_s": 0.318, "l_d": 2e-4, "l_q": 2e-4, "psi_p": 2 * 0.078 / 18, "j_rotor": 0.0}
SUPPLY, PEAK, DT, SPEED = 48.0, 30.0, 1e-4, 150.0
INERTIA, DAMPING = 5e-5, 2e-4
SAMPLES_A_LEVEL = 10
LARGE = {"i": 1e3, "u": 2 * SUPPLY, "omega": 1e4, "torque": 0.0}
ACTIONS = [[0.25, 0.0]] * 10 + [[0.35, 0.05]] * 10 + [[0.9, 0.0]] * 20
"""Voltages v_q and v_d over the supply, in the end too much of them."""


def system(load: Any, limits: dict[str, float]) -> Any:
    """Return a motor with d-q voltages as its input, integrated to 1e-12."""
    return SynchronousMotorSystem(
        control_space="dq",
        supply=gem.IdealVoltageSupply(u_nominal=2 * SUPPLY),
        converter=gem.ContB6BridgeConverter(),
        motor=gem.PermanentMagnetSynchronousMotor(
            motor_parameter=MOTOR, limit_values=limits, nominal_values=limits
        ),
        load=load,
        ode_solver=gem.ScipyOdeSolver(rtol=1e-12, atol=1e-12, nsteps=10000),
        tau=DT,
    )


def motion(load: Any, levels: Any) -> list[list[float]]:
    """Return [i_q, i_d, torque, speed] at the end of each level of voltages (v_q, v_d)."""
    motor, rows = system(load, LARGE), []
    picked = [list(motor.state_names).index(n) for n in ("i_sq", "i_sd", "torque", "omega")]
    motor.reset()
    for v_q, v_d in levels:
        for _ in range(SAMPLES_A_LEVEL):
            state = motor.simulate(np.array([v_d, v_q]) / SUPPLY) * motor.limits
        rows.append(state[picked].tolist())
    return rows


def rewards() -> list[float]:
    """Return the rewards of the torque task until the current passes its limit."""
    env = ElectricMotorEnvironment(
        physical_system=system(gem.ConstantSpeedLoad(omega_fixed=SPEED), LARGE | {"i": PEAK}),
        reference_generator=ConstReferenceGenerator("torque", 0.5),
        reward_function=WeightedSumOfErrors({"torque": 1.0}, bias="positive"),
        constraints=(SquaredConstraint(("i_sq", "i_sd")),),
        visualization=(),
    )
    env.reset()
    found = []
    for v_q, v_d in ACTIONS:
        _, reward, terminated, *_ = env.step(np.array([v_d, v_q]))
        found.append(float(reward))
        if terminated:
            return found
    raise AssertionError("The last voltages end the episode.")


def main() -> None:
    """Write the file."""
    rng = np.random.default_rng(1)
    levels = np.column_stack([rng.uniform(-20, 20, 20), rng.uniform(-8, 8, 20)]).round(1)
    free = gem.PolynomialStaticLoad(
        load_parameter={"a": 0.0, "b": DAMPING, "c": 0.0, "j_load": INERTIA},
        limits={"omega": 1e4},
    )
    content = {
        "source": f"gym-electric-motor {version('gym-electric-motor')}, tools/electric_motor.py",
        "motor": MOTOR | {"j": INERTIA, "damping": DAMPING, "v_0": SUPPLY, "i_p": PEAK},
        "dt": DT,
        "speed": SPEED,
        "samples_a_level": SAMPLES_A_LEVEL,
        "levels": levels.tolist(),
        "held": motion(gem.ConstantSpeedLoad(omega_fixed=SPEED), levels),
        "free": motion(free, levels),
        "actions": ACTIONS,
        "rewards": rewards(),
    }
    lines = (f"{json.dumps(name)}: {json.dumps(value)}" for name, value in content.items())
    PAGE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
