"""The table of figures, into which each function that draws one is entered by `plot`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

Draw = Callable[[], Figure]


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
    draw: Draw


PLOTS: dict[str, Plot] = {}


def plot(equation: str, caption: str) -> Callable[[Draw], Draw]:
    """Return a decorator that enters a function as the figure of the effect of its name."""

    def entered(draw: Draw) -> Draw:
        PLOTS[draw.__name__] = Plot(equation, caption, draw)
        return draw

    return entered
