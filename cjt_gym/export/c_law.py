"""What a controller does, in the form that is written in C."""

from __future__ import annotations

from dataclasses import dataclass

from cjt_gym.baselines import Controller, OpenLoop, PdFeedForward
from cjt_gym.baselines.impedance import Impedance
from cjt_gym.baselines.linear_law import LinearController, LinearLaw, assemble, static
from cjt_gym.errors import ConfigurationError
from cjt_gym.export.c_additions import NOTHING, Addition, addition_of


@dataclass(frozen=True)
class CLaw:
    """A linear law within a limit, with what may be added to it."""

    linear: LinearLaw  # the law
    limit: float  # largest motor torque [N m]
    # whether its memory begins as if the reference had long stood where it is, else as if it had
    # been the torque that is there
    follows: bool = False
    addition: Addition = NOTHING  # what is added to its command
    # of a spring that is rendered at the load by way of the reference [N m/rad]
    stiffness: float = 0.0
    damping: float = 0.0  # of a damper beside that [N m s/rad]


def law_of(controller: Controller, name: str) -> CLaw:
    """Return what a controller does; an error where C cannot do that."""
    limit = controller.torque_limit
    match controller:
        case OpenLoop():
            return CLaw(assemble(controller.dt, static(reference=1.0)), limit)
        case LinearController():
            added = addition_of(controller.addition)
            if added is not None:
                return CLaw(controller.law, limit, addition=added)
        case PdFeedForward():
            assert controller.linear is not None
            return CLaw(controller.linear, limit, follows=True)
        case Impedance():
            return CLaw(
                controller.inner,
                limit,
                stiffness=controller.stiffness,
                damping=controller.damping,
            )
    raise ConfigurationError(
        f"The controller {name} cannot be written in C: it learns series, solves programs while it "
        "runs, or is code of your own. Take a linear law, such as lqg, or one put together from "
        "parts, such as pid+reference+friction."
    )
