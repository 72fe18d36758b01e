"""Blind cases: a random joint with hidden effects, two records, and their label."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from cjt_gym.blind.control import Gains
from cjt_gym.blind.defects import Defects, check_defects, draw_defects, not_counted
from cjt_gym.blind.excitation import excitation
from cjt_gym.blind.hidden import Draw
from cjt_gym.blind.joints import Datasheet, as_stated, draw_joint
from cjt_gym.blind.known import KNOWN
from cjt_gym.blind.outside import OUTSIDE
from cjt_gym.blind.plan import Plan, draw_plan
from cjt_gym.blind.plant import CHANNELS, Floats, World
from cjt_gym.blind.replay import noise_floor, replay_errors
from cjt_gym.blind.run import Run, draw_chances, instants, no_chances, run
from cjt_gym.blind.scales import Scales, scales_of
from cjt_gym.blind.signature import signatures
from cjt_gym.blind.state import Q
from cjt_gym.blind.tracking import first_gains, under_control

DURATION: Final = 10.0
"""Usual length of a record [s]."""
ROUGH_STEP: Final = 4e-5
"""Step of the integrator if only the magnitudes of signals without effects are needed [s]."""

SETTLING_TIME: Final = 1.0
"""Time for a locked joint to come to rest before its drive is switched on [s]."""
SETTLING_STEP: Final = 1e-4
"""Step of the integrator meanwhile [s]."""


@dataclass(frozen=True)
class Log:
    """One record of a case.

    Attributes:
        columns: Channels with their time, each of shape (n,).
        mode: "open loop" or "closed loop".
        excitation: Kind of excitation.
    """

    columns: dict[str, Floats]
    mode: str
    excitation: str


@dataclass(frozen=True)
class Case:
    """A joint with hidden effects.

    Attributes:
        sheet: Datasheet of the joint and its records.
        structure: Name of its structure.
        diagnose: Record to diagnose.
        validate: Record to check a diagnosis on.
        label: The hidden effects, how visible each is in the first record, the true values of the
            joint, and the errors of the stated and the true model on the second record.
        world: The true joint, for further experiments.
    """

    sheet: Datasheet
    structure: str
    diagnose: Log
    validate: Log
    label: dict[str, Any]
    world: World


def draw_case(
    seed: int,
    *,
    effects: Iterable[str] | None = None,
    structure: str | None = None,
    excitation: str | None = None,
    closed_loop: bool | None = None,
    strength: float = 1.0,
    duration: float = DURATION,
    joint: int | None = None,
    defects: Iterable[str] = (),
) -> Case:
    """Return a random case, reproducible from its arguments.

    Args:
        seed: Seed of all random numbers.
        effects: Names of the hidden effects, of the table or outside it, each optionally with its
            place as in "coulomb:gear"; None draws them.
        structure: Name of the structure; None draws one that the effects can have.
        excitation: Kind of excitation of the first record; None draws it.
        closed_loop: Whether the first record is taken in a closed loop; None draws it.
        strength: Factor on the magnitudes of the effects, such as SMALL.
        duration: Of each record [s].
        joint: Seed of the joint and its datasheet alone, so that several cases can have the same;
            None takes it from `seed`.
        defects: Defects of the records and the datasheet, from DEFECTS.

    Raises:
        UnknownNameError: An effect, place, structure, excitation or defect has no such name.
        ConfigurationError: The structure cannot have an effect, or a number is out of range.
    """
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(6)]
    given = (effects, structure, excitation, closed_loop, strength, duration)
    plan = draw_plan(*given, streams[:2])
    plan = replace(plan, defects=check_defects(defects))
    of_joint = streams[2] if joint is None else np.random.default_rng(joint)
    return _case(plan, of_joint, *streams[3:])


def _case(
    plan: Plan,
    of_joint: np.random.Generator,
    of_effects: np.random.Generator,
    of_records: np.random.Generator,
    of_defects: np.random.Generator,
) -> Case:
    world, sheet = draw_joint(plan.structure, of_joint)
    flaws = draw_defects(plan.defects, plan.structure, sheet, of_defects)
    world, told = flaws.applied(world), flaws.stated(sheet)
    signals = [_signal(plan, sheet, turn, rng) for turn, rng in enumerate(of_records.spawn(2))]
    seeds = of_records.spawn(4)
    plain = _record(world, sheet, plan.closed[0], signals[0], seeds[0], ROUGH_STEP)
    scales = scales_of(world, plain)
    seeds_of_effects = [int(seed) for seed in of_effects.integers(2**63, size=len(plan.effects))]
    true, parameters = _hide(world, plan, scales, seeds_of_effects)
    true = settled(true)
    runs = [
        _record(true, sheet, plan.closed[turn], signals[turn], seeds[1 + turn]) for turn in range(2)
    ]
    order = int(seeds[3].integers(2**32))
    logs = [_log(plan, told, flaws, result, turn, order) for turn, result in enumerate(runs)]
    models = {"stated": as_stated(world, told), "true": true}
    without = {
        effect.name: settled(_hide(world, plan, scales, seeds_of_effects, leave_out=k)[0])
        for k, (effect, _) in enumerate(plan.effects)
    }
    hidden = [f"{effect.name}:{place}" for effect, place in plan.effects]
    label = _label(plan, parameters) | {
        "signature": signatures(true, without, told, runs[0]),
        "true": {symbol: getattr(true.plant, symbol) for symbol in sheet.values},
        "stated": told.values,
        "gap": {
            "free_run": {name: replay_errors(model, runs[1]) for name, model in models.items()},
            "floor": noise_floor(runs[1]),
        },
        "defects": flaws.to_dict(),
        "not_counted": not_counted(plan.structure, told, world, hidden),
    }
    return Case(told, plan.structure.name, logs[0], logs[1], label, true)


def _signal(plan: Plan, sheet: Datasheet, turn: int, rng: np.random.Generator) -> Floats:
    """Return the command [A] of an open loop or the torque reference [N m] of a closed one."""
    free = not plan.structure.is_locked
    samples = round(plan.duration / sheet.dt)
    unit = excitation(plan.excitations[turn], samples, sheet.dt, rng, gentle=free)
    p = sheet.values
    whole = p["I_m"] + p["I_g"] + (p["I_l"] if free else 0.0)
    strongest = 0.6 * sheet.i_p * p["k_t"] * p["n"]
    torque = whole * rng.uniform(10.0, 35.0) if free else p["k_b"] * rng.uniform(0.003, 0.012)
    torque = min(torque, strongest)
    if plan.closed[turn]:
        share = p["I_l"] / whole if free else 1.0
        return unit * torque * share
    return unit * torque / (p["k_t"] * p["n"])


def _hide(
    world: World, plan: Plan, scales: Scales, seeds: list[int], leave_out: int | None = None
) -> tuple[World, dict[str, dict[str, float]]]:
    """Return the joint with its effects, optionally without one of them, and their parameters."""
    parameters = {}
    for k, (effect, place) in enumerate(plan.effects):
        if k != leave_out:
            draw = Draw(np.random.default_rng(seeds[k]), scales, plan.strength, place)
            world, parameters[effect.name] = effect.apply(world, draw)
    return world, parameters


def settled(world: World) -> World:
    """Return a locked joint that starts where it rests with its drive off.

    Otherwise a torque offset or cogging would make the joint swing as the record begins, which no
    real joint does and which would reveal the effect. A free joint, or one that starts in motion,
    is unchanged: it is released as the record begins.
    """
    if not world.structure.is_locked or world.start:
        return world
    p = world.plant
    critical = 2.0 * math.sqrt(p.k_b * (p.I_m + p.I_g))
    damped = replace(world, plant=p._replace(d_m=p.d_m + critical))
    samples = round(SETTLING_TIME / world.sampling)
    idle = run(
        damped, np.zeros(samples), Gains(), no_chances(damped, samples), fine_step=SETTLING_STEP
    )
    q_m, q_g = idle.states[-1, Q : Q + 2]
    return replace(world, start={"twist": float(q_g), "wind": float(q_m - q_g)})


def _record(
    world: World,
    sheet: Datasheet,
    closed: bool,
    signal: Floats,
    rng: np.random.Generator,
    fine_step: float = 1e-5,
) -> Run:
    """Return a run driven by a signal of `_signal`."""
    if closed:
        gains = first_gains(world.structure, sheet, rng)
        return under_control(world, signal, gains, rng, fine_step)
    chances = draw_chances(world, len(signal), rng)
    return run(world, signal, Gains(limit=sheet.i_p), chances, fine_step=fine_step)


def _log(plan: Plan, sheet: Datasheet, flaws: Defects, result: Run, turn: int, order: int) -> Log:
    """Return the record of a run, without the rows that are randomly lost."""
    t = result.times if flaws.stamped else instants(sheet.dt, len(result.command))
    columns = {"t": t, "i_cmd": result.command}
    columns |= {name: result.measured[:, CHANNELS.index(name)] for name in sheet.channels}
    columns = flaws.lost(columns, sheet.dt, np.random.default_rng((order, turn, 1)))
    mode = "closed loop" if plan.closed[turn] else "open loop"
    return Log(columns, mode, plan.excitations[turn])


def _label(plan: Plan, parameters: dict[str, dict[str, float]]) -> dict[str, Any]:
    names = [effect.name for effect, _ in plan.effects]
    return {
        "effects": [name for name in names if name in KNOWN],
        "outside_the_table": [name for name in names if name in OUTSIDE],
        "parameters": parameters,
        "units": {
            effect.name: {key: effect.units[key] for key in parameters[effect.name]}
            for effect, _ in plan.effects
        },
        "places": {effect.name: place for effect, place in plan.effects if place},
        "stages": {effect.name: effect.stage for effect, _ in plan.effects},
        "strength": plan.strength,
        "structure": plan.structure.name,
        "excitation": list(plan.excitations),
        "closed_loop": list(plan.closed),
        "duration": plan.duration,
    }
