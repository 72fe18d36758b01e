"""Presentation of a diagnosis: one HTML file, and a few lines for a terminal or a notebook.

==========  ===============================================
`gather`    collects the data behind the charts
`localize`  where in its range a stage's gap lies
`maps`      friction over speed, ripple over angle, loops
`words`     names, places, numbers, the verdict in a sentence
`figures`   signals and maps
`bars`      bars and strips
`drawing`   how a figure looks, and becomes part of the page
`table`     small tables
`page`      the whole report
`summary`   the terminal and the notebook
`examined`  what a record can tell, for the terminal
==========  ===============================================
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cjt_gym.errors import ConfigurationError, check_type
from cjt_gym.gap.diagnosis import Diagnosis
from cjt_gym.gap.report.summary import WIDTH, summary
from cjt_gym.gap.report.table import Table

__all__ = ["WIDTH", "Table", "summary", "write_report"]


def write_report(
    diagnosis: Diagnosis,
    path: str | Path,
    *,
    title: str = "Diagnosis of the sim-to-real gap",
    notes: Sequence[str] = (),
    tables: Sequence[Table] = (),
) -> Path:
    """Write a diagnosis as one HTML file that needs no network, and return its path.

    Args:
        diagnosis: The diagnosis to show.
        path: The file; missing folders are created.
        title: Its heading.
        notes: Repairs of the records and other remarks, one line each.
        tables: Additional tables, each in its own section.

    Raises:
        ConfigurationError: The file cannot be written, or this is no diagnosis.
    """
    from cjt_gym.gap.report.page import page  # loads matplotlib

    check_type("diagnosis", diagnosis, Diagnosis, "a Diagnosis, as diagnose returns it")
    check_type("path", path, (str, Path), "the path of the file to write")
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(page(diagnosis, title, notes, tables), encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(
            f"The report {path} cannot be written: {error.strerror}. Give another path."
        ) from error
    return path
