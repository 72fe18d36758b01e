"""Which input a log writes into a row: one between two rows, from then on, or a late one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cjt_gym.gap.horizons.fitting.fit import Fit, Problem
from cjt_gym.gap.horizons.prediction.case import Case, late_windows

NEAR, EARLIEST = (-1.0, -0.5, 0.5), -6.0
"""Rows by which a motion may follow a measured current beside 0, the mean of two rows: 0.5 is the
one from a row on, -0.5 the one until the next, and -1 one that reaches the log late; and the most
that are searched."""
CLEARLY = 0.94
"""Largest error with such an input, relative to the usual one. It is 0.82 to 0.93 on three real
records whose current is logged 1.0 to 1.4 rows late by other regressions, 0.87 on one more, and
0.955 or more on 35 others of 20 to 350 Hz; simulated loops of both kinds at 250 Hz have 0.49 and
0.37. Of commands and voltages, seven real records of 20 to 500 Hz have 0.93 or more, simulated
loops at 1 kHz 0.61 to 0.76 in logs of 100 to 250 Hz."""
ITS_OWN = frozenset({"command_delay", "current_lag"})
"""Effects that make up for a current of other instants."""


def lateness(case: Case, fit: Fit) -> float:
    """Return by how many rows the motion follows its input, from -6 to 0.5.

    A command or voltage is usually held from its row on (0.5), but a loop that is faster than its
    log changes it between two rows (0). The terms of a fit are fitted anew to each, as values that
    were fitted to one make up for it. A joint with a spring does not tell, as its resonance and
    delays do the same.
    """
    first, model, shape = case.logs[0], fit.model, case.joint.structure_row
    measured, usual = first.drive == "i", first.usual
    if shape.size > 1 or shape.output_fixed or (first.rows > 1 and not measured):
        return usual
    drop = ITS_OWN if measured else frozenset[str]()
    kept = [k for k, term in enumerate(model.terms) if term.name not in drop]
    z = np.concatenate([fit.z[model.span(k)] for k in kept])
    model = replace(model, terms=tuple(model.terms[k] for k in kept))

    def error(rows: float) -> float:
        fitted = Problem(late_windows(case.fit, rows)).fit(model, z)
        return float(np.mean(np.log(np.maximum(fitted.relative(), 1e-12))))

    tried = {rows: error(rows) for rows in (NEAR if measured else (0.0,))}
    best = min(tried, key=tried.__getitem__)
    while EARLIEST < best == min(tried) <= -1.0:
        tried[best - 0.5] = error(best - 0.5)
        best = min(tried, key=tried.__getitem__)
    return best if tried[best] < error(usual) + np.log(CLEARLY) else usual
