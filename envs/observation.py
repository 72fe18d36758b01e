"""What is observed, told once: names, meaning, units, scales, order and history.

A class of annotated fields, such as `Observed`, says what an observation holds. From it follow the
numbers that environments give, the tables of their documentation, and what exported policies
compute in NumPy, ONNX and C (`cjt_gym.training.deploy`).
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, NamedTuple, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import check_range
from cjt_gym.joint.border import checked_array

Class = TypeVar("Class", bound=type)
CLIP: Final = 5.0
"""Bound of observations, which tracking keeps below 1 or so."""
SCALES: Final = {
    "torque": ("torque_amplitude", "N m"),
    "velocity": ("velocity_scale", "rad/s"),
    "action": ("action_scale", "N m"),
}
"""Scales of a `Layout`: the arguments of `TorqueTrackingEnv` that set them, and their units."""


class Row(NamedTuple):
    """What a number of an observation is."""

    text: str  # what it means
    unit: str  # its unit before it is scaled
    # what divides it: a number, or an attribute of what the task is described by
    scale: float | str = 1.0
    of: tuple[str, ...] = ()  # inputs of a controller that it is made of
    past: bool = False  # whether samples of the past are observed as well


class Observed(NamedTuple):
    """What is observed of a joint at a control step, in this order; those with a past are last."""

    error: Annotated[
        float, Row("reference minus measured torque", "N m", "torque", ("reference", "tau"))
    ]
    sine: Annotated[float, Row("sine of the measured rotor angle n q_m", "-", of=("q_m",))]
    cosine: Annotated[float, Row("cosine of the same", "-", of=("q_m",))]
    tau: Annotated[float, Row("measured torque", "N m", "torque", ("tau",), True)]
    dq_m: Annotated[float, Row("measured motor velocity", "rad/s", "velocity", ("dq_m",), True)]
    dq_l: Annotated[float, Row("measured load velocity", "rad/s", "velocity", ("dq_l",), True)]
    command: Annotated[float, Row("motor torque that was commanded", "N m", "torque", (), True)]


def rows_of(kind: type) -> dict[str, Row]:
    """Return what the fields of such a class are."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items()}


def divisors(kind: type, owner: Any) -> NDArray[np.float64]:
    """Return what divides each field: a number, or the attribute of the owner that is named."""
    scales = [row.scale for row in rows_of(kind).values()]
    return np.array([getattr(owner, x) if isinstance(x, str) else x for x in scales], np.float64)


ROWS: Final = {
    "ahead": Row("reference now and at the next control steps", "N m", "torque", of=("reference",)),
    **rows_of(Observed),
}
"""What stands in an observation of a joint, first to last."""
PAST: Final = sum(row.past for row in ROWS.values())
PRESENT: Final = len(Observed._fields) - PAST
"""How many fields of `Observed` have their past in an observation, and how many have not."""


@dataclass(frozen=True)
class Layout:
    """The observation of a task and the unit of its action.

    Attributes:
        preview: Future samples of the reference.
        history: Samples of every signal that has a past.
        torque: Torque that observations and rewards are divided by [N m].
        velocity: Velocity that observations are divided by [rad/s].
        action: Motor torque of an action of 1 [N m].
        n: Gear ratio; the rotor's angle is n q_m.
        dt: Control step [s].
        joint_numbers: What of the joint's datasheet ends an observation.
    """

    preview: int
    history: int
    torque: float
    velocity: float
    action: float
    n: float
    dt: float
    joint_numbers: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name, least in (("preview", 0), ("history", 1)):
            check_range(name, getattr(self, name), low=least, whole=True)
        positive = {**SCALES, "n": ("n", "-"), "dt": ("dt_control", "s")}
        for name, (argument, unit) in positive.items():
            check_range(argument, getattr(self, name), unit, above=0.0)
            object.__setattr__(self, name, float(getattr(self, name)))
        numbers = self.joint_numbers
        if len(numbers) > 0:
            numbers = tuple(checked_array("joint_numbers", numbers, (None,)).tolist())
        object.__setattr__(self, "joint_numbers", tuple(numbers))

    @property
    def head(self) -> int:
        """Numbers of an observation before its history."""
        return self.preview + 1 + PRESENT

    @property
    def size(self) -> int:
        """Numbers of an observation without those of the datasheet, which stay what they are."""
        return self.head + PAST * self.history

    @property
    def divisors(self) -> NDArray[np.float64]:
        """What divides each field of `Observed`, shape (7,)."""
        return divisors(Observed, self)

    def names(self) -> list[str]:
        """Return which of `ROWS` stands at each place before the numbers of the datasheet."""
        ahead, fields = [*ROWS][:1], Observed._fields
        return [*ahead * (self.preview + 1), *fields[:PRESENT], *fields[PRESENT:] * self.history]

    def scales(self) -> dict[str, float]:
        """Return the arguments of `TorqueTrackingEnv` that set the scales."""
        return {argument: getattr(self, name) for name, (argument, _) in SCALES.items()}


def observation_table(places: Iterable[object], rows: Mapping[str, Row]) -> str:
    """Return the table of the documentation: what stands where, and what divides it."""
    lines = ["| Index | Observation | Unit before scaling | Scale |", "|---|---|---|---|"]
    for place, row in zip(places, rows.values(), strict=True):
        scale = f"{row.scale:.4g}" if isinstance(row.scale, float) else f"`{_argument(row.scale)}`"
        lines.append(f"| {place} | {row.text} | {row.unit} | {scale} |")
    return "\n".join(lines)


def _argument(scale: str) -> str:
    return SCALES[scale][0] if scale in SCALES else scale


def with_tables(**tables: str) -> Callable[[Class], Class]:
    """Return what puts tables into the docstring of a class, where their names are in braces."""

    def table(found: re.Match[str]) -> str:
        return textwrap.indent(tables[found[2]], found[1])

    def put(target: Class) -> Class:
        if target.__doc__:  # python -OO has none
            names = "|".join(tables)
            target.__doc__ = re.sub(rf"(?m)^( *)\{{({names})\}}", table, target.__doc__)
        return target

    return put


def observes(kind: type) -> Callable[[Class], Class]:
    """Return what puts the table of what such a class says into the docstring of another."""
    rows = rows_of(kind)
    return with_tables(observation=observation_table(range(len(rows)), rows))
