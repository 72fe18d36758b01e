"""Blind cases: a random joint with hidden effects, two records of it, and the key to them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from cjt_gym.blind import variants
from cjt_gym.blind.control import Gains
from cjt_gym.blind.excitation import DRAWN, REST, excitation
from cjt_gym.blind.hidden import Draw, Effect
from cjt_gym.blind.joints import Datasheet, as_stated, draw_joint
from cjt_gym.blind.known import KNOWN
from cjt_gym.blind.outside import OUTSIDE
from cjt_gym.blind.plant import CHANNELS, STRUCTURES, Floats, Structure, World
from cjt_gym.blind.replay import true_gap
from cjt_gym.blind.run import Run, draw_chances, instants, run
from cjt_gym.blind.scales import Scales, scales_of
from cjt_gym.blind.tracking import closed_loop, first_gains
from cjt_gym.errors import ConfigurationError, unknown_name

DURATION: Final = 10.0
SMALL: Final = 0.1
"""Strength of effects that are hard to see."""
STRUCTURE_SHARES: Final = {
    "output_fixed_rigid_gearbox": 0.3,
    "output_fixed": 0.15,
    "full_dynamics": 0.3,
    "rigid_gearbox": 0.15,
    "rigid": 0.1,
}
COUNTS: Final = {(0, 0): 0.14, (1, 0): 0.46, (2, 0): 0.22, (0, 1): 0.12, (1, 1): 0.06}
"""How often a case has how many effects of the table and outside it."""
ONE_OF: Final = frozenset({"coulomb", "coulomb_asym", "stribeck", "presliding", "load_coulomb"})
"""Dry friction comes in one of these kinds per joint."""


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
    """A joint whose effects are hidden.

    Attributes:
        sheet: What is stated of the joint.
        structure: Name of its structure.
        diagnose: Record to diagnose.
        validate: Record to check a diagnosis on.
        label: What is hidden, and how far the stated and the true model are from the second record.
    """

    sheet: Datasheet
    structure: str
    diagnose: Log
    validate: Log
    label: dict[str, Any]


@dataclass(frozen=True)
class Plan:
    """What is settled of a case before its joint is drawn.

    Attributes:
        structure: Structure of the joint.
        effects: Effects of the table and outside it, with the place where each acts.
        strength: Factor on their magnitudes.
        excitations: Kinds of excitation of the two records.
        closed: Whether the loop is closed in the two records.
        variant: One of VARIANTS, or None for orderly records.
        duration: Of each record [s].
    """

    structure: Structure
    effects: tuple[tuple[Effect, str], ...]
    strength: float
    excitations: tuple[str, str]
    closed: tuple[bool, bool]
    variant: str | None
    duration: float

    @property
    def dt(self) -> float:
        """Time between samples [s]."""
        return 0.01 if self.variant == "slow_sampling" else 1e-3


def draw_case(
    seed: int,
    *,
    effects: Iterable[str] | None = None,
    structure: str | None = None,
    excitation: str | None = None,
    closed_loop: bool | None = None,
    strength: float = 1.0,
    variant: str | None = None,
    duration: float = DURATION,
) -> Case:
    """Return a random case; the same one for the same arguments.

    Args:
        seed: Seed of all random numbers.
        effects: Names of the hidden effects, of the table or outside it, each optionally with its
            place as in "coulomb:gear"; None draws them.
        structure: Name of the structure; None draws one that the effects can have.
        excitation: Kind of excitation of the first record; None draws it.
        closed_loop: Whether the first record is taken in a closed loop; None draws it.
        strength: Factor on the magnitudes of the effects, such as SMALL.
        variant: A disorder of the records, one of VARIANTS.
        duration: Of each record [s]; tripled in the variant "long".

    Raises:
        UnknownNameError: An effect, place, structure, excitation or variant has no such name.
        ConfigurationError: The structure cannot have an effect, or a number is out of range.
    """
    _check(structure, excitation, variant, strength, duration)
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(5)]
    named = None if effects is None else tuple(effects)
    form = _structure(structure, named, streams[0])
    plan = Plan(
        structure=form,
        effects=_effects(named, form, streams[0]),
        strength=strength,
        excitations=_excitations(excitation, streams[1]),
        closed=_loops(closed_loop, streams[1]),
        variant=variant,
        duration=3.0 * duration if variant == "long" else duration,
    )
    return _case(plan, streams[2], streams[3], streams[4])


def _check(
    structure: str | None,
    kind: str | None,
    variant: str | None,
    strength: float,
    duration: float,
) -> None:
    for what, name, names in (
        ("structure", structure, STRUCTURES),
        ("excitation", kind, DRAWN),
        ("variant", variant, variants.VARIANTS),
    ):
        if name is not None and name not in names:
            raise unknown_name(what, name, names)
    if not 0.0 <= strength <= 3.0:
        raise ConfigurationError(f"strength must be within 0 and 3, got {strength:g}.")
    if not duration >= 2.0:
        raise ConfigurationError(f"duration must be >= 2 s, got {duration:g} s.")


# ------------------------------------------------------------------ what a case has


def _row(name: str) -> Effect:
    both = KNOWN | OUTSIDE
    if name not in both:
        raise unknown_name("effect", name, both)
    return both[name]


def _structure(
    structure: str | None, named: tuple[str, ...] | None, rng: np.random.Generator
) -> Structure:
    if structure is not None:
        return STRUCTURES[structure]
    rows = [(_row(name.split(":")[0]), name.partition(":")[2]) for name in named or ()]
    shares = {
        name: share
        for name, share in STRUCTURE_SHARES.items()
        if all(_can_have(effect, place, STRUCTURES[name]) for effect, place in rows)
    }
    if not shares:
        raise ConfigurationError(
            f"No structure can have the effects {', '.join(named or ())} together. "
            "Leave one of them out."
        )
    weights = np.array(list(shares.values()))
    return STRUCTURES[str(rng.choice(list(shares), p=weights / weights.sum()))]


def _can_have(effect: Effect, place: str, structure: Structure) -> bool:
    places = effect.places(structure)
    return place in places if place else bool(places)


def _effects(
    named: tuple[str, ...] | None, structure: Structure, rng: np.random.Generator
) -> tuple[tuple[Effect, str], ...]:
    names = _draw_names(structure, rng) if named is None else named
    found = []
    for name in names:
        kind, _, place = name.partition(":")
        effect = _row(kind)
        places = effect.places(structure)
        if not _can_have(effect, place, structure):
            raise ConfigurationError(
                f"A joint of structure {structure.name} cannot have the effect '{name}'. "
                f"Places there: {', '.join(filter(None, places)) or 'none'}."
            )
        found.append((effect, place or str(rng.choice(places))))
    return tuple(found)


def _draw_names(structure: Structure, rng: np.random.Generator) -> tuple[str, ...]:
    counts = list(COUNTS)
    known, outside = counts[int(rng.choice(len(counts), p=list(COUNTS.values())))]
    names = [n for n, effect in KNOWN.items() if effect.places(structure)]
    others = [n for n, effect in OUTSIDE.items() if effect.places(structure)]
    while True:
        drawn = [str(name) for name in rng.choice(names, known, replace=False)]
        if len(ONE_OF.intersection(drawn)) <= 1:
            return (*drawn, *(str(name) for name in rng.choice(others, outside, replace=False)))


def _excitations(kind: str | None, rng: np.random.Generator) -> tuple[str, str]:
    shares = np.array([0.4, 0.2, 0.1, 0.1, 0.1, 0.1])
    first = str(rng.choice(DRAWN, p=shares)) if kind is None else kind
    second = [name for name in ("composite", "multisine", "steps", "chirp") if name != first]
    return first, str(rng.choice(second))


def _loops(closed: bool | None, rng: np.random.Generator) -> tuple[bool, bool]:
    first, second = rng.random() < 0.2, rng.random() < 0.85
    return (bool(first) if closed is None else closed), bool(second)


# ------------------------------------------------------------------ making it


def _case(
    plan: Plan,
    of_joint: np.random.Generator,
    of_effects: np.random.Generator,
    of_records: np.random.Generator,
) -> Case:
    world, sheet = draw_joint(plan.structure, of_joint, plan.dt)
    if plan.variant == "moving_start":
        start = {"twist": of_joint.uniform(-1.0, 1.0) * 3.0 / sheet.values["k_b"], "v": 0.1}
        world = replace(world, start=start)
    signals = [
        _signal(plan, world, sheet, turn, rng) for turn, rng in enumerate(of_records.spawn(2))
    ]
    seeds = of_records.spawn(4)
    scales = _scales(world, sheet, plan, signals[0], seeds[0])
    true, parameters, places = _hide(world, plan, scales, of_effects)
    runs = [
        _record(true, sheet, plan.closed[turn], signals[turn], seeds[1 + turn]) for turn in range(2)
    ]
    order = int(seeds[3].integers(2**32))
    logs = [_log(plan, sheet, result, turn, order) for turn, result in enumerate(runs)]
    models = {
        "stated": as_stated(world, sheet),
        "no_effects": replace(world, resolution=(0.0,) * 5),
        "true": true,
    }
    label = _label(plan, parameters, places) | {"gap": true_gap(models, runs[1])}
    return Case(sheet, plan.structure.name, logs[0], logs[1], label)


def _signal(
    plan: Plan, world: World, sheet: Datasheet, turn: int, rng: np.random.Generator
) -> Floats:
    """Return the command [A] of an open loop or the torque reference [N m] of a closed one."""
    samples = round(plan.duration / plan.dt)
    rest = 0.0 if plan.variant == "moving_start" else REST
    free = not plan.structure.is_locked
    kind = plan.excitations[turn]
    unit = excitation(kind, samples, plan.dt, rng, rest, gentle=free)
    p = sheet.values
    whole = p["I_m"] + p["I_g"] + (p["I_l"] if free else 0.0)
    strongest = 0.6 * sheet.i_p * p["k_t"] * p["n"]
    torque = whole * rng.uniform(10.0, 35.0) if free else p["k_b"] * rng.uniform(0.003, 0.012)
    torque = min(torque, strongest)
    if plan.variant == "saturated":
        torque = 2.5 * strongest
    if plan.closed[turn]:
        share = p["I_l"] / whole if free else 1.0
        return unit * torque * share
    return unit * torque / (p["k_t"] * p["n"])


def _scales(
    world: World, sheet: Datasheet, plan: Plan, signal: Floats, rng: np.random.Generator
) -> Scales:
    """Return the sizes of the signals of the first record, were there no effect."""
    return scales_of(world, _record(world, sheet, plan.closed[0], signal, rng, 2e-5))


def _hide(
    world: World, plan: Plan, scales: Scales, rng: np.random.Generator
) -> tuple[World, dict[str, dict[str, float]], dict[str, str]]:
    """Return the joint with its effects, their parameters and their places."""
    parameters, places = {}, {}
    for effect, place in plan.effects:
        world, values = effect.apply(world, Draw(rng, scales, plan.strength, place))
        parameters[effect.name] = values
        if place:
            places[effect.name] = place
    return world, parameters, places


def _record(
    world: World,
    sheet: Datasheet,
    closed: bool,
    signal: Floats,
    rng: np.random.Generator,
    fine_step: float = 1e-5,
) -> Run:
    """Return a run under a signal of `_signal`."""
    if closed:
        gains = first_gains(world.structure, sheet, rng)
        return closed_loop(world, signal, gains, rng, fine_step)
    chances = draw_chances(world, len(signal), rng)
    return run(world, signal, Gains(limit=sheet.i_p), chances, fine_step=fine_step)


def _log(plan: Plan, sheet: Datasheet, result: Run, turn: int, order: int) -> Log:
    """Return what is recorded of a run.

    Rows are lost at random in each record, but both lack the same channels: `order` seeds that.
    """
    columns = {"t": instants(sheet.dt, len(result.command)), "i_cmd": result.command}
    columns |= {name: result.measured[:, CHANNELS.index(name)] for name in sheet.channels}
    if plan.variant == "dropped_rows":
        columns = variants.drop_rows(columns, np.random.default_rng((order, turn)))
    elif plan.variant == "stale_rows":
        columns = variants.repeat_rows(columns, np.random.default_rng((order, turn)))
    elif plan.variant == "missing_channels":
        columns = variants.without_channels(columns, np.random.default_rng(order))
    mode = "closed loop" if plan.closed[turn] else "open loop"
    return Log(columns, mode, plan.excitations[turn])


def _label(
    plan: Plan, parameters: dict[str, dict[str, float]], places: dict[str, str]
) -> dict[str, Any]:
    names = [effect.name for effect, _ in plan.effects]
    return {
        "effects": [name for name in names if name in KNOWN],
        "outside_the_table": [name for name in names if name in OUTSIDE],
        "parameters": parameters,
        "units": {
            effect.name: {key: effect.units[key] for key in parameters[effect.name]}
            for effect, _ in plan.effects
        },
        "places": places,
        "stages": {effect.name: effect.stage for effect, _ in plan.effects},
        "strength": plan.strength,
        "structure": plan.structure.name,
        "excitation": list(plan.excitations),
        "closed_loop": list(plan.closed),
        "variant": plan.variant,
        "duration": plan.duration,
    }
