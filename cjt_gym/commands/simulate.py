"""`cjt-gym simulate`: a joint under a reference and a controller, as a record."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines import CONTROLLERS, make_controller
from cjt_gym.envs.settings import default_amplitude, default_load
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import DRIVES, EFFECTS, STRUCTURES, Joint, load_joint
from cjt_gym.joint.arrays import CHANNELS
from cjt_gym.plant import SimulatedPlant
from cjt_gym.records import FORMATS, Record, write_record
from cjt_gym.signals import Signal, make_signals

Floats = NDArray[np.float64]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to simulate, how long, and where to write it."""
    add = parser.add_argument
    add("joint", metavar="JOINT", help="name of a joint, or path of a joint file")
    add("--structure", default="output_fixed_rigid_gearbox", help=", ".join(STRUCTURES))
    add("--drive", default="current", help=", ".join(DRIVES))
    text = "effects to switch on, by name or name.parameter=value; default: those of the joint file"
    add("--effect", nargs="+", metavar="E", help=f"{text} ({', '.join(EFFECTS)})")
    add("--reference", default="chirp", help="step, chirp, multisine, smooth, or a record")
    add("--amplitude", type=float, help="of the reference [N m]; default: from the joint")
    add("--controller", default="pd_feedforward", help=", ".join(CONTROLLERS))
    add("--duration", type=float, default=10.0, help="[s], default 10")
    add("--dt", type=float, default=1e-3, help="control step [s], default 0.001")
    add("--dt-physics", type=float, default=1e-4, help="substep [s], default 0.0001")
    add("--seed", type=int, default=0, help="of the reference and the sensors' noise, default 0")
    endings = ", ".join(f".{ending.lstrip('.')}" for ending in FORMATS)
    add("--out", type=Path, required=True, metavar="RECORD", help=f"file to write ({endings})")


def run(options: argparse.Namespace) -> None:
    """Simulate, write the record and say what came out."""
    loaded = default_load(options.joint, options.structure, {})
    effects = parse_effects(options.effect)
    joint = load_joint(options.joint, options.structure, options.drive, effects, loaded)
    reference = _reference(options, joint)
    record = simulate(
        joint,
        reference,
        options.controller,
        options.duration,
        options.dt,
        options.dt_physics,
        options.seed,
    )
    path = write_record(record, options.out)
    error = record["tau_ref"] - record["true_tau"]
    result = {
        "record": str(path),
        "samples": len(record),
        "rmse": float(np.sqrt(np.mean(error**2))),
        "peak_torque": float(np.abs(record["true_tau"]).max()),
    }
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    else:
        sys.stdout.write(
            f"{path}: {len(record)} samples, tracking error {result['rmse']:.4g} N m rms, "
            f"peak torque {result['peak_torque']:.4g} N m\n"
        )


def parse_effects(words: list[str] | None) -> dict[str, dict[str, Any]] | None:
    """Turn ["coulomb", "command_delay.delay=0.001"] into a mapping of effects to values.

    A series is written with commas: cogging.f=480,960.

    Raises:
        ConfigurationError: A value is not a number.
    """
    if words is None:
        return None
    effects: dict[str, dict[str, Any]] = {}
    for word in words:
        name, _, rest = word.partition(".")
        values = effects.setdefault(name, {})
        if rest:
            symbol, _, text = rest.partition("=")
            try:
                numbers = [float(part) for part in text.split(",")]
            except ValueError:
                if symbol not in ("body", "channel"):
                    raise ConfigurationError(
                        f"--effect {word} must be name, name.parameter=number or "
                        "name.parameter=number,number."
                    ) from None
                values[symbol] = text
                continue
            values[symbol] = numbers[0] if len(numbers) == 1 else tuple(numbers)
    return effects


def _reference(options: argparse.Namespace, joint: Joint) -> Signal:
    amplitude = options.amplitude
    if amplitude is None:
        amplitude = default_amplitude(joint.parameters)
    (signal,) = make_signals(options.reference, amplitude)[:1]
    return signal.reset(np.random.default_rng(options.seed))


def simulate(
    joint: Joint,
    reference: Signal,
    controller: str,
    duration: float,
    dt: float,
    dt_physics: float,
    seed: int,
) -> Record:
    """Run a joint in closed loop and return the record.

    Args:
        joint: The joint.
        reference: Wanted joint torque [N m].
        controller: Name of the controller.
        duration: [s].
        dt: Control step [s].
        dt_physics: Substep [s].
        seed: Seed of the sensors' noise.

    Returns:
        Row k holds what was true, measured, wanted and commanded at t = k dt.
    """
    if not (np.isfinite(duration) and duration >= dt):
        raise ConfigurationError(f"--duration must be >= one control step, got {duration} s.")
    plant = SimulatedPlant(joint, 1, dt, dt_physics)
    law = make_controller(controller, joint, dt)
    law.reset()
    samples = round(duration / dt)
    rows: dict[str, Floats] = {name: np.zeros(samples) for name in CHANNELS}
    true_names = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau", "i")
    rows |= {f"true_{name}": np.zeros(samples) for name in true_names}
    rows["t"] = np.arange(samples, dtype=np.float64) * dt
    rows["tau_ref"] = reference.torque(rows["t"])
    rows["tau_cmd"] = np.zeros(samples)
    measured = plant.reset(seed=seed)
    for k in range(samples):
        command = law.act(measured, rows["tau_ref"][k : k + 1])
        arrays = plant.batch.arrays
        true = [*arrays.state[0], arrays.tau[0], arrays.currents[0, 0]]
        for name, value in zip(true_names, true, strict=True):
            rows[f"true_{name}"][k] = value
        for name in CHANNELS:
            rows[name][k] = getattr(measured, name)[0]
        rows["tau_cmd"][k] = command[0]
        measured = plant.step(command)
    rows["i_cmd"] = rows["tau_cmd"] / (joint.parameters.k_t * joint.parameters.n)
    return joint.record(rows, dt, seed, controller=controller, reference=reference.kind)
