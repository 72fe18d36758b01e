"""Replay errors of models of a joint: the true reduction of the gap.

The commands of a record drive a model in an open loop, and its clean channels are compared with
the clean channels of the record, which are free of noise, rounding and calibration errors.
"""

from __future__ import annotations

import numpy as np

from cjt_gym.blind.control import Gains
from cjt_gym.blind.plant import Floats, World
from cjt_gym.blind.run import Run, no_chances, run
from cjt_gym.blind.state import CREEP, V

REPLAY_STEP = 2e-5
"""Step of the integrator in a replay [s]."""

Errors = dict[str, float]


def replay_errors(model: World, truth: Run) -> Errors:
    """Return the replay error of each signal of a record, as a share of its true spread."""
    result = run(
        model,
        truth.command,
        Gains(),
        no_chances(model, len(truth.command)),
        restarts=remembered(model, truth.states),
        fine_step=REPLAY_STEP,
    )
    one, other = _signals(truth), _signals(result)
    return {name: _relative(other[name], one[name]) for name in one}


def remembered(model: World, states: Floats) -> Floats:
    """Return states without the memories that the model lacks, shape (n, SIZE)."""
    if model.plant.creep > 0.0:
        return states
    kept = states.copy()
    kept[:, CREEP] = 0.0
    return kept


def noise_floor(record: Run) -> Errors:
    """Return the torque's replay error due to noise and rounding, relative to its spread."""
    clean, measured = record.clean[:, 4], record.measured[:, 4]
    return {"tau": _relative(measured - np.mean(measured - clean), clean)}


def _signals(result: Run) -> dict[str, Floats]:
    return {
        "tau": result.clean[:, 4],
        "i": result.clean[:, 0],
        "q_m": result.clean[:, 1],
        "q_l": result.clean[:, 3],
        "dq_m": result.states[:, V],
        "dq_l": result.states[:, V + 2],
    }


def _relative(values: Floats, truth: Floats) -> float:
    spread = float(np.std(truth))
    return float(np.sqrt(np.mean((values - truth) ** 2))) / spread if spread > 0.0 else 0.0
