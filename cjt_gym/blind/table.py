"""The score of a blind test as a table for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cjt_gym.blind.score import agrees


def percent(rate: Mapping[str, Any]) -> str:
    """Return a rate with its counts and its 95 % interval."""
    if not rate["total"]:
        return "no case"
    return (
        f"{rate['hits']:4d} of {rate['total']:<4d} {100 * rate['share']:5.1f} %  "
        f"({100 * rate['low']:.1f} .. {100 * rate['high']:.1f} %)"
    )


def average(value: Mapping[str, Any], scale: float = 1.0, unit: str = "") -> str:
    """Return a mean with its 95 % interval and the number of values."""
    if not value["total"]:
        return "no case"
    low, high = scale * value["low"], scale * value["high"]
    return f"{scale * value['mean']:.3f}{unit}  ({low:.3f} .. {high:.3f}{unit}; {value['total']})"


def lines(s: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the label and the score of each line."""
    first, wrong, seen = s["first_right"], s["wrong_confirmed"], s["invisible"]
    out = [
        ("first name right", percent(first["known"])),
        ("  one effect", percent(first["single"])),
        ("  two effects", percent(first["pair"])),
        ("  where check does not exclude it", percent(first["not_excluded"])),
        ("set of names exact", percent(s["exact"])),
        ("set F1, mean", average(s["f1"])),
        ("false alarms", percent(s["false_alarms"])),
        ("explained, yet called unexplained", percent(s["called_unexplained"])),
        ("outside the table: recognised", percent(s["outside"]["recognised"])),
        ("  known effect beside it named", percent(s["outside"]["known_beside_named"])),
        ("wrong confirmed name, with outside", percent(wrong["with_outside"])),
        ("wrong confirmed name, without", percent(wrong["without_outside"])),
        ("95 % intervals that cover", percent(s["coverage"])),
        ("shrink, |predicted - true|", average(s["shrink"]["error"], 100.0, " points")),
        ("  within 5 points", percent(s["shrink"]["within_5_points"])),
        ("calibration error of confidence", _points(s["confidence"]["error"])),
        ("invisible effects: right", percent(seen["right"])),
        ("  silent", percent(seen["silent"])),
        ("  a wrong name", percent(seen["wrong"])),
    ]
    out += [(f"first name right, {name}", percent(r)) for name, r in s["structures"].items()]
    for name, key in (("time per diagnosis", "seconds"), ("  of a processor", "cpu_seconds")):
        if s[key]["median"] is not None:
            text = (
                f"median {s[key]['median']:.1f} s, 95 % within {s[key]['p95']:.1f} s, "
                f"longest {s[key]['largest']:.1f} s"
            )
            out.append((name, text))
    if s["failed"]:
        out.append(("failed", f"{s['failed']} of {s['cases']}"))
    return out


COUNTED = {
    "first_right": "first name",
    "exact": "all names",
    "no_wrong_confirmed": "no wrong confirmed name",
    "no_false_alarm": "no false alarm",
}
"""Figures for each kind of defect, with their headings."""


def defect_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the score by kind of defect as cells, its heading first; empty without defects."""
    if not summary["defects"]:
        return []
    head = ("defect", "cases", *COUNTED.values())
    return [head] + [
        (name, str(of["cases"]), *(_share(of[key]) for key in COUNTED))
        for name, of in summary["defects"].items()
    ]


def _share(rate: Mapping[str, Any]) -> str:
    if not rate["total"]:
        return "-"
    return f"{rate['hits']} of {rate['total']}, {100 * rate['share']:.0f} %"


def table(summary: Mapping[str, Any]) -> str:
    """Return the table: rates with counts and 95 % intervals, and the confusion matrix."""
    rows = lines(summary)
    width = max(len(name) for name, _ in rows)
    text = [f"{summary['cases']} cases; in brackets 95 % intervals", ""]
    text += [f"{name:{width}s}  {value}" for name, value in rows]
    cells = defect_rows(summary)
    if cells:
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        text += [""] + ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]
    bins = summary["confidence"]["bins"]
    if bins:
        text += ["", "confidence       names right"]
        text += [f"{b['from']:.2f} .. {b['to']:.2f}  {percent(b)}" for b in bins]
    wrong = [entry for entry in summary["confusion"]["counts"] if not agrees(*entry[:2])]
    text += ["", "true effect           first name, where they differ"]
    text += [f"{true:21s} {first}{f' ({n})' if n > 1 else ''}" for true, first, n in wrong]
    if not wrong:
        text[-1] = "no wrong first name"
    return "\n".join(text)


def _points(error: float | None) -> str:
    return "no name" if error is None else f"{error:.3f}"
