"""The picture of records: a panel for every unit, all over the same time."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawn

from cjt_gym.datasheet.blocks import Figure, Sheet, Table
from cjt_gym.datasheet.drawing import COLOURS, RED, canvas, legend
from cjt_gym.datasheet.html import to_html
from cjt_gym.datasheet.notation import plain
from cjt_gym.disk import write_bytes
from cjt_gym.records import FloatArray, Record
from cjt_gym.records.columns import TRUE_PREFIX

WIDTH, PANEL, MARGIN = 9.0, 1.7, 0.6
"""Width, height of a panel and of what is around them [inch]."""
BINS = 2000
"""Pieces of a curve, of each of which least and largest value are drawn."""
LINES = ("-", "--", ":", "-.")
FACTS = ("kind", "controller", "policy", "reference", "protocol", "bus", "source")
"""What of a record's provenance stands on a page."""


@dataclass(frozen=True)
class Trace:
    """A record and the name of its curves."""

    name: str
    record: Record


def write_plot(traces: Sequence[Trace], columns: Sequence[str] | None, out: Path) -> list[str]:
    """Draw records and write the picture whole; return the columns that are drawn."""
    panels = _panels(traces, columns)
    kind = out.suffix.lower().removeprefix(".")
    with canvas(WIDTH, MARGIN + PANEL * max(len(panels), 1)) as (figure, svg):
        _draw(figure, traces, panels)
        if kind == "html":
            written = to_html(_sheet(traces, svg())).encode()
        else:
            buffer = io.BytesIO()
            figure.savefig(buffer, format=kind, dpi=150)
            written = buffer.getvalue()
    out.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(out, written)
    return [name for names in panels.values() for name in names]


def _panels(traces: Sequence[Trace], columns: Sequence[str] | None) -> dict[str, list[str]]:
    """Return the columns to draw by their units, in the order asked for or of the records."""
    panels: dict[str, list[str]] = {}
    for trace in traces:
        for name in columns or trace.record.columns:
            if name == "t" or name not in trace.record:
                continue
            panel = panels.setdefault(trace.record.units[name], [])
            if name not in panel:
                panel.append(name)
    return panels


def _draw(figure: Drawn, traces: Sequence[Trace], panels: dict[str, list[str]]) -> None:
    axes: Any = figure.subplots(max(len(panels), 1), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (unit, names) in zip(axes, panels.items(), strict=False):
        for trace in traces:
            _curves(panel, trace, names, unit, len(traces) > 1)
        _plain_text(panel.set_ylabel(f"[{unit}]"))
        legend(panel, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)  # beside the curves
        for text in panel.get_legend().get_texts() if panel.get_legend() else ():
            _plain_text(text)
    axes[-1].set_xlabel("t [s]")
    _plain_text(figure.suptitle(", ".join(trace.name for trace in traces), fontsize="medium"))


def _curves(axes: Axes, trace: Trace, names: Sequence[str], unit: str, named: bool) -> None:
    record = trace.record
    for name in names:
        if name not in record or record.units[name] != unit:
            continue
        t, value = _envelope(record.t, record[name])
        label = f"{name} ({trace.name})" if named else name
        width = 0.7 if name.startswith(TRUE_PREFIX) else 1.1
        times, k = divmod(len(axes.lines), len(COLOURS))
        line, colour = LINES[times % len(LINES)], COLOURS[k]
        # a label that begins with an underscore would be left out of the legend
        axes.plot(t, value, line, color=colour, linewidth=width, label=label.lstrip("_"))
    if "fault" in record.provenance:
        axes.axvline(float(record.t[-1]), color=RED, linewidth=0.8)


def _envelope(t: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a curve with least and largest value of each piece, where it has many samples."""
    if len(t) <= 2 * BINS:
        return t, value
    pieces = np.array_split(np.arange(len(t)), BINS)
    kept = []
    for piece in pieces:
        part = value[piece]
        seen = np.isfinite(part)
        if seen.all():
            kept += sorted((piece[np.argmin(part)], piece[np.argmax(part)]))
        else:
            kept += [piece[0], piece[-1]]
    return t[kept], value[kept]


def _plain_text(text: Any) -> None:
    """Let a text be what it is: names may contain a dollar sign."""
    text.set_parse_math(False)


def _sheet(traces: Sequence[Trace], svg: str) -> Sheet:
    tables = [Table((plain(trace.name), ""), _facts(trace), "ll", wide=(1,)) for trace in traces]
    title = plain(", ".join(trace.name for trace in traces))
    return Sheet(title, "", [Figure(svg, "", whole=True), *tables])


def _facts(trace: Trace) -> list[tuple[str, str]]:
    record = trace.record
    known: dict[str, Any] = {
        "joint": record.joint,
        "structure": record.structure,
        "samples": len(record),
        "dt [s]": f"{record.dt:g}",
    }
    known |= {name: record.provenance.get(name) for name in FACTS}
    fault = record.provenance.get("fault")
    if isinstance(fault, dict):
        known["ended by"] = f"{fault.get('kind')}: {fault.get('text')}"
    return [(name, plain(str(value))) for name, value in known.items() if value is not None]
