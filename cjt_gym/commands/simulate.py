"""`cjt-gym simulate`: a joint under a reference and a controller, as a record."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.baselines import CONTROLLERS
from cjt_gym.baselines.gains import choose, files_of, law_in_record
from cjt_gym.baselines.table import CONTROLLER_HELP
from cjt_gym.console import Answer
from cjt_gym.console.options import (
    USUAL,
    add_conditions,
    add_joint,
    asked_effects,
    check_joint,
    check_randomize,
    check_seed,
    check_time,
    structure_of,
    tell_effects,
)
from cjt_gym.disk import refuse_inputs
from cjt_gym.envs.settings import default_amplitude, default_load, told_load
from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.joint import Joint, load_joint, load_joint_file
from cjt_gym.joint.configure import plain_effects
from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.kernel.arrays import CHANNELS, Floats
from cjt_gym.joint.kernel.current_loop import with_current_loop
from cjt_gym.plant import SimulatedPlant
from cjt_gym.plant.randomization import Randomization
from cjt_gym.plant.simulated import DT_PHYSICS
from cjt_gym.records import FORMATS, Record, read_record, record_names, write_record
from cjt_gym.records.files import gear_ratio_of
from cjt_gym.signals import Signal, make_signals, sampled_signal, signal_from_file

TRACKING, NONE = "pd_feedforward", "none"
"""The default controller, and the name for no controller at all."""
COMMANDS, CURRENT = ("i_cmd", "tau_cmd"), "i"
BY_VOLTAGE = (
    'load_joint(FILE, STRUCTURE, drive="static").simulate(voltage=record["v"], dt=record.dt)'
)
"""What of a record is replayed, and what is where none of these was logged: the measured current,
which has passed the drive."""
PAST = "measured current replayed in open loop, past the effects of the drive"
MOST_SAMPLES = 20_000_000
"""Samples of a record, of which each takes some 300 bytes."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to simulate, how long, and where to write it."""
    add = parser.add_argument
    add_joint(parser)
    text = f"that of the record given as reference, of the joint file, or {USUAL}"
    add_conditions(parser, structure=text)
    text = "step, chirp, multisine, smooth, or a record: tau_ref is tracked, a command replayed"
    add("--reference", default="chirp", help=text)
    add("--amplitude", type=float, help="of the reference [N m]; default: from the joint")
    text = f"{CONTROLLER_HELP}; a gain file of `cjt-gym tune`; or {NONE}: replay the record's "
    text += f"command or measured current; default: {TRACKING}"
    add("--controller", help=f"{text} where there is a tau_ref")
    add("--duration", type=float, help="[s]; default: that of the record, or 10")
    add("--dt", type=float, help="control step [s]; default: that of the record, or 0.001")
    text = "substep [s]; default: the largest whole part of the control step up to 0.0001"
    add("--dt-physics", type=float, help=text)
    add("--seed", type=int, default=0, help="of the reference and the sensors' noise, default 0")
    endings = ", ".join(f".{ending.lstrip('.')}" for ending in FORMATS)
    add("--out", type=Path, required=True, metavar="RECORD", help=f"file to write ({endings})")


def run(options: argparse.Namespace) -> Answer:
    """Simulate, write the record and say what came out."""
    check_joint(options.joint)
    check_seed(options.seed)
    check_time("dt", options.dt)
    check_time("dt-physics", options.dt_physics)
    randomize = check_randomize(options)
    used = [] if options.controller is None else files_of(options.controller)
    refuse_inputs([options.out], [options.reference, options.joint, *used])
    task = _task(options)
    # A command is replayed by the joint as its file says; no torque is held against it.
    loaded = {} if task.controller == NONE else default_load(options.joint, task.structure, {})
    effects = asked_effects(options)
    joint = load_joint(options.joint, task.structure, options.drive, effects, loaded)
    dt_physics = options.dt_physics or task.dt / max(1, ceil(task.dt / DT_PHYSICS - 1e-9))
    if task.replayed == CURRENT:
        own = {n: v for n, v in joint.effects.items() if EFFECTS[n].stage != "drive"}
        joint = replace(joint, effects=own)
    joint = with_current_loop(joint, dt_physics)
    record = simulate(
        joint, _reference(options, task, joint), task, dt_physics, options.seed, randomize
    )
    path = write_record(record, options.out)
    tell_effects(joint)
    tracks = "tau_ref" in record
    error = record["tau_ref"] - record["true_tau"] if tracks else np.array([np.nan])
    rmse = float(np.sqrt(np.mean(error**2)))
    largest = float(np.abs(record["true_tau"]).max())
    result = {
        "record": str(path),
        "samples": len(record),
        "controller": task.controller,
        "structure": joint.structure,
        "drive": joint.drive,
        "effects": plain_effects(joint.effects),
        "rmse": rmse if tracks else None,
        "added_load": loaded.get("I_l"),
        "peak_torque": largest,
    }
    unit = _unit(joint)
    replayed = PAST if task.replayed == CURRENT else "command replayed in open loop"
    how = replayed
    if tracks:
        asked = float(np.sqrt(np.mean(record["tau_ref"] ** 2)))
        how = f"tracking error {rmse:.4g} {unit} rms of a reference of {asked:.4g} {unit} rms"
    peak = f", peak transmitted torque {largest:.4g} {unit}" if largest else ""
    return result, f"{path}: {len(record)} samples, {how}{peak}{told_load(joint, loaded)}"


@dataclass(frozen=True, eq=False)
class Task:
    """What to simulate, with every default settled."""

    recorded: Record | None  # record that serves as the reference, or None
    structure: str
    controller: str  # a name of `CONTROLLERS`, or `NONE`
    duration: float  # [s]
    dt: float  # control step [s]
    replayed: str = ""  # what of the record is replayed with `NONE`


def _task(options: argparse.Namespace) -> Task:
    """Return what the options, and the record they may name as reference, ask for."""
    word = options.reference
    given = Path(word).suffix or word in record_names()
    recorded = _recorded(word, options.joint) if given else None
    replayed = next((n for n in (*COMMANDS, CURRENT) if recorded is not None and n in recorded), "")
    tracked = recorded is None or "tau_ref" in recorded
    controller = options.controller or (NONE if replayed and not tracked else TRACKING)
    if controller == NONE and not replayed:
        what = "no record" if recorded is None else f"{recorded.owner}, which has neither"
        volts = recorded is not None and "v" in recorded
        also = f" A voltage is replayed in Python: {BY_VOLTAGE}." if volts else ""
        raise ConfigurationError(
            f"--controller {NONE} replays the command ({' or '.join(COMMANDS)}) of a record, or "
            f"its measured current ({CURRENT}), got {what}. Give one as --reference, or a "
            f"controller: {', '.join(CONTROLLERS)}.{also}"
        )
    length = 10.0 if recorded is None else len(recorded) * recorded.dt
    said = None if recorded is None else recorded.structure
    return Task(
        recorded,
        structure_of(options.joint, options.structure or said),
        controller,
        length if options.duration is None else options.duration,
        options.dt or (1e-3 if recorded is None else recorded.dt),
        replayed if controller == NONE else "",
    )


def _recorded(word: str, joint: str) -> Record:
    """Return a record; the joint has the gear ratio where the log names none that has one."""
    return read_record(word, n=gear_ratio_of(word) or load_joint_file(joint).gear_ratio)


def _unit(joint: Joint) -> str:
    return "N" if joint.parameters.axis == "prismatic" else "N m"


def _reference(options: argparse.Namespace, task: Task, joint: Joint) -> Signal:
    """Return the reference, or the motor torque [N m] that a record commands."""
    if task.controller == NONE:
        assert task.recorded is not None
        record, p = task.recorded, joint.parameters
        unit = 1.0 if task.replayed == "tau_cmd" else p.k_t * p.n
        return sampled_signal(record.t, record[task.replayed] * unit)
    amplitude = options.amplitude
    newtons = _unit(joint)
    if amplitude is None:
        amplitude = default_amplitude(joint.file)
    check_range("--amplitude", amplitude, newtons, above=0.0)
    if task.recorded is None and amplitude > joint.torque_limit:
        sys.stderr.write(
            f"--amplitude {amplitude:g} {newtons} is beyond the peak torque of "
            f"{joint.parameters.name}, {joint.torque_limit:.4g} {newtons}.\n"
        )
    spec = options.reference if task.recorded is None else signal_from_file(options.reference)
    (signal,) = make_signals(spec, amplitude)[:1]
    return signal.reset(np.random.default_rng(options.seed))


def simulate(
    joint: Joint,
    reference: Signal,
    task: Task,
    dt_physics: float,
    seed: int,
    randomize: Randomization = None,
) -> Record:
    """Run a joint in closed loop and return the record.

    The reference is the wanted joint torque or, with the controller `NONE`, the motor's [N m]. Row
    k holds what was true, measured, wanted and commanded at t = k dt.
    """
    controller, duration, dt = task.controller, task.duration, task.dt
    if not (np.isfinite(duration) and duration >= dt):
        raise ConfigurationError(f"--duration must be >= one control step, got {duration} s.")
    if duration / dt > MOST_SAMPLES:
        raise ConfigurationError(
            f"--duration over --dt must be at most {MOST_SAMPLES} samples, got {duration / dt:.3g}."
        )
    plant = SimulatedPlant(joint, 1, dt, dt_physics, randomize)
    joint = plant.joint
    choice = choose("open_loop" if controller == NONE else controller).spelt_out(joint, dt)
    law = choice.make(joint, dt)
    law.reset()
    samples = round(duration / dt)
    rows: dict[str, Floats] = {name: np.zeros(samples) for name in CHANNELS}
    true_names = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau", "i")
    told = tuple(plant.drive_signals()) if joint.drive != "current" else ()
    rows |= {f"true_{name}": np.zeros(samples) for name in (*true_names, *told)}
    rows["t"] = np.arange(samples, dtype=np.float64) * dt
    rows["tau_ref"] = reference.torque(rows["t"])
    rows["tau_cmd"] = np.zeros(samples)
    measured = plant.reset(seed=seed)
    drawn = {name: float(values[0]) for name, values in plant.drawn().items()}
    for k in range(samples):
        command = law.act(measured, rows["tau_ref"][k : k + 1])
        arrays = plant.batch.arrays
        true = [*arrays.state[0], arrays.tau[0], arrays.currents[0, 0]]
        for name, value in zip(true_names, true, strict=True):
            rows[f"true_{name}"][k] = value
        if told:
            for name, values in plant.drive_signals().items():
                rows[f"true_{name}"][k] = values[0]
        for name in CHANNELS:
            rows[name][k] = getattr(measured, name)[0]
        rows["tau_cmd"][k] = command[0]
        measured = plant.step(command)
    if controller == NONE:
        del rows["tau_ref"]
    rows["i_cmd"] = rows["tau_cmd"] / (joint.parameters.k_t * joint.parameters.n)
    known: dict[str, Any] = {"controller": NONE}
    if controller != NONE:
        known = law_in_record(choice, joint, law)
    if drawn:
        known["drawn"] = drawn
    return joint.record(rows, dt, seed, reference=reference.kind, **known)
