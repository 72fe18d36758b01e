"""The predictor of one stage: its gain, its residual, its response to a torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.recorded.fields import LAW_SIZE, Fields, friction_law, has_friction
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.stages.chain import Chain
from cjt_gym.gap.stages.kernel import Backlash, Found, Linear, Measured, Rubbing, predict
from cjt_gym.joint.kernel.arrays import Floats

RESPONSE = 200
"""Samples after which a predictor has forgotten a torque."""
STARTING = 1000
"""Samples after which it has forgotten its first state, at most a quarter of a record."""
FELT = 1e-3
"""Relative size below which a shape that the first state makes is not there."""


@dataclass(eq=False)
class Gain:
    """A predictor's gain, held fixed while parameters are fitted.

    Attributes:
        k: Gain, shape (n,).
        std: Deviation of the innovations.
        scatter: Deviation at every sample, including sampling jitter, shape (N,).
        start: Shapes of the first residuals that an error of the first state makes, orthonormal,
            shape (M, n).
    """

    k: Floats
    std: float
    scatter: Floats
    start: Floats


@dataclass(eq=False)
class Prediction:
    """Prediction of a stage."""

    residual: Floats  # normalised residual, shape (N,); zero where it does not count
    states: Floats  # predicted states, shape (N, n); n = 0 for a stage without states
    friction: Floats  # torque of friction on each body [N m], shape (N, bodies)


@dataclass(frozen=True, eq=False)
class Play:
    """Backlash in the gear as the kernel takes it; see `cjt_gym.gap.stages.kernel.Backlash`."""

    play: Floats
    loose: Chain
    adrift: Floats
    entry: Floats


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of the joint and what acts on it.

    Attributes:
        chain: The piece.
        forced: Contribution of the known inputs over each sample, shape (N, n).
        bodies: Letter and number of the bodies that friction can act on.
        transmitted: Transmitted torque, on which friction may depend [N m], shape (N,).
        play: Backlash in the gear.
        rubbing: Level of friction on the motor beside its law [N m], shape (N,).
    """

    chain: Chain
    forced: Floats
    bodies: tuple[tuple[str, int], ...]
    transmitted: Floats
    play: Play | None = None
    rubbing: Floats | None = None


DOUBLINGS = 20
"""Doublings of the time over which deviations add up: a million samples. A resonance that neither
its damping nor the predictor calms has no steady state."""
NO_MATRIX = np.zeros((0, 0))
NO_PLAY = Backlash(np.zeros(0), NO_MATRIX, NO_MATRIX, NO_MATRIX, np.zeros(0))


def backlash(
    fields: Fields,
    signs: Floats,
    bite: Floats,
    loose: Chain,
    adrift: Floats,
    entry: Floats | None,
) -> Play:
    """Return the backlash of a gear as the kernel takes it; see `Play`."""
    half = 0.5 * fields["play_g"]
    damping = 0.0 if fields["pull_g"] > 0.0 else fields["d_mg"]
    play = np.concatenate([[half], signs, bite * half, [fields["k_g"], damping]])
    nothing = np.zeros(0)
    return Play(play, loose, adrift, nothing if entry is None else entry)


def torque_response(chain: Chain, k: Floats, body: int) -> Floats:
    """Return the innovations that one newton metre over one sample causes, shape (200,).

    Value 0 belongs to the sample in which it acts.
    """
    x = chain.torque[:, body].copy()
    out = np.zeros(RESPONSE)
    for t in range(1, RESPONSE):
        out[t] = x[0]
        x = chain.a @ (x - k * out[t])
    return out


def start_shapes(chain: Chain, k: Floats, scatter: Floats, valid: NDArray[np.bool_]) -> Floats:
    """Return the shapes of the residuals that errors of the first state make; see `Gain`.

    A log cut in motion begins with a measured speed that may be far off, and a predictor with a
    small gain forgets it slowly.
    """
    rows = min(STARTING, len(scatter) // 4)
    x, out = np.eye(len(k)), np.zeros((rows, len(k)))
    for t in range(rows):
        out[t] = x[0]
        x = chain.a @ (x - np.outer(k, out[t]) * valid[t])
    made = np.where(valid[:rows, None], out / scatter[:rows, None], 0.0)
    u, size, _ = np.linalg.svd(made, full_matrices=False)
    return np.asarray(u[:, size > FELT * max(size[0], 1e-300)])


def innovation_std(chain: Chain, k: Floats, torque: tuple[float, ...], noise: float) -> float:
    """Return the innovations' deviation under a gain, without jitter."""
    keep = np.eye(len(k))
    keep[:, 0] -= k
    effect, fed = chain.torque * np.array(torque), chain.a @ k * noise
    drive = effect @ effect.T + np.outer(fed, fed)
    loop, p = chain.a @ keep, drive
    for _ in range(DOUBLINGS):
        p = p + loop @ p @ loop.T
        loop = loop @ loop
    return float(np.sqrt(p[0, 0] + noise**2))


def direct(error: Floats, std: Floats, s: Setting, channels: tuple[str, ...]) -> Prediction:
    """Return the prediction of a stage without states, from its error and the error's deviation."""
    residual = np.where(s.series.measured(*channels), error / std, 0.0)
    residual[: s.settle] = 0.0
    empty = np.zeros((len(error), 0))
    return Prediction(residual, empty, empty)


def run_predictor(
    fields: Fields, piece: Piece, x0: Floats, dt: float, seen: Measured | None = None
) -> tuple[Floats, Floats, Floats]:
    """Run the kernel with friction on those of the bodies that have any.

    Args:
        fields: The model.
        piece: The stage's piece of the joint.
        x0: First state, shape (n,).
        dt: Sample time [s].
        seen: What was measured; by default nothing.

    Returns:
        Innovations, shape (N,); predicted states, shape (N, n); friction torque on each of these
        bodies over each sample [N m], shape (N, bodies).
    """
    chain, play, rubbing = piece.chain, piece.play, piece.rubbing
    load = np.abs(piece.transmitted)
    rough = [
        (letter, body)
        for letter, body in piece.bodies
        if has_friction(fields, letter) or (letter == "m" and rubbing is not None)
    ]
    laws = np.zeros((len(rough), LAW_SIZE))
    loads = np.zeros((len(load), len(rough)))
    g = np.zeros((chain.a.shape[0], len(rough)))
    for row, (letter, body) in enumerate(rough):
        laws[row] = friction_law(fields, letter)
        g[:, row] = chain.torque[:, body]
        loads[:, row] = fields[f"mu_{letter}"] * load
        if letter == "m" and rubbing is not None:
            loads[:, row] += rubbing
    velocities = np.array([chain.velocity(body) for _, body in rough], dtype=np.int64)
    a, drive = np.ascontiguousarray(chain.a), np.ascontiguousarray(piece.forced)
    system = Linear(a, g, drive, x0, dt)
    if seen is None:
        rows = len(load)
        seen = Measured(np.zeros(len(x0)), np.zeros(rows), np.zeros(rows, dtype=bool))
    gap = NO_PLAY
    if play is not None:
        slack = np.zeros_like(g)
        for row, (_, body) in enumerate(rough):
            slack[:, row] = play.loose.torque[:, body]
        loose, adrift = (np.ascontiguousarray(x) for x in (play.loose.a, play.adrift))
        gap = Backlash(play.play, loose, adrift, slack, play.entry)
    rows, order, bodies = *drive.shape, len(rough)
    found = Found(
        np.zeros(rows), np.zeros(drive.shape), np.zeros((rows, bodies)),
        np.zeros(bodies), np.zeros(bodies),
    )  # fmt: skip
    work = np.zeros((3 + bodies, order))
    predict(system, seen, Rubbing(laws, velocities, loads), gap, found, work)
    return found.e, found.states, found.torque
