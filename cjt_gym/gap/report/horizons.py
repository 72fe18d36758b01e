"""How well the joint is predicted, and what the record can tell: the first sections."""

from __future__ import annotations

from html import escape

from cjt_gym.gap.diagnosis import Diagnosis
from cjt_gym.gap.report.table import Table
from cjt_gym.gap.report.words import number

TITLE = "How well the joint is predicted"
AID = (
    "Error on {}, relative to what the signal did beyond going on at its speed (angles) "
    "or beyond its mean (torque): 100 % is no better than that. The floor is what no model could "
    "avoid, as far as a regression on state, input and past can tell."
)


def horizon_table(diagnosis: Diagnosis) -> Table | None:
    """Return the table of horizons, None where there is none."""
    if not diagnosis.horizons:
        return None
    head = ("ahead", "signal", "datasheet", "least squares", "this joint", "floor")
    rows = [
        (
            f"{row.seconds:.3g} s",
            row.channel,
            _percent(row.datasheet),
            _percent(row.least_squares),
            _percent(row.found),
            _percent(row.floor),
        )
        for row in diagnosis.horizons
    ]
    aid = AID.format("held-out data" if diagnosis.gap.held_out else "the fitted data")
    return Table(TITLE, aid, (head, *rows))


def _percent(x: float | None) -> str:
    return "-" if x is None else f"{number(100.0 * x)} %"


def examined(diagnosis: Diagnosis) -> str:
    """Return what the record can and cannot tell, as HTML."""
    exam = diagnosis.examination
    if exam is None:
        return ""
    faults = "".join(f"<li>{escape(fault)}</li>" for fault in (*exam.faults, *exam.notes))
    cannot = "".join(
        f"<li><b>{escape(row.name)}</b>: {escape(row.why)}</li>" for row in exam.cannot_tell
    )
    can = escape(", ".join(exam.can_tell)) or "nothing of the effect table"
    return (
        (f"<p>The log:</p><ul>{faults}</ul>" if faults else "")
        + f"<p>It would show: {can}.</p>"
        + (f"<details><summary>What it would not show</summary><ul>{cannot}</ul></details>"
           if cannot else "")
    )  # fmt: skip
