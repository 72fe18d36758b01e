"""H-infinity control of the joint torque, with feed-forward.

    u = r + W K (r - tau)

K makes the loop as robust as it can be made against changes of both coprime factors of the shaped
joint Ps = W P, P being the sampled joint with its delay: it minimises, over all controllers,

    || [1; K] (1 + Ps K)^-1 [1, Ps] ||_inf = gamma

which bounds all four transfers from a disturbance at the motor and at the sensor to command and
torque. Disturbances count where they enter, before P, so that K damps the lightly damped joint
rather than cancel it. The shape W = (1 + w_b / s) / sqrt(effort) asks for integral action up to
w_b = 2 pi bandwidth_hz, and for more feedback the less effort weighs; gamma is taken 10 % above
its least value. The least gamma and K have closed forms in two Riccati equations. The joint is
mapped to the w plane by the bilinear rule, and W K back by the same, which leaves the norm as it
is, so that this is a discrete-time design.

References:
    McFarlane, Glover (1992), A loop shaping design procedure using H-infinity synthesis, IEEE
    Transactions on Automatic Control 37(6); Skogestad, Postlethwaite (2005), Multivariable
    Feedback Control, Wiley, section 9.4.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

from cjt_gym.baselines.controller import Floats
from cjt_gym.baselines.entry import FIXED, Gain
from cjt_gym.baselines.linear_law import Block, LinearLaw, assemble, signals, static
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.mechanics import with_commands
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.state_feedback import check_torque_controllable

Plain = tuple[Floats, Floats, Floats, Floats]
LEAK = 1e-4
"""Where the integral of W ends, relative to w_b: a pole at 0 itself cannot be told from a zero."""
SLACK = 1.1
"""Gamma relative to its least value."""
TRUST = 0.1
"""How far a limited command is trusted, relative to what the error feeds through."""


def h_infinity_law(model: SampledJoint, bandwidth_hz: float, effort: float) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    check_torque_controllable(model)
    shaped, weight = shaped_joint(model, bandwidth_hz, effort)
    feedback = from_w_plane(*chain(weight, robust_controller(*shaped)[0]), model.dt)
    a, b, c, d = feedback
    error = signals(reference=1.0, tau=-1.0)
    block = Block(a, np.outer(b[:, 0], error), c[0], d[0, 0] * error, _conditioning(a, b, c, d))
    return assemble(model.dt, static(reference=1.0), block)


def shaped_joint(model: SampledJoint, bandwidth_hz: float, effort: float) -> tuple[Plain, Plain]:
    """Return W P and W in the w plane; see the module."""
    plant, delay = model.mechanics, model.loop.delay
    c = np.concatenate([plant.row("tau"), np.zeros(delay)])
    a, b = with_commands(plant.a, plant.b, delay)
    corner, gain = 2.0 * math.pi * bandwidth_hz, 1.0 / math.sqrt(effort)
    one = np.ones((1, 1))
    weight = (-LEAK * corner * one, one, gain * (1.0 - LEAK) * corner * one, gain * one)
    return chain(to_w_plane(a, b[:, None], c[None], model.dt), weight), weight


def robust_controller(a: Floats, b: Floats, c: Floats, d: Floats) -> tuple[Plain, float]:
    """Return K, for negative feedback, and its gamma for a continuous shaped plant."""
    s, r = np.eye(1) + d.T @ d, np.eye(1) + d @ d.T
    inner = a - b @ np.linalg.solve(s, d.T @ c)
    x = solve_continuous_are(inner, b, c.T @ np.linalg.solve(r, c), s)
    z = solve_continuous_are(inner.T, c.T, b @ np.linalg.solve(s, b.T), r)
    gamma = SLACK * math.sqrt(1.0 + float(np.max(np.linalg.eigvals(x @ z).real)))
    f = -np.linalg.solve(s, d.T @ c + b.T @ x)
    bound = (1.0 - gamma**2) * np.eye(len(a)) + x @ z
    into = gamma**2 * np.linalg.solve(bound.T, z @ c.T)
    found = (a + b @ f + into @ (c + d @ f), into, -b.T @ x, d.T)
    return found, gamma


def chain(first: Plain, second: Plain) -> Plain:
    """Return the second system behind the first."""
    a1, b1, c1, d1 = first
    a2, b2, c2, d2 = second
    a = np.block([[a1, np.zeros((len(a1), len(a2)))], [b2 @ c1, a2]])
    return a, np.concatenate([b1, b2 @ d1]), np.concatenate([d2 @ c1, c2], axis=1), d2 @ d1


def to_w_plane(a: Floats, b: Floats, c: Floats, dt: float) -> Plain:
    """Return the image under s = 2/dt (z - 1)/(z + 1) of a discrete system without feed-through."""
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


def _conditioning(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Return the gain with which W K follows a command that is limited, as a Kalman filter would.

    The command that was applied stands for a measurement of what the error, taken to be white,
    made of the state.
    """
    unit = TRUST * (1.0 + abs(float(d[0, 0])))
    row = c / unit
    p = solve_discrete_are(a.T, row.T, b @ b.T, np.eye(1))
    return np.asarray((a @ p @ row.T / (1.0 + row @ p @ row.T))[:, 0] / unit)


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    effort = np.geomspace(0.03, 1e4, 16).tolist()
    return grid(bandwidth_hz=(0.2, 1.0, 2.0, 4.0, 7.0, 12.0, 20.0, 30.0), effort=effort)


ROW = linear_row(
    name="h_infinity",
    summary="Feed-forward and H-infinity loop shaping of the torque error.",
    source="McFarlane, Glover (1992), IEEE Transactions on Automatic Control 37(6)",
    tunable=(
        Gain("bandwidth_hz", "Hz", 0.01, 100.0, log=True),
        Gain("effort", "-", 1e-3, 1e6, log=True),
    ),
    law=h_infinity_law,
    candidates=_candidates,
    structures=FIXED,
)
