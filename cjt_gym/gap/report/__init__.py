"""Presentation of a diagnosis: one HTML file, and a few lines for a terminal or a notebook.

==========  ===============================================
`gather`    collects the data behind the charts
`localize`  where in its range a stage's gap lies
`maps`      friction over speed, ripple over angle, loops
`words`     names, places, numbers, the verdict in a sentence
`chart`     line and dot charts as inline SVG
`bars`      bars and strips as HTML
`figures`   which charts a diagnosis has
`table`     small tables
`page`      the whole report
`summary`   the terminal and the notebook
==========  ===============================================
"""

from cjt_gym.gap.report.page import write_report
from cjt_gym.gap.report.summary import WIDTH, summary
from cjt_gym.gap.report.table import Table

__all__ = ["WIDTH", "Table", "summary", "write_report"]
