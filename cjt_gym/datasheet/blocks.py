"""What a sheet is made of: headings, paragraphs, tables and figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby


@dataclass(frozen=True)
class Heading:
    """A heading of a part of the sheet."""

    text: str


@dataclass(frozen=True)
class Paragraph:
    """A paragraph."""

    text: str  # text, see `cjt_gym.datasheet.notation`
    small: bool = False  # whether it is a note in small print


@dataclass(frozen=True)
class Facts:
    """A few figures in large print: name, value and unit of each."""

    items: Sequence[tuple[str, str, str]]


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        head: Titles of the columns.
        rows: Cells; a row with one cell only is a title across all columns.
        align: "l" or "r" per column.
        wide: Columns that share the width that the others leave.
        columns: In how many columns side by side the rows are set.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    align: str
    wide: Sequence[int] = ()
    columns: int = 1


@dataclass(frozen=True)
class Figure:
    """A figure."""

    svg: str  # the drawing, as SVG text
    caption: str  # what it shows
    whole: bool = False  # whether it takes the whole width, or stands beside the next


@dataclass(frozen=True)
class Code:
    """Text that is kept as it is, line by line."""

    text: str


@dataclass(frozen=True)
class PageBreak:
    """Where a new page begins, on paper."""


Block = Heading | Paragraph | Facts | Table | Figure | Code | PageBreak


@dataclass(frozen=True)
class Sheet:
    """A sheet, ready to be written."""

    title: str
    subtitle: str  # one line below it
    blocks: Sequence[Block] = field(default_factory=tuple)  # what follows
    footer: str = ""  # small print at the foot of each page

    def rows(self) -> Iterator[tuple[bool, list[tuple[int, Block]]]]:
        """Yield blocks with their numbers; True with figures that stand beside each other."""

        def beside(one: tuple[int, Block]) -> bool:
            return isinstance(one[1], Figure) and not one[1].whole

        for half, row in groupby(enumerate(self.blocks), beside):
            yield half, list(row)
