"""Rows that other packages bring along, by their entry points.

A package lists them in its pyproject.toml:

    [project.entry-points."cjt_gym.controllers"]
    my_law = "my_package.laws:MyLaw"

Groups: `cjt_gym.controllers` (a `ControllerEntry`, or what makes a controller), `cjt_gym.effects`
(an `Effect`) and `cjt_gym.tasks` (a `Task`). Built-in rows keep their names.
"""

from __future__ import annotations

import warnings
from collections.abc import Container, Iterator
from importlib import metadata
from typing import Any

from cjt_gym.errors import CjtGymWarning


def installed_rows(group: str, taken: Container[str]) -> Iterator[tuple[str, Any]]:
    """Give the names and the rows of a group.

    Args:
        group: "controllers", "effects" or "tasks".
        taken: Names that are not given.

    Warns:
        CjtGymWarning: A row cannot be loaded, or its name is taken; it is left out.
    """
    for point in metadata.entry_points(group=f"cjt_gym.{group}"):
        if point.name in taken:
            _warn(point, "the name is taken")
            continue
        try:
            row = point.load()
        except Exception as error:  # whatever goes wrong in code of others
            _warn(point, f"{type(error).__name__}: {error}")
            continue
        yield point.name, row


def _warn(point: metadata.EntryPoint, why: str) -> None:
    package = point.dist.name if point.dist else "a package"
    text = f"{point.name} of {package} ({point.group} = {point.value}) is left out: {why}."
    warnings.warn(text, CjtGymWarning, stacklevel=3)
