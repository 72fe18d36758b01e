"""The table of observers: one row each, from which the command that writes them in C reads them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cjt_gym.baselines.entry import Gain, check_gains
from cjt_gym.baselines.observers.disturbance import disturbance_observer
from cjt_gym.baselines.observers.extended_state import extended_state_observer
from cjt_gym.baselines.observers.kalman import OUTPUTS, kalman_filter
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.observers.luenberger import spread_observer
from cjt_gym.baselines.observers.model import design_model
from cjt_gym.baselines.observers.momentum import momentum_observer
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError, check_name

Make = Callable[[SampledJoint, Mapping[str, float], tuple[str, ...]], LinearObserver]
HZ = Gain("bandwidth_hz", "Hz", 0.01, 1000.0, log=True)


@dataclass(frozen=True)
class ObserverEntry:
    """One row of the table."""

    name: str  # its name
    summary: str  # what it is, in one line
    # its numbers with their ranges; those without a usual value have to be given
    tunable: tuple[Gain, ...]
    make: Make  # makes it for a sampled joint, numbers and measured signals
    outputs: tuple[str, ...] = ("tau",)  # measured signals where none are given
    chosen: int = 0  # how many measured signals may be chosen: none, one, or any number (-1)


def _luenberger(
    model: SampledJoint, gains: Mapping[str, float], outputs: tuple[str, ...]
) -> LinearObserver:
    design = design_model(model, outputs, gains["disturbance"] > 0.0)
    return spread_observer(design, gains["bandwidth_hz"])


OBSERVERS = {
    row.name: row
    for row in (
        ObserverEntry(
            "luenberger",
            "States and, with disturbance 1, a constant disturbance; poles near one bandwidth.",
            (HZ, Gain("disturbance", "-", 0.0, 1.0, usual=1.0)),
            _luenberger,
            chosen=-1,
        ),
        ObserverEntry(
            "kalman",
            "States and, with a drift, a disturbance; steady Kalman filter.",
            (Gain("torque_noise", "N m", 0.0, 1e3), Gain("drift", "N m", 0.0, 1e3, usual=0.0)),
            lambda m, g, outputs: kalman_filter(m, g["torque_noise"], g["drift"], outputs),
            OUTPUTS,
            -1,
        ),
        ObserverEntry(
            "extended_state",
            "States and disturbance from the torque, poles near one bandwidth.",
            (HZ,),
            lambda m, g, outputs: extended_state_observer(m, g["bandwidth_hz"]),
        ),
        ObserverEntry(
            "momentum",
            "What opposes the motor, from its momentum.",
            (HZ,),
            lambda m, g, outputs: momentum_observer(m, g["bandwidth_hz"]),
        ),
        ObserverEntry(
            "disturbance",
            "What disturbs the motor, from the inverse of the joint.",
            (HZ,),
            lambda m, g, outputs: disturbance_observer(m, g["bandwidth_hz"], outputs[0]),
            chosen=1,
        ),
    )
}


def make_observer(
    name: str,
    model: SampledJoint,
    gains: Mapping[str, float],
    outputs: tuple[str, ...] | None = None,
) -> LinearObserver:
    """Return the observer of that name.

    Args:
        name: A row of `OBSERVERS`.
        model: The joint.
        gains: Values of its numbers; those left out have their usual values.
        outputs: Measured signals; None for those of the row.

    Raises:
        UnknownNameError: There is no such observer, number or signal.
        ConfigurationError: A number is missing or out of range, the signals cannot be chosen, or
            do not show what is to be observed.
    """
    check_name("observer", name, OBSERVERS)
    row = OBSERVERS[name]
    check_gains(f"observer {name}", row.tunable, gains)
    usual = {g.name: g.usual for g in row.tunable if g.usual is not None}
    gains = usual | dict(gains)
    missing = [f"{g.name} [{g.unit}]" for g in row.tunable if g.name not in gains]
    if missing:
        raise ConfigurationError(f"The observer {name} needs {', '.join(missing)}.")
    if outputs is not None and row.chosen >= 0 and len(outputs) != row.chosen:
        allowed = "one measured signal" if row.chosen else "no choice of measured signals"
        raise ConfigurationError(
            f"The observer {name} takes {allowed}, got {', '.join(outputs) or 'none'}."
        )
    return row.make(model, gains, row.outputs if outputs is None else outputs)
