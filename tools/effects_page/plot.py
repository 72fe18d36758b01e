"""What one entry of the table of figures says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure


@dataclass(frozen=True)
class Plot:
    """A figure and the text that the effect table does not have.

    Attributes:
        equation: Its equation, one or more lines of LaTeX.
        caption: What the figure shows and what to see in it.
        draw: Simulates and draws; has the name of the effect.
    """

    equation: str
    caption: str
    draw: Callable[[], Figure]
