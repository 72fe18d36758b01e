"""Two compliant joints in a MuJoCo leg that squats, under torque controllers, with a picture.

At hip and knee, a torque controller with a disturbance observer stands inside an impedance: a
spring and a damper towards the angles of a squat, and the torque that holds the weight. Energy is
counted at the ports: what left the actuators, what entered the leg, and what it has.

Run it with  python examples/leg.py leg.png
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
NAMES = ("hip", "knee")
STIFFNESS, DAMPING = 400.0, 20.0
LENGTH, FOOT, UPRIGHT = 0.36, 0.035, 0.72
WEIGHT = 9.81 * (8.0 + 2.0)
STAND, DEPTH, PERIOD = 0.45, 0.35, 2.0
COLUMNS = ("t", "wanted", "q", "asked", "tau", "given", "taken", "energy")


def squat(t: float) -> tuple[Floats, Floats]:
    """Return wanted angles [rad] and velocities [rad/s] of hip and knee, the foot under the hip."""
    phase = 2.0 * np.pi * t / PERIOD
    hip = STAND + 0.5 * DEPTH * (1.0 - np.cos(phase))
    rate = np.pi * DEPTH / PERIOD * np.sin(phase)
    return np.array([hip, -2.0 * hip]), np.array([rate, -2.0 * rate])


def holding(q: Floats) -> Floats:
    """Return the torques at hip and knee that hold the weight of trunk and thigh [N m]."""
    shank = LENGTH * np.sin(q[0] + q[1])
    return -WEIGHT * np.array([LENGTH * np.sin(q[0]) + shank, shank])


def run(seconds: float = 4.0) -> dict[str, Floats]:
    """Return the columns of a run; those of the joints have shape (samples, 2)."""
    joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects=["coulomb", "noise"])
    leg = CoupledRobot(load_model("leg"), dict.fromkeys(NAMES, joint))
    laws = [make_controller("pid_inner_dob", joint, leg.dt) for _ in NAMES]
    start = squat(0.0)[0]
    rail = 2.0 * LENGTH * np.cos(start[0]) + FOOT - UPRIGHT
    seen = leg.reset({"hip": start[0], "knee": start[1], "rail": float(rail)}, seed=0)
    rows = []
    for k in range(round(seconds / leg.dt)):
        wanted, rate = squat(k * leg.dt)
        q, dq = np.array([[m.q_l[0], m.dq_l[0]] for m in seen]).T
        asked = STIFFNESS * (wanted - q) + DAMPING * (rate - dq) + holding(q)
        torque, given, taken = np.array(
            [[p.torque, p.given, p.taken] for p in leg.ports.values()]
        ).T
        energy = float(leg.data.energy.sum())
        rows.append((k * leg.dt, wanted, q, asked, torque, given.sum(), taken.sum(), energy))
        torques = zip(laws, seen, asked, strict=True)
        seen = leg.step(np.concatenate([law.act(m, np.array([tau])) for law, m, tau in torques]))
    found = {
        name: np.array(column)
        for name, column in zip(COLUMNS, zip(*rows, strict=True), strict=True)
    }
    found["energy"] -= found["energy"][0]
    return found


def draw(run: dict[str, Floats], path: Path) -> None:
    """Write the picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    angles, torques, energies = figure.subplots(3, 1, sharex=True)
    for k, (name, colour) in enumerate(zip(NAMES, ("C0", "C1"), strict=True)):
        for axes, wanted, found in ((angles, "wanted", "q"), (torques, "asked", "tau")):
            axes.plot(run["t"], run[wanted][:, k], "--", color=colour, lw=0.9)
            axes.plot(run["t"], run[found][:, k], color=colour, label=name)
    angles.set_ylabel("angle [rad]")
    torques.set_ylabel("torque [N m]")
    for name, text, style in (
        ("given", "left the actuators", "--"),
        ("taken", "entered the leg", "-"),
        ("energy", "energy of the leg", ":"),
    ):
        energies.plot(run["t"], run[name], style, label=text)
    energies.set_ylabel("energy [J]")
    energies.set_xlabel("time [s]; dashed angles and torques: wanted")
    for axes in (angles, torques, energies):
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def figures(run: dict[str, Floats]) -> dict[str, float]:
    """Return how well it went, after the first half second."""
    late = run["t"] > 0.5
    found = {}
    for k, name in enumerate(NAMES):
        for one, other, what in (("wanted", "q", "angle [rad]"), ("asked", "tau", "torque [N m]")):
            error = (run[one] - run[other])[late, k]
            found[f"{name}: error of the {what}, rms"] = float(np.sqrt(np.mean(error**2)))
    apart = np.abs(run["given"] - run["taken"])
    found["energy given and taken differ by at most [J]"] = float(apart.max())
    found["energy that entered the leg at the end [J]"] = float(run["taken"][-1])
    found["energy of the leg at the end, over that of the start [J]"] = float(run["energy"][-1])
    found["largest energy of the leg below that of the start [J]"] = float(-run["energy"].min())
    return found


def main() -> None:
    """Run, draw and say how well it went."""
    found = run()
    draw(found, Path(sys.argv[1] if len(sys.argv) > 1 else "leg.png"))
    for name, value in figures(found).items():
        sys.stdout.write(f"{name}: {value:.4f}\n")


if __name__ == "__main__":
    main()
