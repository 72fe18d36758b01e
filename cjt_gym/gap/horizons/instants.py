"""Which current a log writes into a row: the one at its instant, until then, or from then on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cjt_gym.gap.horizons.case import Case, late_windows
from cjt_gym.gap.horizons.fit import Fit, Problem

HALF_A_ROW = (-0.5, 0.5)
"""Rows by which a motion follows the mean of a current that was measured until, or from, a row."""
CLEARLY = 0.9
"""Largest error with such a current, relative to that with the mean of its rows. Twelve of 13 real
records of 20 to 350 Hz stay above 0.96, the other has 0.87; simulated loops of both kinds at 250 Hz
have 0.49 and 0.37."""
ITS_OWN = frozenset({"command_delay", "current_lag"})
"""Effects that make up for a current of other instants."""


def lateness(case: Case, fit: Fit) -> float:
    """Return by how many rows the motion follows a measured current: -0.5, 0 or 0.5.

    The terms of a fit are fitted anew to each, as values that were fitted to one make up for it. A
    joint with a spring does not tell, as its resonance and delays do the same.
    """
    first, model, shape = case.logs[0], fit.model, case.joint.structure_row
    single = shape.size == 1 and not shape.output_fixed
    if first.drive != "i" or first.rows > 1 or not single:
        return 0.0
    kept = [k for k, term in enumerate(model.terms) if term.name not in ITS_OWN]
    z = np.concatenate([fit.z[model.span(k)] for k in kept])
    model = replace(model, terms=tuple(model.terms[k] for k in kept))

    def error(rows: float) -> float:
        fitted = Problem(late_windows(case.fit, rows)).fit(model, z)
        return float(np.mean(np.log(np.maximum(fitted.relative(), 1e-12))))

    least, rows = min((error(rows), rows) for rows in HALF_A_ROW)
    return rows if least < error(0.0) + np.log(CLEARLY) else 0.0
