"""A compliant joint moves a one-link arm in MuJoCo, under impedance control, with a picture.

Around a torque controller with a disturbance observer stands an impedance: a spring and a damper
towards a moving angle, and the weight of the arm. The picture shows angle, torque, and the energy
that passes from the actuator into the arm.

Run it with  python examples/arm.py arm.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines.table import make_controller
from cjt_gym.joint import load_joint
from cjt_gym.robots import CoupledRobot, load_model

Floats = NDArray[np.float64]
STIFFNESS, DAMPING = 150.0, 10.0
WEIGHT = 9.81 * (1.5 * 0.2 + 3.0 * 0.45)
COLUMNS = ("t", "wanted", "q_l", "asked", "tau", "given", "taken")


def run(seconds: float = 3.0) -> dict[str, Floats]:
    """Return the columns of a run."""
    joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects=["coulomb", "noise"])
    robot = CoupledRobot(load_model("arm"), {"elbow": joint})
    port = robot.ports["elbow"]
    law = make_controller("pid_inner_dob", joint, robot.dt)
    (seen,) = robot.reset(seed=0)
    rows = []
    for k in range(round(seconds / robot.dt)):
        t = k * robot.dt
        wanted, rate = 0.8 * (1.0 - np.cos(np.pi * t)), 0.8 * np.pi * np.sin(np.pi * t)
        q, dq = float(seen.q_l[0]), float(seen.dq_l[0])
        asked = STIFFNESS * (wanted - q) + DAMPING * (rate - dq) + WEIGHT * np.sin(q)
        rows.append((t, wanted, q, asked, port.torque, port.given, port.taken))
        (seen,) = robot.step(law.act(seen, np.array([asked])))
    return dict(zip(COLUMNS, np.array(rows).T, strict=True))


def draw(run: dict[str, Floats], path: Path) -> None:
    """Write the picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    rows = (
        ("angle [rad]", {"wanted": "wanted", "q_l": "measured"}),
        ("torque [N m]", {"asked": "asked for", "tau": "of the joint"}),
        ("energy [J]", {"given": "left the actuator", "taken": "entered the arm"}),
    )
    for axes, (label, names) in zip(figure.subplots(3, 1, sharex=True), rows, strict=True):
        for (name, text), style in zip(names.items(), ("--", "-"), strict=True):
            axes.plot(run["t"], run[name], style, label=text)
        axes.set_ylabel(label)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    axes.set_xlabel("time [s]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def main() -> None:
    """Run, draw and say how well it went."""
    found = run()
    draw(found, Path(sys.argv[1] if len(sys.argv) > 1 else "arm.png"))
    late = found["t"] > 0.5
    for one, other, unit in (("wanted", "q_l", "rad"), ("asked", "tau", "N m")):
        error = np.sqrt(np.mean((found[one] - found[other])[late] ** 2))
        sys.stdout.write(f"rms of {one} - {other}: {error:.4f} {unit}\n")
    apart = np.abs(found["given"] - found["taken"]).max()
    sys.stdout.write(f"energy given and taken differ by at most {apart:.2e} J\n")


if __name__ == "__main__":
    main()
