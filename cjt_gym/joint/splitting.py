"""Splits a substep whose equations cannot be solved.

With stiff springs with play, friction that falls with speed or very light bodies, the solver may
not converge on the equations of a substep. Shorter substeps make them more nearly linear, so the
substep is halved until they are solved.
"""

from __future__ import annotations

from typing import Any

from cjt_gym.joint.arrays import (
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
    Setup,
)
from cjt_gym.joint.compiled import lean
from cjt_gym.joint.discretize import SCRATCH, discretize
from cjt_gym.joint.resistance import prepare
from cjt_gym.joint.substep import substep

HALVINGS = 5
"""Of a substep whose equations stay unsolved; what 32 parts do not solve is reported."""
MATRIX = 48  # numbers of a matrix in the scratch rows, of 6 x 6 at most


@lean
def keep(memory: Floats, currents: Floats, work: Floats) -> None:
    """Save the state that a substep changes before its equations are solved."""
    work[SAVED, 0], work[SAVED, 1] = currents[0], currents[1]
    work[SAVED, 2], work[SAVED, 3] = memory[REFERENCE], memory[LAGGED]
    work[SAVED, 4] = memory[MESH]


@lean
def restore(memory: Floats, currents: Floats, work: Floats) -> None:
    """Restore the state after a substep whose equations were not solved."""
    currents[0], currents[1] = work[SAVED, 0], work[SAVED, 1]
    memory[REFERENCE], memory[LAGGED] = work[SAVED, 2], work[SAVED, 3]
    memory[MESH] = work[SAVED, 4]


@lean
def careful_substep(
    p: Any,
    memory: Floats,
    ripple: Floats,
    a: Floats,
    b: Floats,
    setup: Setup,
    currents: Floats,
    command: float,
    command_d: float,
    load: float,
    work: Floats,
) -> float:
    """Do what `substep` does, in smaller pieces if its equations are not solved at once."""
    order, size = setup.order, setup.size
    done, pieces, halvings, tau = 0, 1, 0, 0.0
    resists = work[SWITCH, RESISTS] == 1.0
    while True:
        if resists:
            keep(memory, currents, work)
        last = halvings == HALVINGS
        tau = substep(
            p, memory, ripple, a, b, setup, currents, command, command_d, load, work, last
        )
        if not resists:
            return tau
        if work[SWITCH, UNSOLVED] == 0.0 or last:
            done += 1
            if done == pieces:
                break
            continue
        restore(memory, currents, work)
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
        space = work[FINE : FINE + FINE_ROWS].reshape(FINE_ROWS * 8)
        a = space[: order * order].reshape((order, order))
        b = space[MATRIX : MATRIX + order * (2 + size)].reshape((order, 2 + size))
        scratch = space[2 * MATRIX : 2 * MATRIX + 144].reshape(SCRATCH)
        discretize(p, setup.groups, setup.h, a, b, scratch)
        prepare(p, memory, setup, command, load, work)
    if halvings > 0:
        prepare(p, memory, setup, command, load, work)
    return tau
