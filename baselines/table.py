"""The table of controllers: one row each, from which commands, benchmark and tests read them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cjt_gym.baselines.controller import Controller
from cjt_gym.baselines.open_loop import OpenLoop
from cjt_gym.baselines.pd_design import default_gains
from cjt_gym.baselines.pd_feedforward import CUTOFF_HZ, PdFeedForward
from cjt_gym.errors import unknown_name
from cjt_gym.joint import Joint
from cjt_gym.plant import limits_of


@dataclass(frozen=True)
class ControllerEntry:
    """One row of the table.

    Attributes:
        name: Its name in every interface.
        factory: Makes the controller for a joint and a sample time [s].
        summary: The law in one line.
        source: Where it comes from.
        kind: "classical", to tell it from learned policies.
    """

    name: str
    factory: Callable[[Joint, float], Controller]
    summary: str
    source: str
    kind: str = "classical"


def _open_loop(joint: Joint, dt: float) -> Controller:
    return OpenLoop(dt, limits_of(joint).tau)


def _pd_feedforward(joint: Joint, dt: float) -> Controller:
    gains = default_gains(joint, dt, CUTOFF_HZ)
    return PdFeedForward(
        gains.kp,
        gains.kd,
        dt,
        derivative=gains.derivative,
        torque_limit=limits_of(joint).tau,
    )


CONTROLLERS: dict[str, ControllerEntry] = {
    row.name: row
    for row in (
        ControllerEntry(
            "open_loop", _open_loop, "Feed-forward of the reference alone, u = r.", "definition"
        ),
        ControllerEntry(
            "pd_feedforward",
            _pd_feedforward,
            "Feed-forward and PD on the torque error, derivative filtered at 200 Hz.",
            "Vischer, Khatib (1995), IEEE Transactions on Robotics and Automation 11(4)",
        ),
    )
}


def make_controller(name: str, joint: Joint, dt: float) -> Controller:
    """Return the controller of that name with its default gains.

    Args:
        name: A row of `CONTROLLERS`.
        joint: The joint that it is for.
        dt: Sample time [s].

    Raises:
        UnknownNameError: There is none of that name.
        ConfigurationError: The law does not fit the joint or the sample time.
    """
    if name not in CONTROLLERS:
        raise unknown_name("controller", name, CONTROLLERS)
    return CONTROLLERS[name].factory(joint, dt)
