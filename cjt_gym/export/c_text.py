"""Pieces of C: numbers, arrays, templates."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Container, Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines.linear_law import INPUTS, MEASURED, SIGNALS, LinearLaw
from cjt_gym.baselines.observers import LinearObserver

PER_LINE = 4
VALUES = ", ".join(MEASURED)
"""What is measured, as a function is called with it."""


def identifier(text: str, kind: str = "law") -> str:
    """Return any text as the beginning of names in C; one that cannot begin them follows its kind.

    Example:
        >>> identifier("pid+friction"), identifier("80")
        ('pid_friction', 'law_80')
    """
    name = re.sub(r"\W", "_", text, flags=re.ASCII)
    return name if name[:1].isalpha() else f"{kind}_{name}"


def comment(text: str) -> str:
    """Return a user's text that neither ends nor begins a comment."""
    plain = "".join(c if c.isprintable() else "?" for c in text)
    return plain.replace("*/", "* /").replace("/*", "/ *")


def number(value: float) -> str:
    """Return a number with all its digits."""
    if math.isinf(value):
        return "HUGE_VAL" if value > 0.0 else "-HUGE_VAL"
    return repr(float(value) + 0.0)  # no -0.0


def array(
    kind: str, name: str, values: NDArray[Any], written: Callable[[float], str] = number
) -> str:
    """Return the definition of a constant array; one without values has a single zero."""
    texts = [written(float(value)) for value in np.ravel(values)] or ["0.0"]
    lines = [", ".join(texts[k : k + PER_LINE]) for k in range(0, len(texts), PER_LINE)]
    body = ",\n  ".join(lines)
    return f"static const {kind} {name}[{len(texts)}] = {{\n  {body}}};"


def parameters(kind: str) -> str:
    """Return what is measured as parameters of a function, in two lines."""
    texts = [f"{kind} {name}" for name in MEASURED]
    return f",\n{33 * ' '}".join(", ".join(texts[k : k + 4]) for k in (0, 4))


def meanings(used: Container[str] = INPUTS) -> str:
    """Return lines of a comment that say what the inputs are, and which are not used."""
    return "\n".join(
        f" * {name + ':':<11}{what} [{unit}]{'' if name in used else '; not used, may be 0'}"
        for name, (unit, what) in INPUTS.items()
    )


def filled(template: str, values: Mapping[str, str]) -> str:
    """Return a template with @KEY@ replaced; some keys are the same everywhere."""
    text = template
    for key, value in {**EVERYWHERE, **values}.items():
        text = text.replace(f"@{key}@", value)
    return text


EVERYWHERE = {
    "VERSION": version("cjt-gym"),
    "PARAMETERS": parameters("@REAL@"),
    "VALUES": VALUES,
    "MEANINGS": meanings(),
}
"""Values that a template may leave out."""


def common_values(
    name: str, title: str, joint: str, law: LinearLaw | LinearObserver, **more: NDArray[Any]
) -> dict[str, str]:
    """Return what the templates of all linear laws are told: names, sizes and arrays."""
    kind, order = f"{name.upper()}_REAL", len(law.a)
    tables = {"a": law.a, "b": law.b, "c": law.c, "d": law.d, "rest": law.at_rest(), **more}
    return {
        "TITLE": comment(title),
        "JOINT": comment(joint),
        "DT": number(law.dt),
        "ARRAYS": "\n".join(array(kind, f"{name}_{key}", table) for key, table in tables.items()),
        "STATES": str(max(order, 1)),
        "ORDER": str(order),
        "COUNT": str(len(SIGNALS)),
        "NAME": name,
        "GUARD": f"{name.upper()}_H",
        "REAL": kind,
    }
