"""Analysis of closed loops: a controller around a joint, linear and by simulation.

`analyse` asks a controller and a simulated joint with impulses, so that it needs to know neither's
equations, closes the loop, and gives its `Loop` for responses and `figures_of` for margins,
bandwidth, steps, noise and the passivity of the port. `identify` measures the response of the
nonlinear loop with multisines, for controllers and effects that are not linear.

`cjt_gym.analysis.open_loop` is the joint without a controller: responses, poles and zeros, steps.
"""

from cjt_gym.analysis.figures import (
    Figures,
    Margins,
    figures_of,
    margins,
    port_shortage,
    step_response,
    stiffest_rendered,
)
from cjt_gym.analysis.identify import Identified, identify
from cjt_gym.analysis.loop import Loop, Responses
from cjt_gym.analysis.probe import (
    LINEAR_EFFECTS,
    LinearLaw,
    LinearPlant,
    probe_law,
    probe_plant,
)
from cjt_gym.analysis.system import System, realize
from cjt_gym.joint import Joint
from cjt_gym.plant import Law

__all__ = [
    "LINEAR_EFFECTS",
    "Figures",
    "Identified",
    "Law",
    "LinearLaw",
    "LinearPlant",
    "Loop",
    "Margins",
    "Responses",
    "System",
    "analyse",
    "figures_of",
    "identify",
    "margins",
    "port_shortage",
    "probe_law",
    "probe_plant",
    "realize",
    "step_response",
    "stiffest_rendered",
]


def analyse(law: Law, joint: Joint, dt: float, dt_physics: float = 1e-4) -> Loop:
    """Return the linear closed loop of a controller around a joint.

    Args:
        law: The controller; it is reset. `loop.law.is_linear` says whether a linear model stands
            for it.
        joint: The joint; `loop.plant.left_out` names its effects that are not linear.
        dt: Control step [s].
        dt_physics: Substep [s].

    Example:
        >>> from cjt_gym.baselines import make_controller
        >>> from cjt_gym.joint import load_joint
        >>> delay = {"command_delay": {"delay": 1e-3}}
        >>> joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects=delay)
        >>> loop = analyse(make_controller("pd_feedforward", joint, 1e-3), joint, 1e-3)
        >>> loop.is_stable()
        True
    """
    return Loop(probe_law(law, joint, dt), probe_plant(joint, dt, dt_physics))
