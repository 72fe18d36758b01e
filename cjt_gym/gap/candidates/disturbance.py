"""Signals added to the model: how causes outside the effect table act on a joint.

A disturbance adds a signal to one channel. Its numbers are fields of the model, named after it, so
it is fitted like an effect of the table.

=============  ====================================================
channel        the signal is
=============  ====================================================
i tau q_m q_l  an error of that sensor
push_m push_l  a torque on motor or load [N m]
bar            a torque of the torsion bar [N m]
slack          a width of play at the torsion bar [rad]
rub_m          a level of dry friction of the motor [N m]
=============  ====================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.series import Series
from cjt_gym.joint.kernel.arrays import Floats

Values = Mapping[str, float]
SENSORS = ("i", "tau", "q_m", "q_l")


@dataclass(frozen=True, eq=False)
class Disturbance:
    """A signal added to the model."""

    channel: str  # channel to which it is added
    # maps a record and the disturbance's numbers to the signal, shape (N,)
    signal: Callable[[Series, Values], Floats]


def field_of(name: str, symbol: str) -> str:
    """Return the field of a model that holds a number of a disturbance."""
    return f"{name}.{symbol}"


def disturbing(
    fields: Fields, series: Series, known: Mapping[str, Disturbance]
) -> Mapping[str, Floats]:
    """Return the sum of a model's disturbances on each channel, each of shape (N,)."""
    values: dict[str, dict[str, float]] = {}
    for key, value in fields.items():
        name, dot, symbol = key.partition(".")
        if dot:
            values.setdefault(name, {})[symbol] = value
    total: dict[str, Floats] = {}
    for name, numbers in values.items():
        row = known.get(name)
        if row is None:  # a held-out record may lack the channels on which it acts
            continue
        total[row.channel] = total.get(row.channel, 0.0) + row.signal(series, numbers)
    return total


def corrected(series: Series, errors: Mapping[str, Floats]) -> Series:
    """Return the record as its sensors would have measured it without their errors."""
    wrong = {name: errors[name] for name in SENSORS if name in errors and name in series}
    if not wrong:
        return series
    columns = dict(series.columns) | {name: series[name] - x for name, x in wrong.items()}
    speeds = {name: v for name, v in series._speeds.items() if name not in wrong}
    return replace(series, columns=columns, _speeds=speeds)
