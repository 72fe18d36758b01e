"""Tables as text: a line of names, then a line of numbers per row.

The separator is a comma, a semicolon, a tab or blanks, whichever the line of names shows. Where it
is not a comma, a comma within a number is a decimal point. Dates as of ISO 8601 are seconds.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk import COLUMNS, NUMBERS
from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray

SEPARATORS = (",", ";", "\t")
NO_TEXT = re.compile("[\x00-\x08\x0e-\x1f]")
"""Control characters, which no line of names has."""
LONGEST = 1_000_000
"""Bytes of the line of names that are looked at for its encoding."""
ROWS = 100_000
"""Rows that are parsed at a time."""
MANY = 0.2
"""Share of the cells of a column from which texts are no damage: it is not one of numbers."""
SEEN = 20
"""Lines below the names by whose cells it is seen that these are not names."""


def read(path: Path) -> dict[str, FloatArray]:
    """Return all columns; every line must hold as many numbers as there are names."""
    pieces = list(_pieces(path, ROWS, strict=True))
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def stream(path: Path, rows: int) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield pieces of so many rows. What is not a number is NaN, a damaged line a row of NaN.

    A column with much text is one of text.
    """
    return _pieces(path, rows, strict=False)


def write(columns: Mapping[str, FloatArray], path: Path) -> None:
    """Write columns with 17 digits, which is what a float has."""
    np.savetxt(
        path,
        np.column_stack(list(columns.values())),
        fmt="%.17g",
        delimiter="\t" if path.suffix.lower() == ".tsv" else ",",
        header=("\t" if path.suffix.lower() == ".tsv" else ",").join(columns),
        comments="",
        encoding="utf-8",
    )


def _pieces(path: Path, rows: int, strict: bool) -> Iterator[dict[str, NDArray[Any]]]:
    errors = "strict" if strict else "replace"
    with path.open(encoding=_encoding(path), newline="", errors=errors) as f:
        number, separator, names = _header(path, f)
        _check_names(path, names)
        first, count = True, 0
        while (lines := list(islice(f, rows))) or first:
            if first and not strict:
                _check_width(path, names, lines[:SEEN])
            count += len(lines) * len(names)
            NUMBERS.check(count, path, RecordError)
            table = _numbers(path, number + 1, lines, separator, len(names), strict)
            yield dict(zip(names, table, strict=True))
            number += len(lines)
            first = False


def _encoding(path: Path) -> str:
    """Return UTF-8, or the code page of Windows where the line of names is no UTF-8."""
    with path.open("rb") as file:
        while line := file.readline(LONGEST):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError:
                return "cp1252"
            if line.strip() and line.lstrip()[:1] not in (b"#", b"%"):
                break
    return "utf-8-sig"


def _header(path: Path, file: TextIO) -> tuple[int, str | None, list[str]]:
    """Return the number of the line of names, the separator, and the names.

    Lines that begin with # or % are comments, except that the last of them holds the names where
    numbers follow it at once, as NumPy writes them.
    """
    number, comment = 0, ""
    while line := file.readline():
        number += 1
        text = line.strip()
        if text[:1] in ("#", "%"):
            comment = text.lstrip("#% ")
        elif text:
            separator = _separator(text)
            cells = _cells(text, separator)
            if not comment or not all(map(_is_number, cells)):
                return number, separator, cells
            separator = _separator(comment)
            file.seek(0)
            for _ in range(number - 1):
                file.readline()
            return number - 1, separator, _cells(comment, separator)
    raise RecordError(f"{path} must begin with a line of column names, got an empty file.")


def _separator(text: str) -> str | None:
    best = max(SEPARATORS, key=text.count)
    if best in text:
        return best
    return None if " " in text else ","


def _cells(text: str, separator: str | None) -> list[str]:
    if separator is None:
        return text.split()
    return [cell.strip() for cell in next(csv.reader([text], delimiter=separator), [])]


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _check_names(path: Path, names: list[str]) -> None:
    COLUMNS.check(len(names), path, RecordError)
    if NO_TEXT.search("".join(names)):
        raise RecordError(
            f"{path} must begin with a line of column names, got bytes that are no text. "
            "Read another format by its own suffix, or save the table as text."
        )
    if 2 * (numbers := sum(map(_is_number, names))) >= len(names):
        what = "the numbers" if numbers == len(names) else "the labels and numbers"
        raise RecordError(
            f"{path} must begin with a line of column names, such as  time_ms,angle_deg,i_mA, "
            f"got {what} {', '.join(names[:4])}. Write such a line at its top, and leave out what "
            "stands above it."
        )
    if len(set(names)) < len(names):
        name = next(name for name in names if names.count(name) > 1)
        raise RecordError(
            f"Every column of {path} must have a name of its own, got {name!r} twice. Rename one "
            "of them in its first line."
        )


def _check_width(path: Path, names: list[str], lines: list[str]) -> None:
    """Refuse a first line that has far fewer cells than those below: it is a title."""
    widths = sorted(len(_cells(line, _separator(line))) for line in lines if line.strip())
    usual = widths[len(widths) // 2] if widths else len(names)
    if usual > len(names) + 1:
        raise RecordError(
            f"{path} must begin with a line of column names, got {', '.join(names[:4])!r} above "
            f"lines of {usual} cells. Leave out what stands above the names."
        )


def _numbers(
    path: Path, number: int, lines: list[str], separator: str | None, width: int, strict: bool
) -> Sequence[NDArray[Any]]:
    """Return the columns of some lines, shape (rows,) each; at first as fast as can be.

    A column of which much is text is one of text.
    """
    if separator != ",":
        lines = [line.replace(",", ".") for line in lines]
    try:
        if not any(map(str.strip, lines)):
            return [np.empty(0)] * width
        table: FloatArray = np.loadtxt(lines, delimiter=separator, comments=None, ndmin=2)
        if table.shape[1] == width:
            return list(table.T)
    except ValueError:
        pass
    rows = [
        _row(path, number + k, _cells(line.strip("\r\n"), separator), width, strict)
        for k, line in enumerate(lines)
        if line.strip()
    ]
    return [_column(cells) for cells in zip(*rows, strict=True)]


def _row(path: Path, number: int, cells: list[str], width: int, strict: bool) -> list[str]:
    """Return the cells of a line, which may be empty where a log is read as it is."""
    if len(cells) != width:
        if strict:
            raise RecordError(
                f"Line {number} of {path} must have {width} values like its header, "
                f"got {len(cells)}."
            )
        return [""] * width
    if strict and None in map(_value, cells):
        raise RecordError(
            f"Line {number} of {path} must hold numbers with a decimal point, "
            f"got {','.join(cells)!r}."
        )
    return cells


def _column(cells: Sequence[str]) -> NDArray[Any]:
    """Return the numbers of a column, NaN for a text among them, or texts if many are."""
    values = [_value(cell) for cell in cells]
    if values.count(None) > MANY * len(cells):
        return np.array(cells, dtype=np.str_)
    return np.array([np.nan if value is None else value for value in values])


def _value(cell: str) -> float | None:
    """Return the number in a cell, of a date the seconds since 1970 (UTC); None if it is neither.

    An empty cell is NaN.
    """
    try:
        return float(cell or "nan")
    except ValueError:
        pass
    try:
        moment = datetime.fromisoformat(cell)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
