"""Millions of substeps of random valid joints: no NaN, no energy from nothing.

    python -m tests.physics.soak --substeps 1e8 --seed 0

Every case draws a joint (shipped, or a random one), a structure, a drive, effects with values over
their whole plausible ranges, an initial state and a command, and runs at 1 ms with 1 to 10
substeps. What is checked depends on what the case allows:

    free     No command, no load, passive effects: the stored energy never rises in a control step.
    driven   The motor's torque is constant over a control step and so known: the stored energy
             rises by no more than the work of motor and load.
    bounded  External torques are bounded by F: sqrt(E) rises by at most F t / sqrt(2 I).
    finite   What else there is (a load that is moved, ripple that feeds back).

Every bound holds to rounding, which grows with the stiffness per step (`rounding`), and to the
tolerance of the solver (`SOLVED`). Drives with inductance are `bounded`: currents and mechanics
take turns, which keeps their energy to second order only.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cjt_gym.errors import SimulationError
from cjt_gym.joint import (
    DRIVES,
    EFFECTS,
    STRUCTURES,
    Effect,
    Joint,
    joint_names,
    load_joint,
    load_joint_file,
)
from cjt_gym.joint.batch import longest_substep
from cjt_gym.joint.kernel.arrays import K_M, TREMOR, VOLUNTARY
from cjt_gym.joint.kernel.spring_table import spring_rows
from tests.physics.cases import DT, EPS, Floats, Trace, traced

MOST_SUBSTEPS = 100  # of a drive with inductance that asks for more, another joint is drawn
STEPS = 500
FEEDBACK = ("gear_ripple", "current_control")
"""A share of the transmitted torque comes back, of either sign; a drive that feeds energy in."""
KNOWN = [  # joints for every structure and drive
    name
    for name in joint_names()
    if all(s in load_joint_file(name).parameters for s in ("k_g", "k_b", "r", "i_p", "v_0"))
]
BY_ANGLE = ("cogging", "gear_ripple", "commutation_ripple", "current_offset")
WITHIN_A_STEP = ("current_lag", "current_rate_limit", "command_delay")
SOLVED = 1e-9  # relative tolerance of the search for mean velocities
Random = np.random.Generator


@dataclass
class Case:
    """One random joint and what is done to it.

    Attributes:
        joint: The joint.
        substeps: Substeps per control step.
        commands: Currents [A] or voltages [V].
        load: Load torque [N m] or load velocity [rad/s].
        x0: Initial state.
        seed: Seed of its noise.
        voltage: Whether the commands are voltages.
    """

    joint: Joint
    substeps: int
    commands: Floats
    load: Floats
    x0: Floats
    seed: int
    voltage: bool

    def run(self) -> Trace:
        """Simulate it."""
        return traced(
            self.joint,
            self.commands,
            self.load,
            h=DT / self.substeps,
            x0=self.x0,
            seed=self.seed,
            voltage=self.voltage,
        )

    def __str__(self) -> str:
        """Say all that is needed to run it again."""
        values = {s: q.value for s, q in self.joint.parameters.quantities.items()}
        return (
            f"{self.joint.file.parameters.name} {self.joint.structure} {self.joint.drive} "
            f"substeps={self.substeps} voltage={self.voltage} seed={self.seed}\n"
            f"  x0={self.x0.tolist()}\n  effects={dict(self.joint.effects)}\n  parameters={values}"
        )


def log_uniform(rng: Random, low: float, high: float) -> float:
    """Draw evenly over the orders of magnitude."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def random_parameters(rng: Random) -> dict[str, float]:
    """Return parameters over the range of the shipped joints and an order beyond."""
    drawn = {
        "I_m": log_uniform(rng, 1e-3, 10.0),
        "I_g": log_uniform(rng, 1e-3, 10.0),
        "I_l": log_uniform(rng, 1e-4, 10.0),
        "k_g": log_uniform(rng, 100.0, 1e5),
        "k_b": log_uniform(rng, 100.0, 1e5),
        "d_mg": rng.choice([0.0, log_uniform(rng, 1e-2, 400.0)]),
        "d_gl": rng.choice([0.0, log_uniform(rng, 1e-2, 400.0)]),
        "k_t": log_uniform(rng, 0.01, 0.2),
        "n": log_uniform(rng, 1.0, 200.0),
        "r": log_uniform(rng, 0.05, 5.0),
        "l_a": log_uniform(rng, 2e-5, 5e-3),
        "v_0": log_uniform(rng, 10.0, 400.0),
        "i_p": log_uniform(rng, 1.0, 100.0),
        "p": float(rng.integers(1, 20)),
    }
    for symbol in ("d_m", "d_g", "d_l"):
        drawn[symbol] = drawn[f"{symbol}_n"] = float(
            rng.choice([0.0, log_uniform(rng, 1e-3, 20.0)])
        )
    return drawn


def random_values(rng: Random, effect: Effect) -> dict[str, Any]:
    """Return values of an effect over its whole plausible range, neutral now and then."""
    count, values = int(rng.integers(1, 4)), {}
    for p in effect.parameters:
        optional = p.symbol not in effect.size or len(effect.size) > 1
        if optional and p.neutral is not None and not p.series and rng.random() < 0.3:
            values[p.symbol] = max(p.neutral, p.low) if p.neutral == 0.0 else p.neutral
            continue
        low = p.low if p.low > 0.0 else 1e-4 * p.high
        drawn = [
            log_uniform(rng, low, p.high) * (rng.choice([-1.0, 1.0]) if p.signed else 1.0)
            for _ in range(count if p.series else 1)
        ]
        values[p.symbol] = tuple(drawn) if p.series else drawn[0]
    if effect.name == "gear_ripple":  # a share of one and more feeds itself
        share = sum(abs(x) for x in (*values["a"], *values["b"])) * max(values["scale"], 1e-9)
        values["scale"] *= min(1.0, 0.5 / share)
    if effect.name == "spring_table":  # it rises from point to point
        values["deflection"] = tuple(sorted(abs(x) for x in values["deflection"]))
        values["torque"] = tuple(sorted(abs(x) for x in values["torque"]))
    if effect.name == "current_control":  # no faster than its samples allow
        values["bandwidth"] = min(values["bandwidth"], 0.05 * values["rate"])
    if "elements" in values:
        values["elements"] = float(rng.integers(0, 9))
    return values


def random_effects(rng: Random, structure: str, drive: str) -> dict[str, dict[str, Any]]:
    """Return a random subset of what can act, one shared dq_0, and one of each that exclude."""
    able = [e for e in EFFECTS.values() if e.acts_in(STRUCTURES[structure], drive)]
    share, dq_0 = (
        rng.choice([0.1, 0.3, 0.6]),
        float(rng.choice([0.0, log_uniform(rng, 1e-5, 0.05)])),
    )
    quiet = rng.random() < 0.6  # passive effects alone, whose energy is known
    chosen: dict[str, dict[str, Any]] = {}
    for effect in able:
        if rng.random() > share or any(other in chosen for other in effect.excludes):
            continue
        if quiet and (effect.name in BY_ANGLE or effect.name in WITHIN_A_STEP):
            continue
        chosen[effect.name] = random_values(rng, effect)
        if "dq_0" in chosen[effect.name]:
            chosen[effect.name]["dq_0"] = dq_0
    return chosen


def random_signal(rng: Random, size: float) -> Floats:
    """Return zero, a constant, bang-bang, white noise or a sine, shape (STEPS,)."""
    t, kind = np.arange(STEPS) * DT, rng.integers(5)
    if kind == 0:
        return np.zeros(STEPS)
    if kind == 1:
        return np.full(STEPS, size * rng.uniform(-1.0, 1.0))
    if kind == 2:
        return np.asarray(size * np.sign(np.sin(2 * np.pi * log_uniform(rng, 1.0, 400.0) * t + 1)))
    if kind == 3:
        return np.asarray(size * rng.uniform(-1.0, 1.0, STEPS))
    return np.asarray(size * np.sin(2 * np.pi * log_uniform(rng, 0.5, 300.0) * t))


def random_case(rng: Random) -> Case:
    """Draw a case."""
    structure, drive = str(rng.choice(list(STRUCTURES))), str(rng.choice(list(DRIVES)))
    if rng.random() < 0.5:
        drive = "current"
    own = random_parameters(rng) if rng.random() < 0.7 else None
    name = "generic" if own else str(rng.choice(KNOWN))
    effects = random_effects(rng, structure, drive)
    joint = load_joint(name, structure, drive, effects=effects, parameters=own)
    p = joint.packed()[0][0]
    voltage = drive != "current" and bool(rng.random() < 0.5)
    peak = p["v_0"] if voltage else min(p["i_p"], 1e3)
    still = rng.random() < 0.4
    fixed = joint.structure_row.output_fixed
    commands = np.zeros(STEPS) if still else random_signal(rng, rng.choice([0.1, 1.0, 2.0]) * peak)
    load = np.zeros(STEPS)
    if not still and rng.random() < 0.5:
        load = random_signal(rng, 1.0 if fixed else log_uniform(rng, 0.1, 100.0))
    size = log_uniform(rng, 1e-4, 1.0)
    x0 = np.concatenate([rng.normal(0.0, 0.05 * size, 3), rng.normal(0.0, 3.0 * size, 3)])
    if fixed:
        x0[5] = 0.0
    seed = int(rng.integers(2**31))
    substeps = max(int(rng.integers(1, 11)), math.ceil(1.5 * DT / longest_substep(joint)))
    if substeps > MOST_SUBSTEPS:
        return random_case(rng)
    return Case(joint, substeps, commands, load, x0, seed, voltage)


def inertias(case: Case) -> Floats:
    """Return the inertia that each body moves [kg m^2], shape (3,)."""
    p, groups = case.joint.packed()[0][0], case.joint.structure_row.groups
    own = [p["I_m"], p["I_g"], p["I_l"] if groups[2] >= 0 else np.inf]
    return np.array([sum(own[b] for b in range(3) if groups[b] == g) for g in groups])


def rounding(case: Case) -> float:
    """Return the relative rounding of energy in a control step: eps times (omega h)^2."""
    p, groups, h = case.joint.packed()[0][0], case.joint.structure_row.groups, DT / case.substeps
    stiffness = (groups[0] != groups[1]) * p["k_g"] + (groups[1] != groups[2]) * p["k_b"]
    rows = spring_rows(case.joint.effects, "the table")
    if rows.size:
        stiffness += p["table_scale"] * (np.diff(rows[:, 1]) / np.diff(rows[:, 0])).max() * 3.0
    return float(
        64.0 * EPS * case.substeps * max(1.0, 2.0 * h**2 * stiffness / inertias(case).min())
    )


def kind_of(case: Case) -> str:
    """Return what can be checked of a case."""
    effects, fixed = case.joint.effects, case.joint.structure_row.output_fixed
    idle = not case.commands.any() and not case.load.any()
    moved = fixed and (case.load.any() or "load_motion" in effects)
    if moved or any(name in effects for name in FEEDBACK):
        return "finite"
    pushes = ("torque_offset", "command_noise", "human_torque", *BY_ANGLE)
    with_inductance = case.joint.drive in ("rl", "dq")  # exchanges energy to second order in h
    if idle and not with_inductance and not any(name in effects for name in pushes):
        return "free"
    if case.joint.drive == "current" and not any(n in effects for n in (*BY_ANGLE, *WITHIN_A_STEP)):
        return "driven"
    return "bounded"


def torque_bound(case: Case) -> float:
    """Return a bound on all torques on the motor that are not its own motion's [N m]."""
    record, ripple = case.joint.packed()
    p, peak = record[0], record[0]["k_t"] * record[0]["n"] * record[0]["i_p"]
    total = peak + abs(p["torque_offset"])
    total += p["k_t"] * p["n"] * (abs(p["offset_a"]) + abs(p["offset_b"]))
    for _, a, b, kind in ripple:
        scale = p["cogging_scale"] if kind == 0.0 else p["commutation_scale"] * peak
        total += (abs(a) + abs(b)) * scale
    return float(total)


def excess(case: Case, trace: Trace, kind: str) -> float:
    """Return by how much the energy exceeds what is allowed, per allowance; <= 1 is good."""
    energy, allowed = trace.energy, rounding(case)
    if not np.isfinite(trace.x).all() or not np.isfinite(energy).all():
        return math.inf
    if kind == "finite":
        return 0.0
    p = case.joint.packed()[0][0]
    moved = np.diff(trace.x, axis=0)
    free_load = case.joint.structure_row.groups[2] >= 0
    pushed = (case.load + trace.memory[1:, VOLUNTARY] + trace.memory[1:, TREMOR]) * free_load
    tau_m = trace.memory[1:, K_M] * trace.currents[1:, 0] + p["torque_offset"]
    angles = EPS * np.abs(trace.x[:, :3]).max()
    if kind == "bounded":
        inertia, steps = inertias(case), np.arange(1, STEPS + 1)
        rate = torque_bound(case) / math.sqrt(2 * inertia[0]) + np.abs(pushed) / math.sqrt(
            2 * inertia[2]
        )
        limit = (math.sqrt(energy[0]) + DT * np.cumsum(rate * np.ones(STEPS))) ** 2
        return float((energy[1:] / (limit * (1.0 + allowed * steps) + 1e-12)).max())
    work = tau_m * moved[:, 0] + pushed * moved[:, 2] if kind == "driven" else np.zeros(STEPS)
    forces = np.abs(tau_m).max() + np.abs(pushed).max() + p["weight"]
    slack = (
        max(allowed, SOLVED) * (energy.max() + np.abs(work).max())
        + 64 * angles * forces
        + 64 * EPS * p["weight"]
        + 1e-18
    )
    return float(((np.diff(energy) - work) / slack).max())


@dataclass
class Tally:
    """What a soak has done so far."""

    substeps: int = 0
    cases: Counter[str] = field(default_factory=Counter)
    worst: dict[str, float] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)

    def add(self, case: Case) -> None:
        """Run one case and note the result."""
        kind = kind_of(case)
        try:
            value = excess(case, case.run(), kind)
        except SimulationError as error:
            value = math.inf
            self.failures.append(f"{kind} {error}\n{case}")
        if math.isnan(value) or 1.0 < value < math.inf:
            self.failures.append(f"{kind} {value:.3g}\n{case}")
        self.substeps += STEPS * case.substeps
        self.cases[kind] += 1
        self.worst[kind] = max(self.worst.get(kind, 0.0), value)


def soak(substeps: int, seed: int, *, progress: bool = False) -> Tally:
    """Run random cases until that many substeps are done."""
    rng, tally, said = np.random.default_rng(seed), Tally(), time.monotonic()
    while tally.substeps < substeps:
        known = len(tally.failures)
        tally.add(random_case(rng))
        for failure in tally.failures[known:] if progress else ():
            print(failure, flush=True)  # noqa: T201
        if progress and time.monotonic() - said > 60.0:
            said = time.monotonic()
            print(f"{tally.substeps:.3g} substeps, {len(tally.failures)} failures", flush=True)  # noqa: T201
    return tally


def main() -> int:
    """Run from the command line; exits with 1 if any case fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--substeps", type=float, default=1e8, help="how many to run")
    parser.add_argument("--seed", type=int, default=0, help="seed of all cases")
    given = parser.parse_args()
    tally = soak(int(given.substeps), given.seed, progress=True)
    worst = {kind: float(f"{value:.3g}") for kind, value in tally.worst.items()}
    print(  # noqa: T201
        f"{tally.substeps:.4g} substeps, cases {dict(tally.cases)}, {len(tally.failures)} failed; "
        f"largest excess of energy, per allowance: {worst}"
    )
    return 1 if tally.failures else 0


if __name__ == "__main__":
    sys.exit(main())
