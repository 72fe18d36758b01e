"""Visibility of an effect in a record: a diagnosis need not find what cannot be seen.

The joint is predicted over short windows that begin at its true state, once as it is and once
without the effect. The differences at the ends of the windows, relative to the scatter due to
noise and process torque, count only where neither the datasheet's tolerances nor calibration errors
could cause them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from cjt_gym.blind.control import Gains
from cjt_gym.blind.joints import Datasheet
from cjt_gym.blind.plant import CHANNELS, GEAR, Floats, Structure, World
from cjt_gym.blind.replay import remembered
from cjt_gym.blind.run import Run, no_chances, run
from cjt_gym.blind.state import Q

VISIBLE: Final = 5.0
"""Standard deviations above which an effect counts as visible."""
COARSER: Final = 1.5
"""Ratio of scatters above which a channel is worse than its datasheet."""
WINDOW: Final = 0.02
"""Length of a window [s]."""
GUESSED: Final = 1.0
"""Relative standard deviation of a guessed value."""
STEP: Final = 1e-4
"""Step of the integrator [s]; all predictions share its error."""
CALIBRATION: Final = {"i": 0.004, "tau": 0.03}
"""Usual offsets of a channel, one sigma."""
ARBITRARY: Final = 0.1
"""One sigma of the arbitrary zero of the bar's twist [rad]."""
SMALL_TORQUE: Final = 1e-3
"""Torque of the twist used to linearise its influence [N m]."""


def signatures(
    true: World, without: Mapping[str, World], sheet: Datasheet, record: Run
) -> dict[str, float]:
    """Return the visibility of each effect in a record, in standard deviations.

    `without` holds, by the name of an effect, the joint without it.
    """
    used = [CHANNELS.index(name) for name in sheet.channels]
    here = _at_ends(true, record)[:, used]
    measured = record.measured[_ends(true, len(record.command))][:, used]
    scatter = np.maximum(np.std(measured - here, axis=0), 1e-12)
    tolerated = _tolerated(true, sheet, record, here, used) / scatter
    system = np.vstack([tolerated.reshape(len(tolerated), -1).T, np.eye(len(tolerated))])
    norms = np.linalg.norm(system, axis=0)
    basis = np.linalg.qr(system / norms)[0]
    out = {}
    for name, other in without.items():
        difference = ((_at_ends(other, record)[:, used] - here) / scatter).ravel()
        target = np.concatenate([difference, np.zeros(len(tolerated))])
        left = target - basis @ (basis.T @ target)
        spread = _scattered(true, other, sheet, len(record.command))
        out[name] = math.hypot(float(np.linalg.norm(left)), spread)
    return out


def _ends(world: World, samples: int) -> slice:
    every = _every(world)
    return slice(every - 1, samples, every)


def _every(world: World) -> int:
    return max(round(WINDOW / world.sampling), 2)


def _at_ends(model: World, record: Run, states: Floats | None = None) -> Floats:
    """Return the clean channels of a model at the ends of the windows, shape (windows, 5)."""
    samples, start = len(record.command), record.states if states is None else states
    result = run(
        model,
        record.command,
        Gains(),
        no_chances(model, samples),
        restarts=remembered(model, start),
        every=_every(model),
        fine_step=STEP,
    )
    return result.clean[_ends(model, samples)]


def _tolerated(true: World, sheet: Datasheet, record: Run, here: Floats, used: list[int]) -> Floats:
    """Return the change due to one sigma of each tolerance and zero, (k, windows, channels)."""
    changes = []
    for symbol in active(true.structure):
        value = getattr(true.plant, symbol) * (1.0 + sheet.tolerances[symbol])
        other = replace(true, plant=true.plant._replace(**{symbol: value}))
        times = GUESSED / sheet.tolerances[symbol] if symbol in sheet.guesses else 1.0
        changes.append(times * (_at_ends(other, record)[:, used] - here))
    push = true.plant.torque_offset + true.plant.k_t * true.plant.n * CALIBRATION["i"]
    offset = replace(true, plant=true.plant._replace(torque_offset=push))
    changes.append(_at_ends(offset, record)[:, used] - here)
    if true.structure.bar_is_soft:
        changes.append(_wound(true, record)[:, used] - here)
    for j, channel in enumerate(used):
        if CHANNELS[channel] in CALIBRATION:
            constant = np.zeros_like(here)
            constant[:, j] = CALIBRATION[CHANNELS[channel]]
            changes.append(constant)
    return np.array(changes)


def _wound(true: World, record: Run) -> Floats:
    """Return the prediction if the bar is relaxed at another twist, shape (windows, 5).

    The encoders of motor and gear start there, so that they show only its consequences.
    """
    small = SMALL_TORQUE / true.plant.k_b
    states = record.states.copy()
    states[:, Q : Q + GEAR + 1] += small
    plain, wound = _at_ends(true, record), _at_ends(true, record, states)
    wound[:, 1:3] -= small
    return plain + (wound - plain) * (ARBITRARY / small)


def active(structure: Structure) -> tuple[str, ...]:
    """Return the parameters with a tolerance that affect a structure."""
    gear = ("k_g", "d_mg") if structure.gear_is_soft else ()
    bar = ("k_b", "d_gl") if structure.bar_is_soft else ()
    load = () if structure.is_locked else ("I_l", "d_l")
    return ("k_t", "I_m", "I_g", "d_m", "d_g", *gear, *bar, *load)


def _scattered(true: World, other: World, sheet: Datasheet, samples: int) -> float:
    """Return the visibility of what a prediction cannot show: added scatter and lost counts.

    Stated noise is not an effect, even if the true noise is lower.
    """
    total = 0.0
    for j in (CHANNELS.index(name) for name in sheet.channels):
        more = math.hypot(true.noise[j], true.resolution[j] / math.sqrt(12.0))
        usual = max(other.noise[j], sheet.noise[j])
        less = math.hypot(usual, other.resolution[j] / math.sqrt(12.0))
        if more > COARSER * less:
            total += math.sqrt(0.5 * samples) * math.log(more / max(less, 1e-12))
    if true.lost > other.lost:
        step = 6.0 * true.sensing.counts / math.hypot(true.noise[1], true.resolution[1])
        total += step * math.sqrt(true.lost * samples * true.sampling)
    return total
