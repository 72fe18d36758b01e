"""Predictions of a joint in windows of a record, by the joint's own kernel."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.horizons.prediction.log import Log
from cjt_gym.gap.horizons.prediction.observer import Given, observed
from cjt_gym.joint import Joint
from cjt_gym.joint.batch import DELAYS, JointBatch, longest_substep
from cjt_gym.joint.kernel.arrays import (
    HOUSING,
    LAGGED,
    Q_L,
    Q_M,
    REFERENCE,
    TAU,
    WINDING,
    WORK_ROWS,
    WORK_WIDTH,
    Batch,
    Floats,
    Setup,
)
from cjt_gym.joint.kernel.compiled import threaded
from cjt_gym.joint.kernel.control_steps import inlined_step, one_step, restart
from cjt_gym.joint.kernel.heat import cool, temper, warm
from cjt_gym.joint.lanes import Blocks, Kind, advance_blocks, kind_of, make_blocks
from cjt_gym.joint.lanes.vectors import WIDTH

Integers = NDArray[np.int64]
CHANNELS = {"q_m": 0, "q_l": 1, "tau": 2}
SUBSTEP = 2e-3
"""Longest substep [s]: linear motion is exact at any; friction and ripple are second order."""
LONGER = 5e-3
"""The same for a free single mass without ripple and delays [s]; on some thirty real records it
changed errors by less than 1 %."""
PARTS = 4
"""Substeps per sample, at least, of a joint with delays, which act in whole substeps."""
FEWEST = 4
"""Fewest windows for which sixteen at once, where the joint allows that, take less time."""
LEAD = 0.06
"""Time before a window over which delays, lags and bristles settle on measured states [s]."""


class Spans(NamedTuple):
    """Windows of a record.

    Attributes:
        starts: First sample of each window, shape (W,).
        lengths: Samples of each window, shape (W,).
        leads: Samples before each window over which the joint is held, shape (W,).
    """

    starts: Integers
    lengths: Integers
    leads: Integers


class Lanes(NamedTuple):
    """What sixteen windows at once need.

    Attributes:
        kind: What the fast lanes need to know of the joint.
        blocks: Those of the batch.
        commands: Scratch for commands, shape (16, 2).
        loads: Scratch for loads, shape (16,).
    """

    kind: Kind
    blocks: Blocks
    commands: Floats
    loads: Floats


@threaded
def run_windows(
    batch: Batch, setup: Setup, given: Given, spans: Spans, heat: Floats, work: Floats, out: Floats
) -> None:
    """Predict each window from its measured start; NaN once a state is no longer finite.

    Before a window begins, the joint is held to its measured states so that delay lines, lags,
    bristles and temperatures have settled when it is released.

    Args:
        batch: A batch of one.
        setup: Its setup.
        given: The record.
        spans: The windows.
        heat: Temperatures of winding and housing over the record [K], shape (N, 2); or (0, 2).
        work: Scratch space.
        out: Receives q_m, q_l and tau as the sensors report them, shape (W, longest, 3).
    """
    commands, loads, states = given
    for w in range(spans.starts.shape[0]):
        start, first = spans.starts[w], spans.starts[w] - spans.leads[w]
        for j in range(6):
            batch.state[0, j] = states[first, j]
        restart(batch, setup, 0, loads[first], work)
        if len(heat) > 0:
            batch.memory[0, WINDING], batch.memory[0, HOUSING] = heat[first]
            temper(batch.p[0], batch.memory[0])
        if not setup.is_voltage:
            batch.currents[0, 0] = commands[first]
            batch.memory[0, LAGGED] = batch.memory[0, REFERENCE] = commands[first]
        for d in range(batch.commands.shape[1]):
            batch.commands[0, d, 0] = commands[first]
        good = True
        for k in range(first, start + spans.lengths[w]):
            j = k - start
            if j <= 0:
                for column in range(6):
                    batch.state[0, column] = states[k, column]
            if j >= 0:
                out[w, j, 0] = batch.measured[0, Q_M] if j > 0 else batch.state[0, 0]
                out[w, j, 1] = batch.measured[0, Q_L] if j > 0 else batch.state[0, 2]
                out[w, j, 2] = batch.measured[0, TAU]
                if not good:
                    out[w, j] = np.nan
            good = good and inlined_step(batch, setup, 0, commands[k], 0.0, loads[k], work)


@threaded
def run_side_by_side(
    batch: Batch, setup: Setup, given: Given, spans: Spans, lanes: Lanes, out: Floats
) -> None:
    """Do what `run_windows` does, sixteen windows at once, for a batch of sixteen.

    Heat is none of the effects of such joints.
    """
    commands, loads, states = given
    starts, lengths, leads = spans
    kind, blocks, command, load = lanes
    width, work = batch.tau.shape[0], blocks.work[0]
    for begin in range(0, starts.shape[0], width):
        lead, length = 0, 0
        for i in range(width):
            w = min(begin + i, starts.shape[0] - 1)  # the last window fills the last lanes
            lead, length = max(lead, leads[w]), max(length, lengths[w])
            first = starts[w] - leads[w]
            for column in range(6):
                batch.state[i, column] = states[first, column]
            restart(batch, setup, i, loads[first], work)
            if not setup.is_voltage:
                batch.currents[i, 0] = batch.memory[i, LAGGED] = commands[first]
            for d in range(batch.commands.shape[1]):
                batch.commands[i, d, 0] = commands[first]
        for j in range(-lead, length):
            for i in range(width):
                w = min(begin + i, starts.shape[0] - 1)
                k = max(starts[w] + j, starts[w] - leads[w])
                k = min(k, starts[w] + lengths[w] - 1)
                command[i, 0], load[i] = commands[k], loads[k]
                if j <= 0:
                    for column in range(6):
                        batch.state[i, column] = states[k, column]
                if 0 <= j < lengths[w]:
                    out[w, j, 0] = batch.measured[i, Q_M] if j > 0 else batch.state[i, 0]
                    out[w, j, 1] = batch.measured[i, Q_L] if j > 0 else batch.state[i, 2]
                    out[w, j, 2] = batch.measured[i, TAU]
            if advance_blocks(batch, setup, kind, blocks, command, load, (0, 1, 0)) > 0:
                for i in range(width):
                    left = blocks.left[i]
                    if left and not one_step(batch, setup, i, command[i, 0], 0.0, load[i], work):
                        for column in range(8):
                            batch.measured[i, column] = np.nan


@threaded
def heat_up(batch: Batch, currents: Floats, dt: float, out: Floats) -> None:
    """Warm windings and housing up by currents.

    Args:
        batch: A batch of one.
        currents: Currents [A], shape (N,).
        dt: Sample time [s].
        out: Receives both temperatures before each sample [K], shape (N, 2).
    """
    p, memory, flowing = batch.p[0], batch.memory[0], batch.currents[0]
    cool(p, memory)
    flowing[1] = 0.0
    for k in range(currents.shape[0]):
        out[k] = memory[WINDING], memory[HOUSING]
        flowing[0] = currents[k]
        warm(p, memory, flowing, dt)


class Forecast:
    """A joint on one record, ready to be predicted in any windows of it."""

    def __init__(self, joint: Joint, log: Log) -> None:
        """Prepare a joint without noise."""
        self._batch = _batch(joint, log)
        self._heat = _temperatures(self._batch, log)
        self._work = np.zeros((WORK_ROWS, WORK_WIDTH))
        self._kind = kind_of(joint, log.voltage, torque="tau" in log.measured)
        self._given = given = Given(log.acting, log.pulling, log.first)
        if log.filtered or not log.known.all():
            states = observed(joint, self._batch, log, given, self._work)
            self._given = given._replace(states=states)

    @property
    def states(self) -> Floats:
        """States of the record, shape (N, 6), with estimates of the unmeasured ones."""
        return self._given.states

    def windows(self, starts: Integers, lengths: Integers, leads: Integers) -> Floats:
        """Return predictions, shape (W, longest, 3); columns as in `CHANNELS`.

        Args:
            starts: First sample of each window, shape (W,).
            lengths: Samples of each, shape (W,).
            leads: Samples before each that are held to measured states, shape (W,).
        """
        out = np.zeros((len(starts), int(lengths.max(initial=1)), 3))
        one, setup, given = self._batch.arrays, self._batch.setup, self._given
        spans = Spans(starts, lengths, leads)
        if self._kind is not None and len(starts) >= FEWEST:
            sixteen = Batch(*(np.repeat(x, WIDTH, axis=0) for x in one))
            blocks = make_blocks(self._kind, WIDTH)
            lanes = Lanes(self._kind, blocks, np.zeros((WIDTH, 2)), np.zeros(WIDTH))
            run_side_by_side(sixteen, setup, given, spans, lanes, out)
        else:
            run_windows(one, setup, given, spans, self._heat, self._work, out)
        return out


def _batch(joint: Joint, log: Log) -> JointBatch:
    record, ripple = joint.packed()
    shape = joint.structure_row
    free, delayed = shape.size == 1 and not shape.output_fixed, any(record[n][0] for n in DELAYS)
    plain = free and not len(ripple) and not delayed
    longest = min(LONGER if plain else SUBSTEP, 0.5 * longest_substep(joint))
    longest = min(longest, delaying_substep(log.dt)) if delayed else longest
    substeps = max(math.ceil(log.dt / longest - 1e-9), 1)
    return JointBatch(joint, 1, log.dt, log.dt / substeps, voltage=log.voltage)


def delaying_substep(dt: float) -> float:
    """Return the longest substep of a joint with delays [s]."""
    return dt / max(math.ceil(dt / SUBSTEP - 1e-9), PARTS)


def _temperatures(batch: JointBatch, log: Log) -> Floats:
    """Return the temperatures of windings that derate, shape (N, 2), else shape (0, 2)."""
    if log.voltage or batch.arrays.p["derating"][0] <= 0.0:
        return np.zeros((0, 2))
    currents = np.concatenate([log.past, log.command])
    out = np.zeros((len(currents), 2))
    heat_up(batch.arrays, currents, log.dt, out)
    return out[len(log.past) :]
