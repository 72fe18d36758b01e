"""H-infinity control of the joint torque, with feed-forward.

    u = r + K (r - tau)

K minimises the largest gain, over frequency, from a disturbance at the motor and noise of the
torque sensor to the weighted torque and the weighted command,

    || W P S     W P S K e ||
    || w P S K   w K S e   ||,   W(s) = (s + w_b) / (s + w_b / 1000)

with P the sampled joint with its delay. Disturbances count where they enter, before P, so that K
damps the lightly damped joint rather than cancel it. W asks for integral action up to the
bandwidth w_b = 2 pi bandwidth_hz, the weight w of the command is the square root of `effort`, and
the noise e has a tenth of the disturbance. The joint is mapped to the w plane by the bilinear rule
and K back by the same, which leaves the norm as it is, so that K is a discrete-time design.

References:
    Doyle, Glover, Khargonekar, Francis (1989), State-space solutions to standard H2 and H-infinity
    control problems, IEEE Transactions on Automatic Control 34(8); Zhou, Doyle, Glover (1996),
    Robust and Optimal Control, Prentice-Hall, chapters 16 to 18.
"""

from __future__ import annotations

import importlib.util
import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_discrete_are

from cjt_gym.baselines.entry import FIXED, ZERO_AT_REST, Gain, Gains
from cjt_gym.baselines.linear_law import Block, LinearLaw, assemble, signals, static
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.state_feedback import check_torque_controllable, with_commands
from cjt_gym.errors import ConfigurationError

Floats = NDArray[np.float64]
Plain = tuple[Floats, Floats, Floats, Floats]
NOISE = 0.1
LEAK = 1e-3


def h_infinity_law(model: SampledJoint, bandwidth_hz: float, effort: float) -> LinearLaw:
    """Return the law; see the module.

    Args:
        model: The joint.
        bandwidth_hz: Up to which disturbances are to be rejected [Hz].
        effort: Weight of the command against the torque [-].

    Raises:
        ConfigurationError: slycot is missing, the torque of the joint cannot be held, or there is
            no controller.
    """
    check_torque_controllable(model)
    a, b, c, d = _synthesis(model, bandwidth_hz, effort)
    error = signals(reference=1.0, tau=-1.0)
    feedback = Block(a, np.outer(b[:, 0], error), c[0], d[0, 0] * error, _conditioning(a, b, c))
    return assemble(model.dt, static(reference=1.0), feedback)


@lru_cache(maxsize=64)
def _synthesis(model: SampledJoint, bandwidth_hz: float, effort: float) -> Plain:
    """Return K from the torque error, as a discrete state space."""
    if importlib.util.find_spec("slycot") is None:
        raise ConfigurationError(
            'Controller h_infinity needs slycot: pip install "cjt-gym[control]".'
        )
    import control

    plant = model.mechanics
    c = np.concatenate([plant.row("tau"), np.zeros(model.loop.delay)])
    system = with_commands(plant.a, plant.b, model.loop.delay)
    a, b, c_w, d_w = to_w_plane(system[0], system[1][:, None], c[None], model.dt)
    corner, n = 2.0 * math.pi * bandwidth_hz, len(a)
    # States: the joint, then the weight W = 1 + (1 - LEAK) corner / (s + LEAK corner).
    whole = np.asarray(block_diag(a, [[-LEAK * corner]]))
    whole[n, :n] = c_w[0]
    direct, boost, weight = d_w[0, 0], (1.0 - LEAK) * corner, math.sqrt(effort)
    into = np.zeros((n + 1, 3))  # disturbance, noise, command
    into[:n, 0], into[:n, 2] = b[:, 0], b[:, 0]
    into[n, [0, 2]] = direct
    out = np.zeros((3, n + 1))  # weighted torque, weighted command, minus the measured torque
    out[0, :n], out[0, n], out[2, :n] = c_w[0], boost, -c_w[0]
    feed = np.array([[direct, 0.0, direct], [0.0, 0.0, weight], [-direct, -NOISE, -direct]])
    try:
        found = control.hinfsyn(control.ss(whole, into, out, feed), 1, 1)[0]
    except (control.ControlException, ArithmeticError, ValueError) as error:
        raise ConfigurationError(
            f"No H-infinity controller for {model.name} at bandwidth_hz = {bandwidth_hz:g} and "
            f"effort = {effort:g}: {error}. Ask for less bandwidth."
        ) from None
    return from_w_plane(found.A, found.B, found.C, found.D, model.dt)


def to_w_plane(a: Floats, b: Floats, c: Floats, dt: float) -> Plain:
    """Return the continuous image of a discrete system without feed-through, s = 2/dt (z-1)/(z+1)."""
    shifted = np.linalg.inv(a + np.eye(len(a)))
    root = math.sqrt(2.0 / dt)
    return (
        2.0 / dt * (a - np.eye(len(a))) @ shifted,
        root * math.sqrt(2.0) * shifted @ b,
        root * math.sqrt(2.0) * c @ shifted,
        -c @ shifted @ b,
    )


def from_w_plane(a: Floats, b: Floats, c: Floats, d: Floats, dt: float) -> Plain:
    """Return the discrete system of which a continuous one is the image."""
    half = 0.5 * dt
    shifted = np.linalg.inv(np.eye(len(a)) - half * a)
    root = math.sqrt(dt)
    return (
        (np.eye(len(a)) + half * a) @ shifted,
        root * shifted @ b,
        root * c @ shifted,
        d + half * c @ shifted @ b,
    )


def _conditioning(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the gain with which K follows a command that is limited, as a Kalman filter would."""
    scale = float(np.linalg.norm(c))
    p = solve_discrete_are(a.T, c.T / scale, b @ b.T + 1e-9 * np.eye(len(a)), np.eye(1))
    row = c / scale
    return np.asarray((a @ p @ row.T / (1.0 + row @ p @ row.T))[:, 0] / scale)


def _law(model: SampledJoint, gains: Gains) -> LinearLaw:
    return h_infinity_law(model, gains["bandwidth_hz"], gains["effort"])


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    return grid(
        bandwidth_hz=(0.2, 1.0, 3.0, 6.0, 12.0), effort=(0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 300.0)
    )


ROW = linear_row(
    name="h_infinity",
    summary="Feed-forward and H-infinity feedback of the torque error.",
    source="Doyle, Glover, Khargonekar, Francis (1989), IEEE Transactions on Automatic Control "
    "34(8); Zhou, Doyle, Glover (1996), Robust and Optimal Control",
    tunable=(
        Gain("bandwidth_hz", "Hz", 0.01, 100.0, log=True),
        Gain("effort", "-", 1e-3, 1e4, log=True),
    ),
    law=_law,
    candidates=_candidates,
    structures=FIXED,
    refusal=ZERO_AT_REST,
)
