"""Closed-loop replay: the joint under the controller that it was recorded with.

In an open-loop replay the errors of a model accumulate; in closed loop the controller corrects
part of them, as on the real joint. What remains is the error of a closed-loop simulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cjt_gym.errors import ConfigurationError
from cjt_gym.gap.diagnosis import GapSize
from cjt_gym.gap.judged.gap_size import size_of
from cjt_gym.gap.judged.replay import SUBSTEP
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant import Law, SimulatedPlant
from cjt_gym.records import Record

CHANNELS = ("tau", "tau_cmd", "q_m", "dq_m")
"""Channels of a replay."""
NEEDED = ("tau_ref", "tau")


def replay_closed_loop(record: Record, joint: Joint, controller: Law) -> Mapping[str, Floats]:
    """Simulate a joint under a controller that tracks a record's reference.

    Args:
        record: Provides the reference `tau_ref` [N m], the sample time, the initial state, and
            the load torque `tau_l` of a free load.
        joint: The joint.
        controller: The controller that drives it.

    Returns:
        Channels of `CHANNELS` as they would be recorded, each of shape (N,).

    Raises:
        ConfigurationError: The record has no reference.
        SimulationError: A state became infinite or NaN.
    """
    _check(record)
    dt = record.dt
    plant = SimulatedPlant(joint, 1, dt, dt / max(math.ceil(dt / SUBSTEP), 1))
    reference = record["tau_ref"]
    load = _load(record, joint)
    start = np.zeros((1, 6))
    start[0, :3] = record["q_m"][0] if "q_m" in record else 0.0
    controller.reset()
    share = _share(record)
    measured = plant.reset(seed=0, start=start, load=load[:1])
    rows = {name: np.zeros(len(record)) for name in CHANNELS}
    for k in range(len(record)):
        command = share[k] * controller.act(measured, reference[k : k + 1])
        for name in ("tau", "q_m", "dq_m"):
            rows[name][k] = getattr(measured, name)[0]
        rows["tau_cmd"][k] = command[0]
        measured = plant.step(command, load[k : k + 1])
    return rows


def _check(record: Record) -> None:
    missing = [name for name in NEEDED if name not in record]
    if missing:
        raise ConfigurationError(
            f"{record.owner} must have the columns {', '.join(NEEDED)} [N m] to be replayed in a "
            f"closed loop, {', '.join(missing)} is missing. Record the reference too."
        )
    if not all(np.isfinite(record[name]).all() for name in NEEDED):
        raise ConfigurationError(
            f"{', '.join(NEEDED)} of {record.owner} must be finite to be replayed in a closed "
            "loop, got NaN. Take a part of the record without missing samples."
        )


def _share(record: Record) -> Floats:
    """Return which part of a command acts: `soft_s` of a record is the time of its fade-in [s]."""
    soft = float(record.provenance.get("soft_s", 0.0))
    rising = (record.t + record.dt) / soft if soft > 0.0 else np.ones(len(record))
    return np.minimum(rising, 1.0)


def _load(record: Record, joint: Joint) -> Floats:
    free = not joint.structure_row.output_fixed
    return record["tau_l"].copy() if free and "tau_l" in record else np.zeros(len(record))


def closed_loop_gap(
    record: Record,
    nominal: Joint,
    identified: Joint,
    controller: Law,
    scatter: float = 0.0,
    begin: int = 0,
) -> GapSize:
    """Return how far the gap of the joint torque shrinks in a closed loop.

    Args:
        record: Recorded under the controller, preferably unseen by the identification.
        nominal: The joint before the diagnosis.
        identified: The joint with its effects.
        controller: The controller of the record, with its gains.
        scatter: Standard deviation of a torque sensor sample [N m], for the floor.
        begin: First sample that counts; the first unseen one if a fit has seen the beginning.

    Returns:
        Errors relative to the rms of the recorded torque, with a block bootstrap interval. The
        torque counts; errors of command, motor angle and speed are given for information.

    Raises:
        ConfigurationError: The record has no reference or no joint torque.
        SimulationError: A state became infinite or NaN.
    """
    one, two = (replay_closed_loop(record, joint, controller) for joint in (nominal, identified))
    signals = {
        name: [np.stack([record[name], one[name], two[name]])[:, begin:]]
        for name in CHANNELS
        if name in record and np.isfinite(record[name]).all()
    }
    return size_of(signals, "tau", scatter, record.dt, held_out=True)
