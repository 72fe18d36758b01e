"""Refinement by replay of the datasheet values that the predictors leave open.

A predictor is corrected at every sample and hardly notices a slightly wrong resonance, which
dominates the replay of a lightly damped joint. Values move within the covariance that the
predictors leave, and only as far as the replay of the fitted record, never of a held-out one,
demands.
"""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.judged.gap_size import off
from cjt_gym.gap.judged.replay import written
from cjt_gym.gap.stages.fit import STEP, Fit, Problem
from cjt_gym.gap.stages.intervals import Covariance
from cjt_gym.joint.kernel.arrays import Floats

DEFLATION = 100.0
"""Samples that count as one, since errors of a replay are correlated over a long time."""
FURTHEST = 2.5
"""Largest allowed distance from the datasheet, in standard deviations."""
MOVES = 6
WORTH = 0.9
"""Factor on the replay error below which a refinement is accepted."""


def settled(problem: Problem, fit: Fit, spread: Covariance) -> Fit:
    """Return a fit with the datasheet values that replay the fitted record best.

    Args:
        problem: The record.
        fit: The explanation.
        spread: Covariance of its coordinates, shape (p, p).
    """
    setting = problem.stages.setting
    known = setting.joint.parameters.quantities
    free = [k for k, n in enumerate(problem.shared) if n.field in known and n.unknown.prior]
    if not setting.has_spring or not free:
        return fit
    precision = np.linalg.inv(spread.matrix)[np.ix_(free, free)]

    most = np.maximum(FURTHEST, np.abs(fit.z[free]))

    def moved(move: Floats) -> Floats:
        return np.clip(fit.z[free] + move, -most, most) - fit.z[free]

    def error(move: Floats) -> Floats:
        z = fit.z.copy()
        z[free] += move
        return off(setting, written(problem, fit.model, z))

    def cost(e: Floats, move: Floats) -> float:
        ms = float(e @ e) / len(e)
        penalty = 0.5 * float(move @ precision @ move)
        return len(e) / DEFLATION * float(np.log(max(ms, 1e-300))) + penalty

    move = np.zeros(len(free))
    e = first = error(move)
    best, damping = cost(e, move), 1e-2
    for _ in range(MOVES if np.isfinite(best) else 0):
        steps = [error(move + STEP * unit) for unit in np.eye(len(free))]
        jacobian = (np.stack(steps, axis=1) - e[:, None]) / STEP
        weight = 2.0 / DEFLATION * len(e) / max(float(e @ e), 1e-300)
        hessian = weight * jacobian.T @ jacobian + precision
        gradient = weight * jacobian.T @ e + precision @ move
        if not np.isfinite(hessian).all():
            break
        for _ in range(5):
            change = -np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient)
            there = moved(move + change)
            trial = error(there)
            value = cost(trial, there)
            if value < best:
                break
            damping *= 10.0
        else:
            break
        gain, best, move, e = best - value, value, there, trial
        damping /= 10.0
        if gain < 1.0:
            break
    if not float(np.linalg.norm(e)) < WORTH * float(np.linalg.norm(first)):
        return fit
    z = fit.z.copy()
    z[free] += move
    return problem.fit(fit.model, z, moves=0)
