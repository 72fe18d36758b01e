"""Splits a substep whose equations cannot be solved.

With stiff springs with play, friction that falls with speed or very light bodies, the solver may
not converge on the equations of a substep. Shorter substeps make them more nearly linear, so the
substep is halved until they are solved.
"""

from __future__ import annotations

from cjt_gym.joint.kernel.arrays import (
    FINE,
    FINE_ROWS,
    LAGGED,
    MESH,
    REFERENCE,
    RESISTS,
    SAVED,
    SWITCH,
    UNSOLVED,
    Floats,
    OneJoint,
    Setup,
)
from cjt_gym.joint.kernel.compiled import lean, shared
from cjt_gym.joint.kernel.discretize import SCRATCH, discretize
from cjt_gym.joint.kernel.resistance import prepare
from cjt_gym.joint.kernel.substep import substep

HALVINGS = 5
"""Of a substep whose equations stay unsolved; what 32 parts do not solve is reported."""
MATRIX = 48  # numbers of a matrix in the scratch rows, of 6 x 6 at most


@lean
def keep(joint: OneJoint) -> None:
    """Save the state that a substep changes before its equations are solved."""
    memory, currents, work = joint.memory, joint.currents, joint.work
    work[SAVED, 0], work[SAVED, 1] = currents[0], currents[1]
    work[SAVED, 2], work[SAVED, 3] = memory[REFERENCE], memory[LAGGED]
    work[SAVED, 4] = memory[MESH]


@lean
def restore(joint: OneJoint) -> None:
    """Restore the state after a substep whose equations were not solved."""
    memory, currents, work = joint.memory, joint.currents, joint.work
    currents[0], currents[1] = work[SAVED, 0], work[SAVED, 1]
    memory[REFERENCE], memory[LAGGED] = work[SAVED, 2], work[SAVED, 3]
    memory[MESH] = work[SAVED, 4]


@shared
def careful_substep(
    joint: OneJoint, a: Floats, b: Floats, command: float, command_d: float, load: float
) -> float:
    """Do what `substep` does, in smaller pieces if its equations are not solved at once."""
    work, setup = joint.work, joint.setup
    order, size = setup.order, setup.size
    done, pieces, halvings, tau = 0, 1, 0, 0.0
    resists = work[SWITCH, RESISTS] == 1.0
    while True:
        if resists:
            keep(joint)
        last = halvings == HALVINGS
        tau = substep(joint, a, b, command, command_d, load, last)
        if not resists:
            return tau
        if work[SWITCH, UNSOLVED] == 0.0 or last:
            done += 1
            if done == pieces:
                break
            continue
        restore(joint)
        done, pieces, halvings = 2 * done, 2 * pieces, halvings + 1
        setup = Setup(
            setup.groups,
            size,
            order,
            setup.drive,
            setup.is_voltage,
            0.5 * setup.h,
            setup.substeps,
            setup.dt,
        )
        joint = OneJoint(joint.p, joint.memory, joint.ripple, joint.currents, work, setup)
        space = work[FINE : FINE + FINE_ROWS].reshape(FINE_ROWS * 8)
        a = space[: order * order].reshape((order, order))
        b = space[MATRIX : MATRIX + order * (2 + size)].reshape((order, 2 + size))
        scratch = space[2 * MATRIX : 2 * MATRIX + 144].reshape(SCRATCH)
        discretize(joint.p, setup.groups, setup.h, a, b, scratch)
        prepare(joint, command, load)
    if halvings > 0:
        prepare(joint, command, load)
    return tau
