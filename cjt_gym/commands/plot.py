"""`cjt-gym plot`: records as a picture or a page."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cjt_gym.console import Answer
from cjt_gym.disk import refuse_inputs
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint import load_joint_file
from cjt_gym.records import Record, is_record, read_log, read_record

SUFFIXES = (".html", ".png", ".svg", ".pdf")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the records, what of them, and where to."""
    add = parser.add_argument
    text = "records or logs, by file or by the name of one that ships; drawn in the same axes"
    add("records", nargs="+", metavar="RECORD", help=text)
    add("--mapping", metavar="FILE", help="TOML file that says which column is what, in which unit")
    add("--joint", metavar="JOINT", help="joint whose gear ratio a mapping needs: a name or a file")
    add("--out", type=Path, required=True, metavar="FILE", help=f"{', '.join(SUFFIXES)}")
    add("--columns", nargs="+", metavar="C", help="what to draw; default: every column")
    text = "part to draw, in the time of the records [s]; default: all"
    add("--between", nargs=2, type=float, metavar=("BEGIN", "END"), help=text)


def run(options: argparse.Namespace) -> Answer:
    """Draw, write and say where."""
    if options.out.suffix.lower() not in SUFFIXES:
        raise ConfigurationError(
            f"--out must end in {', '.join(SUFFIXES)}, got {options.out}. The suffix selects the "
            "format."
        )
    from cjt_gym.datasheet.record_plot import Trace, write_plot  # loads matplotlib

    refuse_inputs([options.out], options.records)
    n = None if options.joint is None else load_joint_file(options.joint).gear_ratio
    traces = [
        Trace(name, _part(record, options.between, word))
        for word in options.records
        for name, record in _pieces(word, options.mapping, n)
    ]
    known = {name for trace in traces for name in trace.record.columns if name != "t"}
    for name in options.columns or ():
        check_name(f"column of {', '.join(options.records)}", name, sorted(known))
    columns = write_plot(traces, options.columns, options.out)
    result = {"plot": str(options.out), "records": options.records, "columns": columns}
    return result, f"{options.out}: {', '.join(columns)}"


def _pieces(word: str, mapping: str | None, n: float | None) -> list[tuple[str, Record]]:
    """Return a record as it is, or the repaired pieces of a log, with their names."""
    name = Path(word).stem
    if mapping is None and n is None and is_record(word):
        return [(name, read_record(word))]
    pieces, _ = read_log(word, mapping, n=n)
    if len(pieces) == 1:
        return [(name, pieces[0])]
    return [(f"{name}, piece {k}", piece) for k, piece in enumerate(pieces, 1)]


def _part(record: Record, between: list[float] | None, word: str) -> Record:
    """Return a record between two times [s]."""
    if between is None:
        return record
    begin, end = between
    first, last = np.searchsorted(record.t, begin), np.searchsorted(record.t, end, side="right")
    if begin > end or first >= last:
        raise ConfigurationError(
            f"--between must hold samples of {word}, which lasts from {record.t[0]:g} to "
            f"{record.t[-1]:g} s, got {begin:g} to {end:g}."
        )
    return record.slice(int(first), int(last))
